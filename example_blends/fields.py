# SPDX-License-Identifier: GPL-3.0-or-later
"""Geometry-nodes fields written as formulas: a + b makes a Math node. For Blender 3.4 and later."""

from __future__ import annotations

import math
from typing import Union

import bpy

Number = Union["Field", float]


class Field:
    """An output socket with arithmetic: of numbers, of vectors, and of a vector times or over a number."""

    def __init__(self, tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket) -> None:
        self.tree = tree
        self.socket = socket

    @property
    def is_vector(self) -> bool:
        return self.socket.type in ("VECTOR", "RGBA")

    def __add__(self, other: Number) -> Field:
        return self._math("ADD", self, other)

    def __sub__(self, other: Number) -> Field:
        return self._math("SUBTRACT", self, other)

    def __mul__(self, other: Number) -> Field:
        return self._math("MULTIPLY", self, other)

    def __truediv__(self, other: Number) -> Field:
        return self._math("DIVIDE", self, other)

    def __pow__(self, other: float) -> Field:
        return self._math("POWER", self, other)

    def __radd__(self, other: float) -> Field:
        return self._math("ADD", other, self)

    def __rsub__(self, other: float) -> Field:
        return self._math("SUBTRACT", other, self)

    def __rmul__(self, other: float) -> Field:
        return self._math("MULTIPLY", other, self)

    def floor(self) -> Field:
        return self._math("FLOOR", self)

    def sin(self) -> Field:
        return self._math("SINE", self)

    def cos(self) -> Field:
        return self._math("COSINE", self)

    def log(self) -> Field:
        """The natural logarithm of a number."""
        return self._math("LOGARITHM", self, math.e)

    def length(self) -> Field:
        node = self.tree.nodes.new("ShaderNodeVectorMath")
        node.operation = "LENGTH"
        return self._output(node, {0: self}, "Value")

    def smoothstep(self, low: float, high: float) -> Field:
        """Of a number: 0 below `low`, 1 above `high`, smooth between them."""
        node = self.tree.nodes.new("ShaderNodeMapRange")
        node.interpolation_type = "SMOOTHSTEP"
        node.inputs["From Min"].default_value, node.inputs["From Max"].default_value = low, high
        return self._output(node, {"Value": self}, "Result")

    def rotate(self, axis: Field, angle: Field) -> Field:
        """The vector turned about `axis` by `angle` (radians)."""
        node = self.tree.nodes.new("ShaderNodeVectorRotate")
        return self._output(node, {"Vector": self, "Axis": axis, "Angle": angle}, "Vector")

    def _math(self, operation: str, *operands: Number) -> Field:
        vectors = any(isinstance(operand, Field) and operand.is_vector for operand in operands)
        node = self.tree.nodes.new("ShaderNodeVectorMath" if vectors else "ShaderNodeMath")
        node.operation = operation
        return self._output(node, dict(enumerate(operands)), 0)

    def _output(self, node: bpy.types.Node, inputs: dict[str | int, Number], output: str | int) -> Field:
        connect(self.tree, node, inputs)
        return Field(self.tree, node.outputs[output])


class Fields:
    """The fields to begin with in a geometry-nodes tree."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self.tree = tree

    def index(self) -> Field:
        """The number of the point, from 0."""
        return Field(self.tree, self.tree.nodes.new("GeometryNodeInputIndex").outputs[0])

    def frame(self) -> Field:
        """The scene's frame, with its fraction."""
        return Field(self.tree, self.tree.nodes.new("GeometryNodeInputSceneTime").outputs["Frame"])

    def vector(self, x: Number, y: Number, z: Number) -> Field:
        return self._node("ShaderNodeCombineXYZ", {"X": x, "Y": y, "Z": z}, "Vector")

    def random(self, ident: Field, seed: int, low: float, high: float) -> Field:
        """Evenly spread between `low` and `high`, always the same for the same `ident` and `seed`."""
        inputs = {"Min_001": low, "Max_001": high, "ID": ident, "Seed": seed}
        return self._node("FunctionNodeRandomValue", inputs, "Value_001")

    def direction(self, ident: Field, seed: int) -> Field:
        """Unit vectors evenly spread over the sphere."""
        turn = self.random(ident, seed, 0.0, 2 * math.pi)
        z = self.random(ident, seed + 100, -1.0, 1.0)
        across = (1.0 - z * z) ** 0.5
        return self.vector(across * turn.cos(), across * turn.sin(), z)

    def noise(self, position: Field, time: Field) -> Field:
        """Smooth noise vectors with features of size 1 that change in a time of 1, about -0.5..0.5."""
        node = self.tree.nodes.new("ShaderNodeTexNoise")
        node.noise_dimensions = "4D"
        connect(self.tree, node, {"Vector": position, "W": time, "Scale": 1.0, "Detail": 0.0})
        middle = self.vector(0.5, 0.5, 0.5)
        return Field(self.tree, node.outputs["Color"]) - middle

    def points(self, count: int, position: Field, radius: Field) -> Field:
        """A geometry of `count` points."""
        return self._node("GeometryNodePoints", {"Count": count, "Position": position, "Radius": radius}, "Geometry")

    def store(self, geometry: Field, name: str, kind: str, value: Field) -> Field:
        """The geometry with one more attribute, of `kind` "FLOAT", "INT" or "VECTOR"."""
        node = self.tree.nodes.new("GeometryNodeStoreNamedAttribute")
        node.data_type = "FLOAT_VECTOR" if kind == "VECTOR" else kind
        node.inputs["Name"].default_value = name
        connect(self.tree, node, {"Geometry": geometry, f"Value_{kind.title()}": value})
        return Field(self.tree, node.outputs["Geometry"])

    def arrange(self) -> None:
        """Places the nodes in columns, each to the right of those it depends on."""
        columns: dict[bpy.types.Node, int] = {}
        heights: dict[int, int] = {}

        def column(node: bpy.types.Node) -> int:
            if node not in columns:
                columns[node] = max((1 + column(link.from_node) for link in sources[node]), default=0)
            return columns[node]

        sources = {node: [link for link in self.tree.links if link.to_node == node] for node in self.tree.nodes}
        for node in self.tree.nodes:
            row = heights.get(column(node), 0)
            heights[column(node)] = row + 1
            node.location = (200 * column(node), -200 * row)

    def _node(self, kind: str, inputs: dict[str, Number], output: str) -> Field:
        node = self.tree.nodes.new(kind)
        connect(self.tree, node, inputs)
        return Field(self.tree, next(socket for socket in node.outputs if socket.identifier == output))


def connect(tree: bpy.types.NodeTree, node: bpy.types.Node, inputs: dict[str | int, Number]) -> None:
    """Links fields to a node's inputs, given by identifier or number, and sets those given as numbers."""
    by_name = {socket.identifier: socket for socket in node.inputs}
    for name, value in inputs.items():
        socket = node.inputs[name] if isinstance(name, int) else by_name[name]
        if isinstance(value, Field):
            tree.links.new(value.socket, socket)
        elif socket.type == "VECTOR":
            socket.default_value = (value, value, value)
        else:
            socket.default_value = value
