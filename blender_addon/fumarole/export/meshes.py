# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes as solids that cast shadows on smoke and hide it."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from .materials import emits_light, is_volume_only, lets_light_through
from .nodes import Warn


@dataclass
class Mesh:
    """One solid; the arrays follow core.Scene.add_mesh and are shared by instances of the same mesh."""

    name: str
    vertices: np.ndarray  # (n, 3) float32, local space
    triangles: np.ndarray  # (m, 3) uint32
    matrix: np.ndarray  # (4, 4) float64, world from local
    casts_shadow: bool
    visible_to_camera: bool
    light_set: int = 0
    shadow_set: int = 0


class MeshReader:
    """Reads evaluated meshes, each data block and set of materials once."""

    def __init__(self, warn: Warn) -> None:
        self._warn = warn
        self._read: dict[tuple, tuple[np.ndarray, np.ndarray]] = {}

    def export(
        self, owner: bpy.types.Object, matrix: np.ndarray, hidden_from_camera: bool
    ) -> Mesh | None:
        """The solid of an evaluated object whose data is a mesh, or None if it has no faces or none that is solid."""
        visible = owner.visible_camera and not hidden_from_camera
        if not visible and not owner.visible_shadow:
            return None
        materials = [slot.material for slot in owner.material_slots]
        key = (owner.data.as_pointer(), tuple(material and material.name_full for material in materials))
        if key not in self._read:
            self._warn_of_looks(owner, materials)
            self._read[key] = _triangles(owner, materials)
        vertices, triangles = self._read[key]
        if len(triangles) == 0:
            return None
        name = f"Object '{owner.name_full}'"
        return Mesh(name, vertices, triangles, matrix, bool(owner.visible_shadow), bool(visible))

    def _warn_of_looks(self, owner: bpy.types.Object, materials: list[bpy.types.Material | None]) -> None:
        name = f"Object '{owner.name_full}'"
        for material in materials:
            if lets_light_through(material):
                self._warn(f"{name}: material '{material.name}' lets light through; it counts as opaque")
            if emits_light(material):
                self._warn(f"{name}: the emission of material '{material.name}' lights no smoke yet")


def _triangles(owner: bpy.types.Object, materials: list[bpy.types.Material | None]) -> tuple[np.ndarray, np.ndarray]:
    mesh = owner.data
    # In edit mode the evaluated mesh may be a wrapper without arrays of its own.
    is_temporary = mesh.is_editmode
    if is_temporary:
        mesh = owner.to_mesh()
    try:
        vertices = np.empty(3 * len(mesh.vertices), dtype=np.float32)
        mesh.vertices.foreach_get("co", vertices)
        mesh.calc_loop_triangles()
        triangles = np.empty(3 * len(mesh.loop_triangles), dtype=np.int32)
        mesh.loop_triangles.foreach_get("vertices", triangles)
        triangles = triangles.reshape(-1, 3).astype(np.uint32)
        is_volume = np.array([is_volume_only(material) for material in materials])
        if is_volume.any():
            slots = np.empty(len(triangles), dtype=np.int32)
            mesh.loop_triangles.foreach_get("material_index", slots)
            triangles = triangles[~is_volume[np.clip(slots, 0, len(is_volume) - 1)]]
        return vertices.reshape(-1, 3), triangles
    finally:
        if is_temporary:
            owner.to_mesh_clear()
