# SPDX-License-Identifier: GPL-3.0-or-later
"""When the shutter is open, and what the aperture is like."""

from __future__ import annotations

import math

import bpy
import numpy as np

from .. import compat, core
from .nodes import Warn

# Cycles' limits on what it divides by.
_LEAST_FSTOP = 1e-5
_LEAST_FOCUS = 1e-5

# When the shutter opens, in its lengths from now.
_OPENS = {"START": 0.0, "CENTER": -0.5, "END": -1.0}


def export_shutter(scene: bpy.types.Scene, layer: bpy.types.ViewLayer, warn: Warn) -> tuple[float, float]:
    """When it opens and closes, in frames from now; (0, 0) without motion blur."""
    if not compat.motion_blur(scene, layer):
        return (0.0, 0.0)
    render = scene.render
    curve = render.motion_blur_shutter_curve.curves[0]
    if len({point.location[1] for point in curve.points}) > 1:
        warn("Motion blur: the shutter curve isn't supported; the shutter is open or closed")
    if compat.shutter_is_rolling(scene):
        warn("Motion blur: a rolling shutter isn't supported; all of the picture is exposed at once")
    settings = compat.shutter_settings(scene)
    opens = _OPENS[settings.motion_blur_position if settings else "CENTER"] * render.motion_blur_shutter
    return (opens, opens + render.motion_blur_shutter)


def export_aperture(lens: bpy.types.Camera, matrix: np.ndarray) -> core.Aperture:
    """The aperture of an evaluated camera at `matrix` (4, 4), as Cycles has it; of radius 0 without depth of field."""
    dof = lens.dof
    if not dof.use_dof:
        return core.Aperture()
    diameter = (1.0 if lens.type == "ORTHO" else lens.lens * 1e-3) / max(dof.aperture_fstop, _LEAST_FSTOP)
    blades = dof.aperture_blades if dof.aperture_blades >= 3 else 0
    # Cycles turns the polygon so that the middle of a side, not a corner, lies along x.
    rotation = dof.aperture_rotation + math.pi / blades if blades else 0.0
    return core.Aperture(
        radius=diameter / 2,
        focus=max(_focus_distance(dof, matrix), _LEAST_FOCUS),
        blades=blades,
        rotation=rotation,
        ratio=dof.aperture_ratio,
    )


def _focus_distance(dof: bpy.types.CameraDOFSettings, matrix: np.ndarray) -> float:
    """Along the camera's axis, m."""
    target = dof.focus_object
    if target is None:
        return dof.focus_distance
    place = target.matrix_world.copy()
    bone = target.pose.bones.get(dof.focus_subtarget) if target.pose else None
    if bone is not None:
        place = place @ bone.matrix
    away = matrix[:3, 3] - np.array(place.translation)
    return abs(float(matrix[:3, 2] @ away)) / float(np.linalg.norm(matrix[:3, 2]))
