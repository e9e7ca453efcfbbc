# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene's camera as a core.Camera."""

from __future__ import annotations

import bpy
import numpy as np

from .. import core
from .blur import export_aperture, export_shutter
from .nodes import Warn

_TYPES = {"PERSP": "PERSPECTIVE", "ORTHO": "ORTHOGRAPHIC"}


def export_camera(
    owner: bpy.types.Object,
    scene: bpy.types.Scene,
    layer: bpy.types.ViewLayer,
    matrix: np.ndarray,
    shift_x: float,
    warn: Warn,
) -> core.Camera:
    """The camera of an evaluated object, cropped to the render border, with the layer's shutter and its own aperture.

    `matrix` (4, 4) and `shift_x` are those of the view that is rendered, which in stereo are not the object's own.
    Raises core.FumaroleError for an object that is no camera and for panoramas.
    """
    lens, render = owner.data, scene.render
    name = f"Camera '{owner.name_full}'"
    if not isinstance(lens, bpy.types.Camera):
        kind = owner.type.lower()
        raise core.FumaroleError(core.ErrorCode.ARGUMENT, f"'{owner.name_full}' is set as camera but is a {kind}")
    if lens.type not in _TYPES:
        raise core.FumaroleError(core.ErrorCode.ARGUMENT, f"{name} is of type {lens.type}, which isn't supported")
    width, height = resolution(render)
    camera = core.Camera(
        matrix=matrix,
        lens=lens.lens,
        sensor=lens.sensor_width,
        sensor_height=lens.sensor_height,
        sensor_fit=lens.sensor_fit,
        width=width,
        height=height,
        type=_TYPES[lens.type],
        ortho_scale=lens.ortho_scale,
        shift=(shift_x, lens.shift_y),
        pixel_aspect=(render.pixel_aspect_x, render.pixel_aspect_y),
        clip=(lens.clip_start, lens.clip_end),
    ).blurred(export_shutter(scene, layer, warn), export_aperture(lens, matrix))
    return camera.crop(*border(render, width, height)) if render.use_border else camera


def resolution(render: bpy.types.RenderSettings) -> tuple[int, int]:
    """Width and height of the whole picture in pixels, after the percentage."""
    percentage = render.resolution_percentage
    return render.resolution_x * percentage // 100, render.resolution_y * percentage // 100


def border(render: bpy.types.RenderSettings, width: int, height: int) -> tuple[int, int, int, int]:
    """The border's pixels (x0, y0, x1, y1), rounded in single precision as Blender does."""
    edges = (render.border_min_x, render.border_min_y, render.border_max_x, render.border_max_y)
    return tuple(int(np.float32(edge) * np.float32(size)) for edge, size in zip(edges, (width, height, width, height)))
