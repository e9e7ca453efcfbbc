# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes the pictures of cinematic.blend in docs/pictures, plain, with motion blur and with depth of field, from the top of the
checkout after a ./run command has built the library:
FUMAROLE_PICTURES=/dev/null blender -b --factory-startup --python scripts/blender_checkout.py \\
  example_blends/cinematic.blend --python example_blends/cinematic_pictures.py
"""

from __future__ import annotations

from pathlib import Path

import bpy

PICTURES = Path(__file__).resolve().parent.parent / "docs" / "pictures"
PERCENTAGE = 60

# Motion blur, depth of field, blur samples: the wheel's edge in steps of about two pixels; what is out of focus here
# are lamps and embers, which one pass shows.
LOOKS = {"plain": (False, False, 1), "motion": (True, False, 6), "focus": (False, True, 1)}


def main() -> None:
    scene = bpy.context.scene
    scene.render.use_stamp_filename = False
    scene.render.resolution_percentage = PERCENTAGE
    for name, (has_motion, has_focus, samples) in LOOKS.items():
        scene.render.use_motion_blur = has_motion
        scene.camera.data.dof.use_dof = has_focus
        scene.fumarole.blur_samples = samples
        scene.render.filepath = str(PICTURES / f"cinematic_{name}.png")
        bpy.ops.render.render(write_still=True)


main()
