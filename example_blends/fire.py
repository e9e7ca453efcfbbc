# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes fire.blend beside itself, after a ./run command has built the library:
blender -b --factory-startup --python example_blends/fire.py

docs/pictures/fire.png is its frame 30, from the top of the checkout:
./run render example_blends/fire.blend -o "$PWD/out/fire_####" --python-expr \\
  "import bpy; bpy.context.scene.render.use_stamp_filename = False" -f 30 && cp out/fire_0030.png docs/pictures/fire.png

Fire that turns into smoke, in one cloud of points with one material: each point has an attribute `age`, 0 when it leaves the
ground and 1 at its end, from which nodes of the material compute what it emits, how dense it is and its colour.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy
from mathutils import Matrix, Vector

sys.path.insert(0, str(Path(__file__).parent))
from fields import Fields  # noqa: E402
from staging import Attributes, FumaroleName, add_cloud, add_light, add_object, looking  # noqa: E402

FRAMES = (1, 60)
FRONT_FRAME = 30  # the one that the file opens at
TONGUES = 90
GRAINS = 700  # in a tongue
LIFE = 70.0  # frames from the ground to the end
HEIGHT = 4.2  # m


def fire_points(fields: Fields) -> Attributes:
    """Points that rise in tongues, drawn in above the ground and spread by what they meet higher up."""
    index, frame = fields.index(), fields.frame()
    tongue = (index / GRAINS).floor()
    clock = frame / LIFE + fields.random(tongue, 1, 0.0, 1.0) + fields.random(index, 2, 0.0, 0.12)
    cycle = clock.floor()
    age = clock - cycle
    tongue_id, grain_id = tongue + cycle * TONGUES, index + cycle * (TONGUES * GRAINS)

    height = HEIGHT * age**0.9 * fields.random(tongue_id, 3, 0.9, 1.1)
    neck = age.smoothstep(0.0, 0.25)
    girth = 0.5 - 0.24 * neck + 0.9 * age.smoothstep(0.2, 1.0)
    turn = fields.random(tongue_id, 4, 0.0, 2 * math.pi)
    out = girth * fields.random(tongue_id, 5, 0.0, 1.0) ** 0.5
    position = fields.vector(turn.cos() * out, turn.sin() * out, height)
    position += fields.direction(grain_id, 6) * ((0.06 + 0.34 * age) * fields.random(grain_id, 7, 0.0, 1.0) ** 0.5)
    travel = fields.vector(0.0, 0.0, frame * (HEIGHT / LIFE))
    for number, (size, amount) in enumerate(((0.9, 0.9), (0.4, 0.7), (0.18, 0.4))):
        time = frame * (0.02 * (number + 1))
        position += fields.noise((position - travel) * (1.0 / size), time) * (girth * amount)
    return {"position": position, "radius": 0.05 + 0.12 * age, "id": grain_id, "age": age}


def fire_material() -> bpy.types.Material:
    """Flames up to a third of the age, smoke from there on."""
    material = bpy.data.materials.new("Fire")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    volume, output = tree.nodes.new("ShaderNodeVolumePrincipled"), tree.nodes.new("ShaderNodeOutputMaterial")
    age = tree.nodes.new("ShaderNodeAttribute")
    age.attribute_name = "age"
    flames, density = tree.nodes.new("ShaderNodeValToRGB"), tree.nodes.new("ShaderNodeFloatCurve")
    stops = ((0.0, (0.5, 0.3, 0.12)), (0.08, (1.0, 0.42, 0.09)), (0.2, (0.7, 0.14, 0.015)), (0.36, (0.0, 0.0, 0.0)))
    ramp = flames.color_ramp
    while len(ramp.elements) < len(stops):
        ramp.elements.new(0.5)
    for element, (place, color) in zip(ramp.elements, stops):
        element.position, element.color = place, (*color, 1.0)
    curve = density.mapping.curves[0]
    for number, place in enumerate(((0.0, 0.05), (0.16, 0.15), (0.32, 1.0), (0.65, 0.6), (1.0, 0.0))):
        if number < len(curve.points) - 1 and number == 0:
            curve.points[0].location = place
        elif place[0] == 1.0:
            curve.points[-1].location = place
        else:
            curve.points.new(*place)
    density.mapping.update()
    dense = tree.nodes.new("ShaderNodeMath")
    dense.operation = "MULTIPLY"
    dense.inputs[1].default_value = 3.0
    for node, place in ((age, -1200), (flames, -900), (density, -900), (dense, -600), (volume, -300)):
        node.location = (place, 300 if node == flames else 0)
    volume.inputs["Color"].default_value = (0.35, 0.34, 0.33, 1.0)
    volume.inputs["Anisotropy"].default_value = 0.3
    volume.inputs["Emission Strength"].default_value = 5.0
    for start, end in (
        (age.outputs["Fac"], flames.inputs["Fac"]),
        (age.outputs["Fac"], density.inputs["Value"]),
        (flames.outputs["Color"], volume.inputs["Emission Color"]),
        (density.outputs["Value"], dense.inputs[0]),
        (dense.outputs[0], volume.inputs["Density"]),
        (volume.outputs["Volume"], output.inputs["Volume"]),
    ):
        tree.links.new(start, end)
    return material


def set_scene() -> None:
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = FRAMES
    scene.frame_current = FRONT_FRAME
    scene.render.resolution_x, scene.render.resolution_y = 540, 720
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.compression = "PNG", "RGB", 100
    scene.view_settings.view_transform = "Filmic"
    bpy.utils.register_class(FumaroleName)
    scene.render.engine = "FUMAROLE"


def main() -> None:
    if bpy.app.version[:2] != (3, 4):
        raise SystemExit(f"Blender {bpy.app.version_string} would write a file that 3.4 can't read: use 3.4")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    add_cloud("Fire", TONGUES * GRAINS, fire_points, fire_material())
    # The light of the flames on the smoke above, and of the sky.
    flames = add_light("Flames", "POINT", 500.0, (1.0, 0.4, 0.12), Matrix.Translation((0.0, 0.0, 1.3)))
    flames.shadow_soft_size = 0.6
    add_light("Sky", "SUN", 4.0, (0.55, 0.7, 1.0), looking(Vector((-4.0, -3.0, 4.0)), Vector()))
    camera = bpy.data.cameras.new("Camera")
    camera.lens = 60.0
    bpy.context.scene.camera = add_object("Camera", camera, looking(Vector((0.0, -11.5, 1.6)), Vector((0.0, 0.0, 2.25))))
    set_scene()
    bpy.ops.wm.save_as_mainfile(filepath=str(Path(__file__).with_suffix(".blend")), compress=True)


main()
