# SPDX-License-Identifier: GPL-3.0-or-later
"""Run inside Blender: -- FOLDER FRAMES [WORD...]. Renders an animation and prints "RSS FRAME KIB" after each frame.

Particles are born, move and die, the camera moves. Words: opengl; persistent (Persistent Data); deep (and deep files).
"""

from __future__ import annotations

import os
import sys
import traceback
from pathlib import Path

import bpy
import addon_utils

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1] / "blender_addon"), str(HERE / "inside"), str(HERE)]
addon_utils.enable("fumarole", default_set=True)

import scenes  # noqa: E402


def resident_kib() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") // 1024


def main(folder: Path, frames: int, words: set[str]) -> None:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    scene.render.engine = "FUMAROLE"
    # Larger with OpenGL, so that what is lost would show beside what Mesa takes and gives back.
    scene.render.resolution_x = scene.render.resolution_y = 256 if "opengl" in words else 128
    scene.render.use_persistent_data = "persistent" in words
    scene.frame_end = frames
    # As many live in every frame.
    owner = scenes.emitter(count=10 * (frames + 50), frame_start=-50, frame_end=frames, lifetime=50)
    owner.data.materials.append(scenes.material("Smoke", Density=8.0))
    scenes.plane("Wall", location=(1, 0, 1), rotation=(0, 90, 0))
    scenes.light("POINT", location=(0, -3, 4))
    camera = scenes.camera()
    for frame, x in ((1, -2.0), (frames, 2.0)):
        camera.location.x = x
        camera.keyframe_insert("location", frame=frame)
    scene.fumarole.device = "GL" if "opengl" in words else "TILES"
    scene.fumarole.use_deep = "deep" in words
    scene.fumarole.deep_path = str(folder / "deep_####.exr")
    scenes.exr_output(folder / "####", multilayer=True)
    scenes.bake()

    @bpy.app.handlers.persistent
    def tell(*_arguments: object) -> None:
        print("RSS", scene.frame_current, resident_kib(), flush=True)

    bpy.app.handlers.render_post.append(tell)
    bpy.ops.render.render(animation=True)


status = 1
try:
    words = sys.argv[sys.argv.index("--") + 1 :]
    main(Path(words[0]), int(words[1]), set(words[2:]))
    status = 0
except BaseException:
    traceback.print_exc()
sys.stdout.flush()
os._exit(status)
