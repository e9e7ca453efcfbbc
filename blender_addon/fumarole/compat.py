# SPDX-License-Identifier: GPL-3.0-or-later
"""What differs between Blender versions, by feature. No other module looks at the version."""

from __future__ import annotations

import bpy
import numpy as np

# Whose light units hold: core.Scene.add_light converts those of any version.
LIGHT_UNITS = bpy.app.version

# In Blender 3 a pass's pixels are set as (pixels, channels), later as one row of floats.
_PASS_RECT_IS_2D = bpy.app.version < (4, 0, 0)

# Materials and worlds always use nodes from Blender 5 on, where asking for it is deprecated.
_MATERIALS_ALWAYS_USE_NODES = bpy.app.version >= (5, 0, 0)

# Newer file selectors make a path absolute that doesn't say that it may be relative to the file.
FILE_PATH_OPTIONS = {"ANIMATABLE", "PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5, 0) else {"ANIMATABLE"}


def light_casts_shadows(light: bpy.types.Light) -> bool:
    """Whether solids and smoke block the light in Cycles."""
    cycles = getattr(light, "cycles", None)
    return getattr(cycles, "cast_shadow", True) if hasattr(cycles, "cast_shadow") else light.use_shadow


def light_scale(light: bpy.types.Light) -> tuple[float, float, float]:
    """Factors on a light's power per channel: exposure and colour temperature, where this Blender has them."""
    exposure = 2.0 ** getattr(light, "exposure", 0.0)
    tint = light.temperature_color if getattr(light, "use_temperature", False) else (1.0, 1.0, 1.0)
    return tuple(exposure * channel for channel in tint)


def light_is_normalized(light: bpy.types.Light) -> bool:
    """Whether the light's power is independent of its size."""
    return getattr(light, "normalize", True)


def light_is_sphere(light: bpy.types.Light) -> bool:
    """Whether a point or spot light with a radius is a sphere (soft fall-off disabled), not a disc."""
    return not getattr(light, "use_soft_falloff", True)


def motion_blur(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> bool:
    """Whether a view layer is rendered with motion blur."""
    return scene.render.use_motion_blur and getattr(layer, "use_motion_blur", True)


def shutter_settings(scene: bpy.types.Scene) -> bpy.types.bpy_struct | None:
    """What has the property `motion_blur_position`; None where only Cycles has it, and its add-on is off."""
    if hasattr(scene.render, "motion_blur_position"):
        return scene.render
    return getattr(scene, "cycles", None)


def shutter_is_rolling(scene: bpy.types.Scene) -> bool:
    """Whether Cycles would open the shutter row by row."""
    return getattr(getattr(scene, "cycles", None), "rolling_shutter_type", "NONE") != "NONE"


def linked_collections(owner: bpy.types.Object) -> tuple[bpy.types.Collection | None, bpy.types.Collection | None]:
    """The collections of what a light shines on and of what blocks it; None: everything, as before Blender 4."""
    linking = getattr(owner.original, "light_linking", None)
    return (None, None) if linking is None else (linking.receiver_collection, linking.blocker_collection)


def corner_normals(mesh: bpy.types.Mesh) -> np.ndarray:
    """The normals (n, 3) float32 of all faces' corners, smooth where the mesh is."""
    normals = np.empty(3 * len(mesh.loops), dtype=np.float32)
    if hasattr(mesh, "corner_normals"):
        mesh.corner_normals.foreach_get("vector", normals)
    else:  # before Blender 4.1
        mesh.calc_normals_split()
        mesh.loops.foreach_get("normal", normals)
    return normals.reshape(-1, 3)


def node_tree(owner: bpy.types.Material | bpy.types.World) -> bpy.types.NodeTree | None:
    """The shader nodes in use, or None."""
    return owner.node_tree if _MATERIALS_ALWAYS_USE_NODES or owner.use_nodes else None


def set_pass_pixels(render_pass: bpy.types.RenderPass, pixels: np.ndarray) -> None:
    """Fills a pass from (height, width, channels) float32, first row at the bottom."""
    pixels = np.ascontiguousarray(pixels, dtype=np.float32)
    render_pass.rect.foreach_set(pixels.reshape(-1, pixels.shape[-1]) if _PASS_RECT_IS_2D else pixels.reshape(-1))


def aov_name(node: bpy.types.Node) -> str:
    """What an AOV Output node writes to."""
    return getattr(node, "aov_name", node.name)
