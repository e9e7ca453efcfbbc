# SPDX-License-Identifier: GPL-3.0-or-later
"""The look of solids: what a material's surface shader says about the light that they reflect and show."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from .. import compat
from .materials import surface_socket
from .nodes import NodeReader, Warn, find_socket

# What Cycles shows of a mesh without a material.
DEFAULT_ALBEDO = 0.8

# Inputs of Principled that say that a surface isn't matt or isn't opaque, and what they are where it is. Transmission has
# had another name since Blender 4.
_MATT = {"Metallic": 0.0, "Transmission": 0.0, "Transmission Weight": 0.0, "Alpha": 1.0}


@dataclass(frozen=True)
class Surface:
    """A Lambertian surface of one colour. Linear RGB."""

    albedo: tuple[float, float, float] = (DEFAULT_ALBEDO,) * 3  # 0..1
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)  # radiance, W / (m^2 sr)
    is_holdout: bool = False


class _Unreadable(Exception):
    """Says what of a shader can't be read."""


class _SurfaceReader(NodeReader):
    """Gives up where another value would have to stand in for what can't be read."""

    def __init__(self, owner: str, warn: Warn) -> None:
        self._warn_of_look = warn
        super().__init__(owner, self._give_up, self._no_attribute)

    def name_lost(self, node: bpy.types.Node) -> None:
        """Warns of what makes a Principled node something else than a matt surface."""
        for identifier, matt in _MATT.items():
            if not _has(node, identifier):
                continue
            socket = find_socket(node.inputs, identifier)
            if socket.is_linked or socket.default_value != matt:
                value = "that is linked" if socket.is_linked else f"{socket.default_value:.4g}"
                self._warn_of_look(
                    f"{self.owner}, node '{node.name}': {identifier} {value} isn't supported on shaded solids; they are "
                    "matt and opaque"
                )

    def stand_in(self, source: bpy.types.Node, node: bpy.types.Node, socket: bpy.types.NodeSocket) -> np.ndarray:
        raise _Unreadable(f"the link from node '{source.name}' to '{node.name}', input '{socket.name}'")

    @staticmethod
    def _give_up(text: str) -> None:
        raise _Unreadable(text)

    @staticmethod
    def _no_attribute(name: str) -> None:
        raise _Unreadable(f"attribute '{name}'")


def read_surface(material: bpy.types.Material | None, warn: Warn) -> Surface:
    """What a solid of that material looks like: colours of Diffuse, Principled and Emission nodes, and of mixes of them.

    What can't be read, such as a texture, is named in a warning, and the viewport's colour is used.
    """
    if material is None:
        return Surface()
    owner = f"Material '{material.name}'"
    if compat.node_tree(material) is None:
        return _surface(np.array(material.diffuse_color)[:3], np.zeros(3), owner, warn)
    socket = surface_socket(material)
    if socket is None:
        return Surface((0.0, 0.0, 0.0))
    reader = _SurfaceReader(owner, warn)
    try:
        node, _ = reader.shader(socket)
        if node is not None and node.bl_idname == "ShaderNodeHoldout":
            return Surface(is_holdout=True)
        return _surface(*_closure(reader, socket, ()), owner, warn)
    except _Unreadable as error:
        color = np.array(material.diffuse_color)[:3]
        shown = ", ".join(f"{channel:.4g}" for channel in color)
        warn(f"{owner}: {error} isn't supported on shaded solids; its viewport colour ({shown}) is used")
        return _surface(color, np.zeros(3), owner, warn)


def _surface(albedo: np.ndarray, emission: np.ndarray, owner: str, warn: Warn) -> Surface:
    clipped = np.clip(albedo, 0, 1)
    if np.any(clipped != albedo):
        shown = ", ".join(f"{channel:.4g}" for channel in albedo)
        warn(f"{owner}: its colour ({shown}) is out of range; it is clipped to 0..1")
    return Surface(tuple(clipped.tolist()), tuple(np.maximum(emission, 0).tolist()))


def _closure(reader: _SurfaceReader, socket: bpy.types.NodeSocket, groups: tuple) -> tuple[np.ndarray, np.ndarray]:
    """Albedo and emission, (3,) each."""
    node, groups = reader.shader(socket, groups)
    if node is None:
        return np.zeros(3), np.zeros(3)
    if node.bl_idname == "ShaderNodeAddShader":
        first, second = _closure(reader, node.inputs[0], groups), _closure(reader, node.inputs[1], groups)
        return first[0] + second[0], first[1] + second[1]
    if node.bl_idname == "ShaderNodeMixShader":
        share = float(np.clip(reader.number(node, "Fac", groups)[0], 0, 1))
        first, second = _closure(reader, node.inputs[1], groups), _closure(reader, node.inputs[2], groups)
        return (1 - share) * first[0] + share * second[0], (1 - share) * first[1] + share * second[1]
    if node.bl_idname == "ShaderNodeBsdfDiffuse":
        return reader.color(node, "Color", groups)[0], np.zeros(3)
    if node.bl_idname == "ShaderNodeEmission":
        return np.zeros(3), _emission(reader, node, "Color", "Strength", groups)
    if node.bl_idname == "ShaderNodeBsdfPrincipled":
        reader.name_lost(node)
        # The colour was called Emission before Blender 4.
        color = "Emission Color" if _has(node, "Emission Color") else "Emission"
        return reader.color(node, "Base Color", groups)[0], _emission(reader, node, color, "Emission Strength", groups)
    raise _Unreadable(f"node '{node.name}' ({node.bl_label})")


def _emission(reader: NodeReader, node: bpy.types.Node, color: str, strength: str, groups: tuple) -> np.ndarray:
    factor = float(reader.number(node, strength, groups)[0])
    return factor * reader.color(node, color, groups)[0] if factor != 0 else np.zeros(3)


def _has(node: bpy.types.Node, identifier: str) -> bool:
    try:
        return find_socket(node.inputs, identifier) is not None
    except KeyError:
        return False
