# SPDX-License-Identifier: GPL-3.0-or-later
"""Run inside Blender: -- BLEND PICTURES CAMERA SHUTTER. Saves a scene of baked smoke; CAMERA is its type or NONE, SHUTTER
the length of motion blur in frames, 0 for none."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import bpy
import addon_utils

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1] / "blender_addon"), str(HERE / "inside"), str(HERE)]
addon_utils.enable("fumarole", default_set=True)

import scenes  # noqa: E402

blend, pictures, kind, shutter = sys.argv[-4:]
bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
scene = bpy.context.scene
scene.render.resolution_x = scene.render.resolution_y = 64
scene.render.film_transparent = True
scene.frame_end = 12
owner = scenes.emitter()
owner.data.materials.append(scenes.material("Smoke", Density=8.0))
scenes.light("POINT", location=(0, -3, 4))
if float(shutter) > 0:
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, float(shutter)
    scene.fumarole.blur_samples = 3
if kind != "NONE":
    scenes.camera(type=kind)
scenes.bake()
scenes.exr_output(Path(pictures), multilayer=True)
bpy.ops.wm.save_as_mainfile(filepath=blend)
sys.stdout.flush()
os._exit(0)
