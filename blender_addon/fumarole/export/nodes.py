# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads what shader node trees say of points: constants, attributes and what is computed of them, through reroutes, groups
and muted nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import bpy
import numpy as np

from .functions import evaluate

Warn = Callable[[str], None]
# The values of an image texture node's output by its identifier at each of its pixels, (n,) or (n, 3), or None.
Textures = Callable[[bpy.types.Node, str], "np.ndarray | None"]
# The values of a geometry attribute by its name, (n,) or (n, 3) float32, or None where there is no such attribute.
Attributes = Callable[[str], "np.ndarray | None"]

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)


class NodeReader:
    """Evaluates the sockets of one data block's node tree.

    Values come back as float32 arrays, which is what Blender holds; their first axis has length 1 (a constant) or n (a
    value for each of n points). `attributes` are those of the geometry, `particles` the outputs of Particle Info; the
    points may be an image's pixels, which `textures` gives.
    What can't be read is named in a warning, and the socket's own value is used.
    """

    def __init__(
        self,
        owner: str,
        warn: Warn,
        attributes: Attributes = lambda name: None,
        particles: Attributes = lambda name: None,
        textures: Textures = lambda node, output: None,
    ) -> None:
        self.owner = owner
        self.warn = warn
        self.attributes = attributes
        self.particles = particles
        self.textures = textures

    def shader(self, socket: bpy.types.NodeSocket, groups: tuple = ()) -> tuple[bpy.types.Node | None, tuple]:
        """The shader node that feeds `socket` (None if there is none) and the groups it is in."""
        node, _, groups = _source(socket, groups)
        return node, groups

    def number(self, node: bpy.types.Node, identifier: str, groups: tuple = ()) -> np.ndarray:
        """The value of a float input, (1,) or (n,)."""
        values = self._value(node, identifier, groups)
        return values @ LUMINANCE if values.ndim == 2 else values

    def color(self, node: bpy.types.Node, identifier: str, groups: tuple = ()) -> np.ndarray:
        """The value of a colour or vector input, (1, 3) or (n, 3)."""
        values = self._value(node, identifier, groups)
        return values if values.ndim == 2 else np.repeat(values[:, None], 3, axis=1)

    def text(self, node: bpy.types.Node, identifier: str) -> str:
        """The value of a text input."""
        return find_socket(node.inputs, identifier).default_value

    def _value(self, node: bpy.types.Node, identifier: str, groups: tuple) -> np.ndarray:
        socket = find_socket(node.inputs, identifier)
        source, output, groups = _source(socket, groups)
        if source is None:
            return _constant(output if output is not None else socket)
        if source.bl_idname in ("ShaderNodeValue", "ShaderNodeRGB"):
            return _constant(source.outputs[0])
        if source.bl_idname == "ShaderNodeAttribute" and source.attribute_type == "GEOMETRY":
            values = self.attributes(source.attribute_name)
            if values is None:
                self.warn(f"{self.owner}: there is no attribute '{source.attribute_name}'; it counts as 0")
                return np.zeros(1, dtype=np.float32)
            return values.astype(np.float32, copy=False)
        if source.bl_idname == "ShaderNodeParticleInfo":
            values = self.particles(output.identifier)
        elif source.bl_idname == "ShaderNodeTexImage":
            values = self.textures(source, output.identifier)
        else:
            values = evaluate(self, source, output, groups)
        if values is not None:
            return values
        return self.stand_in(source, node, socket)

    def stand_in(self, source: bpy.types.Node, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> np.ndarray:
        """What is used for an input of `node` whose link from `source` can't be read."""
        value = _constant(socket)
        shown = ", ".join(f"{v:.4g}" for v in value.ravel())
        self.warn(
            f"{self.owner}: the link from node '{source.name}' to '{node.name}', input '{socket.name}', "
            f"isn't supported; the input's own value {shown} is used"
        )
        return value


def find_socket(sockets: bpy.types.NodeInputs, identifier: str) -> bpy.types.NodeSocket:
    """The socket with that identifier. Names can't be used: they change, and disabled sockets aren't found by them.

    Raises KeyError if there is none.
    """
    for socket in sockets:
        if socket.identifier == identifier:
            return socket
    raise KeyError(identifier)


def upstream(socket: bpy.types.NodeSocket, groups: tuple = ()) -> Iterator[bpy.types.Node]:
    """All nodes that feed `socket`, directly or through others; each may come more than once."""
    node, _, groups = _source(socket, groups)
    if node is not None:
        yield node
        for entry in node.inputs:
            if entry.is_linked:
                yield from upstream(entry, groups)


def _source(socket: bpy.types.NodeSocket, groups: tuple) -> tuple:
    """Follows an input back to what feeds it: (node, output, groups), or (None, input that holds the value, groups)."""
    while True:
        link = next((link for link in socket.links if link.is_valid and not link.is_muted), None)
        if link is None:
            return None, socket, groups
        node, output = link.from_node, link.from_socket
        if node.mute:
            inner = next((inner for inner in node.internal_links if inner.to_socket == output), None)
            if inner is None:
                return None, None, groups
            socket = inner.from_socket
        elif node.bl_idname == "NodeReroute":
            socket = node.inputs[0]
        elif node.bl_idname == "ShaderNodeGroup" and node.node_tree is not None:
            ends = (inner for inner in node.node_tree.nodes if inner.bl_idname == "NodeGroupOutput")
            end = next((inner for inner in ends if inner.is_active_output), None)
            if end is None:
                return None, None, groups
            socket, groups = find_socket(end.inputs, output.identifier), groups + (node,)
        elif node.bl_idname == "NodeGroupInput" and groups:
            socket, groups = find_socket(groups[-1].inputs, output.identifier), groups[:-1]
        else:
            return node, output, groups


def _constant(socket: bpy.types.NodeSocket) -> np.ndarray:
    value = getattr(socket, "default_value", 0.0)
    if isinstance(value, (int, float)):
        return np.array([value], dtype=np.float32)
    return np.array([tuple(value)[:3]], dtype=np.float32)
