# SPDX-License-Identifier: GPL-3.0-or-later
"""Run inside Blender: enables the add-on of this checkout for this session and notes the pictures that are written.

The user's settings stay as they are; an installed copy of the add-on gives way for this session. The paths of pictures
are appended, a line each, to the file that the environment variable FUMAROLE_PICTURES names.
"""

import os
import sys
from pathlib import Path

import addon_utils
import bpy

ADDONS = Path(__file__).resolve().parent.parent / "blender_addon"


def enable_addon() -> None:
    if "fumarole" in sys.modules:
        addon_utils.disable("fumarole")
    for name in [name for name in sys.modules if name.partition(".")[0] == "fumarole"]:
        del sys.modules[name]
    sys.path.insert(0, str(ADDONS))
    if addon_utils.enable("fumarole") is None:
        raise RuntimeError(f"the add-on in {ADDONS} could not be enabled")


@bpy.app.handlers.persistent
def note_picture(scene: bpy.types.Scene, _unused: object = None) -> None:
    path = scene.render.frame_path(frame=scene.frame_current)
    with open(os.environ["FUMAROLE_PICTURES"], "a", encoding="utf-8") as pictures:
        pictures.write(bpy.path.abspath(path) + "\n")


enable_addon()
bpy.app.handlers.render_write.append(note_picture)
