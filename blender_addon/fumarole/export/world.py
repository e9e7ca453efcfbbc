# SPDX-License-Identifier: GPL-3.0-or-later
"""The world's background colour."""

from __future__ import annotations

import bpy
import numpy as np

from .. import compat
from .nodes import NodeReader, Warn


def export_background(world: bpy.types.World | None, warn: Warn) -> np.ndarray:
    """The radiance (3,) of a world's background; black without a world."""
    if world is None:
        return np.zeros(3)
    tree = compat.node_tree(world)
    if tree is None:
        return np.array(world.color, dtype=np.float64)
    owner = f"World '{world.name}'"
    output = tree.get_output_node("CYCLES")
    reader = NodeReader(owner, warn)
    node, groups = reader.shader(output.inputs["Surface"]) if output else (None, ())
    if node is None:
        return np.zeros(3)
    if node.bl_idname not in ("ShaderNodeBackground", "ShaderNodeEmission"):
        warn(f"{owner}: node '{node.name}' ({node.bl_label}) isn't supported; the background is black")
        return np.zeros(3)
    return (reader.color(node, "Color", groups) * reader.number(node, "Strength", groups)[:, None])[0]
