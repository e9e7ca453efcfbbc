# SPDX-License-Identifier: GPL-3.0-or-later
"""Run inside Blender: -- ZIP PICTURE. Installs the zip as a user would and renders a picture with it."""

from __future__ import annotations

import os
import sys
import traceback
from pathlib import Path

import bpy
import addon_utils

HERE = Path(__file__).resolve().parent
package, picture = sys.argv[-2:]
status = 1
try:
    if bpy.app.version >= (4, 2, 0):
        addon_utils.extensions_refresh()
        bpy.ops.extensions.package_install_files(filepath=package, repo="user_default", enable_on_install=True)
        name = "bl_ext.user_default.fumarole"
    else:
        bpy.ops.preferences.addon_install(filepath=package)
        bpy.ops.preferences.addon_enable(module="fumarole")
        name = "fumarole"
    module = sys.modules[name]
    print("INSTALLED", module.__file__, flush=True)
    # The test's own helpers import the add-on by its plain name.
    for key in [key for key in sys.modules if key == name or key.startswith(name + ".")]:
        sys.modules["fumarole" + key[len(name) :]] = sys.modules[key]
    sys.path[:0] = [str(HERE / "inside"), str(HERE)]
    import scenes

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    scene.render.engine = "FUMAROLE"
    scene.render.resolution_x = scene.render.resolution_y = 64
    scene.render.film_transparent = True
    scenes.emitter(particle_size=0.3)
    scenes.plane("Wall", size=1, location=(0, -3, 0), rotation=(90, 0, 0))
    scenes.light()
    scenes.camera()
    scenes.exr_output(Path(picture), multilayer=True)
    bpy.ops.render.render(write_still=True)
    library = sys.modules[f"{name}.core._library"].library()
    print("LIBRARY", library._name, flush=True)
    status = 0
except BaseException:
    traceback.print_exc()
sys.stdout.flush()
sys.stderr.flush()
os._exit(status)
