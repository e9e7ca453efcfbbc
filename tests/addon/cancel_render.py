# SPDX-License-Identifier: GPL-3.0-or-later
"""Run inside Blender: -- PICTURE. Says when a long render starts and what came of it."""

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

bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
scene = bpy.context.scene
scene.render.engine = "FUMAROLE"
scenes.emitter(count=200_000, particle_size=0.3)
scenes.light("AREA", size=3.0)
scenes.camera()
scene.fumarole.light_samples = 1024
scenes.exr_output(Path(sys.argv[-1]), multilayer=True)
bpy.app.handlers.render_pre.append(lambda *_: print("RENDER STARTS", flush=True))
try:
    outcome = str(bpy.ops.render.render(write_still=True))
except BaseException as error:
    outcome = f"{type(error).__name__}: {error}"
print("OUTCOME", outcome, flush=True)
os._exit(0)
