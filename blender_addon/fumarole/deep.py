# SPDX-License-Identifier: GPL-3.0-or-later
"""Deep OpenEXR files: which of them a render writes, and where."""

from __future__ import annotations

import os
import re

import bpy

from . import core
from .export.camera import border, resolution


def wanted_path(depsgraph: bpy.types.Depsgraph, view: str, is_animation: bool) -> str | None:
    """Path of the deep file of a view of the depsgraph's layer, None if there is to be none. As with Blender's own
    output, frames of an animation that are there already are kept unless Overwrite is on. Raises FumaroleError."""
    scene = depsgraph.scene
    if not scene.fumarole.use_deep:
        return None
    path = file_path(scene, depsgraph.view_layer_eval.name, view)
    return None if is_animation and not scene.render.use_overwrite and os.path.exists(path) else path


def file_path(scene: bpy.types.Scene, layer: str, view: str) -> str:
    """The pattern with the frame's number for the last # in the file's name (before its end where there are none), and
    behind it the layer's name if several are rendered, and the view's suffix. Raises FumaroleError."""
    pattern = scene.fumarole.deep_path
    if pattern.startswith("//") and not bpy.data.filepath:
        raise _error(pattern, "it is relative to the file, which isn't saved yet")
    folder, name = os.path.split(bpy.path.abspath(pattern))
    stem = name[:-4] if name.lower().endswith(".exr") else name
    if not stem:
        raise _error(pattern, "it names no file")
    return os.path.join(folder, f"{_numbered(stem, scene.frame_current)}{_suffix(scene, layer, view)}.exr")


def write(deep: core.Deep, path: str, render: bpy.types.RenderSettings) -> None:
    """Writes the file, whose folder is made where it is missing, as Blender does. Raises FumaroleError."""
    frame = None
    if render.use_border and not render.use_crop_to_border:
        width, height = resolution(render)
        frame = (width, height, *border(render, width, height)[:2])
    try:
        os.makedirs(os.path.dirname(path) or ".", exist_ok=True)
    except OSError as error:
        raise core.FumaroleError(core.ErrorCode.FILE, f"Deep EXR '{path}' can't be written: {error}") from None
    deep.write(path, frame)


def _numbered(stem: str, frame: int) -> str:
    """Blender's rule: the last run of # becomes the frame, with as many digits."""
    runs = list(re.finditer("#+", stem))
    start, end = runs[-1].span() if runs else (len(stem), len(stem))
    number = f"{abs(frame):0{(end - start) or 4}d}"
    return f"{stem[:start]}{'-' if frame < 0 else ''}{number}{stem[end:]}"


def _suffix(scene: bpy.types.Scene, layer: str, view: str) -> str:
    names = [bpy.path.clean_name(other.name) for other in scene.view_layers if other.use]
    mine = bpy.path.clean_name(layer)
    if names.count(mine) > 1:
        raise _error(scene.fumarole.deep_path, f"several view layers are called '{mine}' in the names of files")
    return (f"_{mine}" if len(names) > 1 else "") + (scene.render.views[view].file_suffix if view else "")


def _error(pattern: str, reason: str) -> core.FumaroleError:
    return core.FumaroleError(core.ErrorCode.ARGUMENT, f"Deep EXR '{pattern}': {reason}")
