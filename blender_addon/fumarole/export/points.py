# SPDX-License-Identifier: GPL-3.0-or-later
"""Point clouds as smoke: point cloud objects, and the points that geometry nodes make."""

from __future__ import annotations

import bpy
import numpy as np

from .materials import read_volume
from .nodes import Warn
from .particles import Particles, length_scale, stable_ids, transform_points, transform_vectors

# What Blender takes for points without a radius attribute, m.
_DEFAULT_RADIUS = 0.01

_WIDTHS = {"FLOAT": 1, "INT": 1, "INT8": 1, "FLOAT_VECTOR": 3, "FLOAT_COLOR": 4, "BYTE_COLOR": 4, "FLOAT2": 2}
_FIELDS = {"FLOAT_VECTOR": "vector", "FLOAT2": "vector", "FLOAT_COLOR": "color", "BYTE_COLOR": "color"}


def export_points(
    owner: bpy.types.Object,
    matrix: np.ndarray,
    instance_key: str,
    radius_scale: float,
    frame_rate: float,
    warn: Warn,
) -> Particles | None:
    """The points of an evaluated point cloud as particles, or None if there are none.

    `radius_scale` multiplies their radii. `frame_rate`: frames a second.

    Attributes by name: `radius` (m, without it 0.01), `velocity` (m/s), `id` (whole number), and those that the volume
    material asks for: Principled Volume's density and colour attribute, and Attribute nodes.
    """
    cloud = owner.data
    name = f"Point cloud '{owner.name_full}'"
    positions = read_attribute(cloud, "position")
    if positions is None or len(positions) == 0:
        return None
    count = len(positions)
    radii = read_attribute(cloud, "radius")
    if radii is None:
        radii = np.full(count, _DEFAULT_RADIUS, dtype=np.float32)
    scale = length_scale(matrix) * radius_scale
    velocities = read_attribute(cloud, "velocity")
    numbers = read_attribute(cloud, "id")
    volume = read_volume(_material(owner, name, warn), name, warn, lambda wanted: read_attribute(cloud, wanted))
    return Particles(
        name,
        transform_points(matrix, positions),
        radii * volume.radius_factor * np.float32(scale),
        None if velocities is None else transform_vectors(matrix, velocities) / np.float32(frame_rate),
        stable_ids(f"{owner.name_full}\0{instance_key}", np.arange(count) if numbers is None else numbers),
        volume,
        owner.name,
    )


def read_attribute(cloud: bpy.types.PointCloud, name: str) -> np.ndarray | None:
    """A point attribute by name: (n,) or, for vectors and colours, (n, 3); float32, whole numbers int32. Else None."""
    attribute = cloud.attributes.get(name) if name else None
    if attribute is None or attribute.domain != "POINT" or attribute.data_type not in _WIDTHS:
        return None
    width = _WIDTHS[attribute.data_type]
    kind = np.int32 if attribute.data_type.startswith("INT") else np.float32
    values = np.empty(len(attribute.data) * width, dtype=kind)
    attribute.data.foreach_get(_FIELDS.get(attribute.data_type, "value"), values)
    if width == 1:
        return values
    values = values.reshape(-1, width)
    return values[:, :3] if width >= 3 else np.pad(values, ((0, 0), (0, 3 - width)))


def _material(owner: bpy.types.Object, name: str, warn: Warn) -> bpy.types.Material | None:
    materials = [slot.material for slot in owner.material_slots] or list(owner.data.materials)
    if len(materials) > 1:
        warn(f"{name} has {len(materials)} materials; all its points take the first one")
    return materials[0] if materials else None
