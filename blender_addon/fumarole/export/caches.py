# SPDX-License-Identifier: GPL-3.0-or-later
"""Caches of simulations: what is missing of them, or was never simulated, makes smoke and solids stand elsewhere."""

from __future__ import annotations

import os
import re

import bpy

from .nodes import Warn


def check_point_cache(
    cache: bpy.types.PointCache, owner: bpy.types.Object, name: str, what: str, scene: bpy.types.Scene, warn: Warn
) -> None:
    """Warns of an evaluated object's cache that doesn't hold what the frame needs. `what` is wrong then.

    The texts are those of every frame, so that an animation says each once.
    """
    if cache.use_external:
        folder = bpy.path.abspath(cache.filepath, library=_library(owner, cache))
        _check_files(cache, owner, folder, name, what, warn)
    elif cache.is_baked:
        if cache.use_disk_cache:
            _check_files(cache, owner, _disk_folder(owner, cache), name, what, warn)
    elif cache.is_frame_skip or _held(cache) < _wanted(cache, scene):
        warn(
            f"{name} isn't baked and wasn't played from its first frame, {cache.frame_start}: its {what} are inexact. "
            "Bake it"
        )


def check_modifiers(owner: bpy.types.Object, scene: bpy.types.Scene, warn: Warn) -> None:
    """Warns of modifiers of an evaluated object that read files which aren't there, or caches as above."""
    for modifier in owner.modifiers:
        if not modifier.show_render:
            continue
        name = f"Modifier '{modifier.name}' of '{owner.name_full}'"
        if modifier.type in ("CLOTH", "SOFT_BODY"):
            check_point_cache(modifier.point_cache, owner, name, "points", scene, warn)
        elif modifier.type == "MESH_SEQUENCE_CACHE" and modifier.cache_file is not None:
            file = modifier.cache_file
            if not file.is_sequence:  # of those each frame has a file of its own, by rules of Blender's
                _check_file(bpy.path.abspath(file.filepath, library=file.library), name, warn)
        elif modifier.type == "MESH_CACHE" and modifier.filepath:
            _check_file(bpy.path.abspath(modifier.filepath, library=owner.library), name, warn)


def _check_file(path: str, name: str, warn: Warn) -> None:
    if not os.path.isfile(path):
        warn(f"{name}: there is no file '{path}', so that it does nothing")


def _check_files(
    cache: bpy.types.PointCache, owner: bpy.types.Object, folder: str, name: str, what: str, warn: Warn
) -> None:
    """Whether there is a file for each frame that is cached. Blender reads what there is and says nothing."""
    names = set(os.listdir(folder)) if os.path.isdir(folder) else set()
    stem = cache.name or owner.name.encode().hex().upper()
    # Files of others may have no number.
    index = rf"(_{cache.index:02d})?" if cache.use_external else f"_{cache.index:02d}"
    pattern = re.compile(rf"{re.escape(stem)}_(\d+){index}\.bphys")
    held = {int(found.group(1)) for found in map(pattern.fullmatch, names) if found}
    wanted = range(cache.frame_start, cache.frame_end + 1, max(1, cache.frame_step))
    missing = [frame for frame in wanted if frame not in held]
    if not held:
        warn(f"{name}: its cache has no files in '{folder}': its {what} are wrong")
    elif missing:
        warn(
            f"{name}: of {len(wanted)} frames of its cache {len(missing)} are missing in '{folder}', the first is "
            f"{missing[0]}: its {what} are inexact there"
        )


def _disk_folder(owner: bpy.types.Object, cache: bpy.types.PointCache) -> str:
    """Where Blender has the disk cache of a saved file."""
    library = _library(owner, cache)
    path = bpy.path.abspath(library.filepath) if library else bpy.data.filepath
    stem = os.path.splitext(os.path.basename(path))[0]
    return os.path.join(os.path.dirname(path), f"blendcache_{stem}")


def _library(owner: bpy.types.Object, cache: bpy.types.PointCache) -> bpy.types.Library | None:
    return owner.original.library if cache.use_library_path else None


def _held(cache: bpy.types.PointCache) -> int:
    """The number of frames in the cache, which its description begins with in any language; many where it has none."""
    found = re.match(r"\d+", cache.info)
    return int(found.group()) if found else 1 << 31


def _wanted(cache: bpy.types.PointCache, scene: bpy.types.Scene) -> int:
    """The number of frames that it holds once it was played to this one."""
    frame = min(scene.frame_current, cache.frame_end)
    return (frame - cache.frame_start) // max(1, cache.frame_step) + 1
