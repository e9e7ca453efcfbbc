# SPDX-License-Identifier: GPL-3.0-or-later
"""`blender -b FILE -E FUMAROLE [-f N | -s N -e N -j N -a]` for a Blender that is a Python module: -- FILE [options].

Ends like Blender: exit code 1 when the engine reported an error.
"""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from pathlib import Path

import bpy
import addon_utils

parser = argparse.ArgumentParser()
parser.add_argument("blend")
parser.add_argument("-f", type=int)
parser.add_argument("-s", type=int)
parser.add_argument("-e", type=int)
parser.add_argument("-j", type=int)
parser.add_argument("-a", action="store_true")
options = parser.parse_args(sys.argv[sys.argv.index("--") + 1 :])

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "blender_addon"))
status = 1
try:
    if addon_utils.enable("fumarole", default_set=True) is None:
        raise RuntimeError("the add-on could not be enabled")
    bpy.ops.wm.open_mainfile(filepath=options.blend)
    scene = bpy.context.scene
    scene.render.engine = "FUMAROLE"
    if options.a:
        scene.frame_start = options.s if options.s is not None else scene.frame_start
        scene.frame_end = options.e if options.e is not None else scene.frame_end
        scene.frame_step = options.j if options.j is not None else scene.frame_step
        bpy.ops.render.render(animation=True)
    else:
        scene.frame_set(options.f)
        scene.render.filepath = scene.render.frame_path(frame=options.f)
        bpy.ops.render.render(write_still=True)
    status = 0
except BaseException:
    traceback.print_exc()
sys.stdout.flush()
sys.stderr.flush()
os._exit(status)  # bpy 4.5 may hang in its exit handlers
