# SPDX-License-Identifier: GPL-3.0-or-later
"""Lamps as the arguments of core.Scene.add_light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from .. import compat
from .nodes import NodeReader, Warn


@dataclass
class Light:
    """One light; the fields follow core.Scene.add_light, `shape` holds those that only its type has."""

    name: str  # for messages
    owner: str  # name of the object
    group: str  # of lights, "" if it is in none
    type: str  # POINT, SPOT, SUN, AREA
    matrix: np.ndarray  # (4, 4) float64, world from light
    color: np.ndarray  # (3,) linear RGB, exposure and nodes included
    power: float  # W, of a sun W/m^2
    normalize: bool
    casts_shadows: bool
    shape: dict[str, Any]
    light_sets: tuple[int, ...] | None = None  # that it shines on; None: all
    shadow_sets: tuple[int, ...] | None = None  # that block it


def export_light(owner: bpy.types.Object, matrix: np.ndarray, warn: Warn) -> Light | None:
    """The light of an evaluated lamp at `matrix` (4, 4), or None if no light of it reaches smoke or solids."""
    lamp = owner.data
    name = f"Light '{owner.name_full}'"
    is_portal = lamp.type == "AREA" and getattr(getattr(lamp, "cycles", None), "is_portal", False)
    if is_portal or not (owner.visible_volume_scatter or owner.visible_diffuse) or lamp.energy == 0:
        return None
    color = np.array(lamp.color) * compat.light_scale(lamp) * _emission(lamp, name, warn)
    if lamp.energy < 0 or np.any(color < 0):
        shown = ", ".join(f"{channel:.4g}" for channel in lamp.energy * color)
        warn(f"{name} has negative power ({shown}), which isn't supported; it is off")
        return None
    if not _has_size(lamp, matrix):
        warn(f"{name} has no size or a scale of 0; it is off")
        return None
    _warn_of_features(lamp, name, warn)
    return Light(
        name,
        owner.name,
        group=getattr(owner, "lightgroup", ""),
        type=lamp.type,
        matrix=matrix,
        color=color,
        power=lamp.energy,
        normalize=compat.light_is_normalized(lamp),
        casts_shadows=compat.light_casts_shadows(lamp),
        shape=_shape(lamp),
    )


def _shape(lamp: bpy.types.Light) -> dict[str, Any]:
    if lamp.type == "SUN":
        return {"angle": lamp.angle}
    if lamp.type == "AREA":
        return {"shape": lamp.shape, "size": lamp.size, "size_y": lamp.size_y, "spread": lamp.spread}
    if lamp.type == "SPOT":
        cone = {"spot_angle": lamp.spot_size, "spot_blend": lamp.spot_blend}
        return {"radius": lamp.shadow_soft_size, **cone}
    return {"radius": lamp.shadow_soft_size}


def _has_size(lamp: bpy.types.Light, matrix: np.ndarray) -> bool:
    """Whether an area light has an area, and a spot light a cone."""
    if lamp.type not in ("AREA", "SPOT"):
        return True
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    if lamp.type == "SPOT":
        return bool(scale.all())
    sizes = [lamp.size, lamp.size if lamp.shape in ("SQUARE", "DISK") else lamp.size_y]
    return bool(scale.all() and all(sizes))


def _emission(lamp: bpy.types.Light, name: str, warn: Warn) -> np.ndarray:
    """The factor (3,) by which the lamp's nodes change its power."""
    if not lamp.use_nodes or lamp.node_tree is None:
        return np.ones(3)
    output = lamp.node_tree.get_output_node("CYCLES")
    reader = NodeReader(name, warn)
    node, groups = reader.shader(output.inputs["Surface"]) if output else (None, ())
    if node is None:
        return np.zeros(3)
    if node.bl_idname != "ShaderNodeEmission":
        warn(f"{name}: node '{node.name}' ({node.bl_label}) isn't supported; the light's power is used as it is")
        return np.ones(3)
    return (reader.color(node, "Color", groups) * reader.number(node, "Strength", groups)[:, None])[0]


def _warn_of_features(lamp: bpy.types.Light, name: str, warn: Warn) -> None:
    if lamp.type in ("POINT", "SPOT") and compat.light_is_sphere(lamp) and lamp.shadow_soft_size > 0:
        warn(f"{name}: a radius of {lamp.shadow_soft_size:.4g} without soft fall-off isn't supported yet; it is a disc")
