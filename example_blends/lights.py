# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes lights.blend beside itself, after a ./run command has built the library:
blender -b --factory-startup --python scripts/blender_checkout.py --python example_blends/lights.py

docs/pictures/lights_regraded.png, and lights.png, in which no light is changed, from the top of the checkout:
for name in lights lights_regraded; do ./run render example_blends/lights.blend -o "$PWD/out/${name}_####" \\
  --python-expr "import bpy; bpy.context.scene.render.use_stamp_filename = False
for node in bpy.context.scene.node_tree.nodes: node.mute = '$name' == 'lights' and node.name.startswith('Gain')" -f 1 &&
  cp out/${name}_0001.png docs/pictures/$name.png; done

A puff under three lights, each of which has a pass of its own. The compositor multiplies each pass with a colour and adds
them up: the lights' colours and strengths are changed without rendering again.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
from mathutils import Matrix, Vector

sys.path.insert(0, str(Path(__file__).parent))
from staging import add_light, add_object, add_puff, looking  # noqa: E402

# Power (W), colour, place, and the factors by which the compositor changes its pass.
LIGHTS = {
    "Key": (2200.0, (1.0, 0.95, 0.9), (3.5, -3.5, 4.0), (0.15, 0.3, 0.9)),
    "Fill": (700.0, (0.9, 0.95, 1.0), (-4.5, -2.5, 1.5), (0.4, 0.9, 0.6)),
    "Back": (2200.0, (1.0, 1.0, 1.0), (-1.5, 4.5, 3.0), (2.2, 0.7, 0.2)),
}


def add_stage() -> None:
    add_puff("Puff", Vector((0.0, 0.0, 0.0)))
    for name, (power, color, place, _gain) in LIGHTS.items():
        add_light(name, "POINT", power, color, Matrix.Translation(place))
    camera = bpy.data.cameras.new("Camera")
    camera.lens = 95.0
    bpy.context.scene.camera = add_object("Camera", camera, looking(Vector((0.0, -7.5, 0.8)), Vector((-0.2, 0.0, 0.12))))


def set_scene() -> None:
    scene = bpy.context.scene
    scene.render.engine = "FUMAROLE"
    scene.frame_start = scene.frame_end = scene.frame_current = 1
    scene.render.resolution_x = scene.render.resolution_y = 540
    scene.render.film_transparent = True
    scene.view_settings.view_transform = "Filmic"
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.compression = "PNG", "RGB", 100
    bpy.context.view_layer.update()
    bpy.context.view_layer.fumarole.use_pass_lights = True


def compose() -> None:
    """The sum of the lights' passes, each times its factors."""
    scene = bpy.context.scene
    scene.use_nodes = True
    tree = scene.node_tree
    tree.nodes.clear()
    layers, result = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeComposite")
    total = None
    for number, (name, (_power, _color, _place, gain)) in enumerate(LIGHTS.items()):
        factor = tree.nodes.new("CompositorNodeMixRGB")
        factor.name = factor.label = f"Gain {name}"
        factor.blend_type, factor.location = "MULTIPLY", (300, -200 * number)
        factor.inputs[2].default_value = (*gain, 1.0)
        tree.links.new(layers.outputs[f"Light {name}"], factor.inputs[1])
        if total is None:
            total = factor.outputs[0]
            continue
        both = tree.nodes.new("CompositorNodeMixRGB")
        both.blend_type, both.location = "ADD", (300 + 200 * number, -100 * number)
        tree.links.new(total, both.inputs[1])
        tree.links.new(factor.outputs[0], both.inputs[2])
        total = both.outputs[0]
    result.location = (900, 0)
    tree.links.new(total, result.inputs["Image"])


def main() -> None:
    if bpy.app.version[:2] != (3, 4):
        raise SystemExit(f"Blender {bpy.app.version_string} would write a file that 3.4 can't read: use 3.4")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    add_stage()
    set_scene()
    compose()
    bpy.ops.wm.save_as_mainfile(filepath=str(Path(__file__).with_suffix(".blend")), compress=True)


main()
