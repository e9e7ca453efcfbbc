# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes as solids that cast shadows on smoke and hide it."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from .. import compat
from .materials import emits_light, is_volume_only, lets_light_through
from .nodes import Warn
from .surfaces import Surface, read_surface


@dataclass
class Mesh:
    """One solid of one look; the arrays follow core.Scene.add_mesh and are shared by instances of the same mesh."""

    name: str
    vertices: np.ndarray  # (n, 3) float32, local space
    triangles: np.ndarray  # (m, 3) uint32
    matrix: np.ndarray  # (4, 4) float64, world from local
    casts_shadow: bool
    visible_to_camera: bool
    normals: np.ndarray | None  # (m, 3, 3) float32 of the triangles' corners; None: flat
    surface: Surface
    is_holdout: bool  # also where solids are shaded
    light_set: int = 0
    shadow_set: int = 0


@dataclass
class _Part:
    """Faces of a mesh that look alike."""

    vertices: np.ndarray
    triangles: np.ndarray
    normals: np.ndarray | None
    surface: Surface


class MeshReader:
    """Reads evaluated meshes, each data block and set of materials once. Looks are read if solids are shaded."""

    def __init__(self, warn: Warn, is_shaded: bool = False) -> None:
        self._warn = warn
        self._is_shaded = is_shaded
        self._read: dict[tuple, list[_Part]] = {}

    def export(
        self,
        owner: bpy.types.Object,
        parent: bpy.types.Object,
        matrix: np.ndarray,
        view_layer: bpy.types.ViewLayer,
    ) -> list[Mesh]:
        """The solids of an evaluated object whose data is a mesh, one for each look; none if no face is solid.

        `parent` is what makes the object where it is an instance, else itself. Flags are those of Cycles: ray
        visibility of both, holdout and indirect only of the parent; a holdout is never indirect only.
        """
        is_holdout = parent.holdout_get(view_layer=view_layer)
        is_indirect = not is_holdout and parent.indirect_only_get(view_layer=view_layer)
        is_visible = owner.visible_camera and parent.visible_camera and not is_indirect
        casts_shadow = owner.visible_shadow and parent.visible_shadow
        if not is_visible and not casts_shadow:
            return []
        materials = [slot.material for slot in owner.material_slots]
        key = (owner.data.as_pointer(), tuple(material and material.name_full for material in materials))
        if key not in self._read:
            self._warn_of_looks(owner, materials)
            self._read[key] = _parts(owner, self._surfaces(materials), self._is_shaded)
        name = f"Object '{owner.name_full}'"
        flags = (bool(casts_shadow), bool(is_visible))
        return [
            Mesh(
                name,
                part.vertices,
                part.triangles,
                matrix,
                *flags,
                part.normals,
                part.surface,
                is_holdout or part.surface.is_holdout,
            )
            for part in self._read[key]
        ]

    def _surfaces(self, materials: list[bpy.types.Material | None]) -> list[Surface | None]:
        """The look of each material, None of those that make no solid; of a mesh without any, the default."""
        return [
            None if is_volume_only(item) else read_surface(item, self._warn) if self._is_shaded else Surface()
            for item in materials
        ] or [Surface()]

    def _warn_of_looks(self, owner: bpy.types.Object, materials: list[bpy.types.Material | None]) -> None:
        name = f"Object '{owner.name_full}'"
        for material in materials:
            if lets_light_through(material):
                self._warn(f"{name}: material '{material.name}' lets light through; it counts as opaque")
            if emits_light(material):
                self._warn(f"{name}: the emission of material '{material.name}' lights no smoke yet")


def _parts(owner: bpy.types.Object, surfaces: list[Surface | None], needs_normals: bool) -> list[_Part]:
    """The faces by their looks, in the order of the material slots; those of no look are left out."""
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
        looks = list(dict.fromkeys(surfaces))
        slots = np.zeros(len(triangles), dtype=np.int32)
        if len(looks) > 1:
            mesh.loop_triangles.foreach_get("material_index", slots)
        normals = _normals(mesh) if needs_normals else None
        look_of_slot = np.array([looks.index(surface) for surface in surfaces])
        look_of_face = look_of_slot[np.clip(slots, 0, len(surfaces) - 1)]
    finally:
        if is_temporary:
            owner.to_mesh_clear()
    vertices = vertices.reshape(-1, 3)
    parts = []
    for index, look in enumerate(looks):
        chosen = look_of_face == index
        if look is not None and chosen.any():
            parts.append(_Part(vertices, triangles[chosen], normals if normals is None else normals[chosen], look))
    return parts


def _normals(mesh: bpy.types.Mesh) -> np.ndarray | None:
    """Normals (m, 3, 3) at the corners of the triangles; None if all faces are flat."""
    is_smooth = np.empty(len(mesh.polygons), dtype=bool)
    mesh.polygons.foreach_get("use_smooth", is_smooth)
    if not is_smooth.any():
        return None
    corners = np.empty(3 * len(mesh.loop_triangles), dtype=np.int32)
    mesh.loop_triangles.foreach_get("loops", corners)
    return compat.corner_normals(mesh)[corners].reshape(-1, 3, 3)
