# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes composite.blend beside itself: blender -b --factory-startup --python example_blends/composite.py

docs/pictures/composite.png, and composite_without.png, in which the shadow pass isn't multiplied, from the top of the
checkout:
for name in composite composite_without; do ./run render example_blends/composite.blend -o "$PWD/out/${name}_####" \\
  --python-expr "import bpy; bpy.context.scene.render.use_stamp_filename = False
bpy.context.scene.node_tree.nodes['Shadow'].mute = '$name' == 'composite_without'" -f 1 &&
  cp out/${name}_0001.png docs/pictures/$name.png; done

Two scenes with the same objects. Cycles renders the solids of one, Fumarole the smoke of the other, cut where a solid is
in front, and its shadow on the solids. The compositor of the smoke's scene multiplies the solids with the shadow and puts
the smoke over them.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
from mathutils import Matrix, Vector

sys.path.insert(0, str(Path(__file__).parent))
from staging import FumaroleName, add_light, add_object, add_puff, box_mesh, looking, matt_material  # noqa: E402

EYE = Vector((0.4, -9.0, 3.4))


def add_solids() -> None:
    """A floor, a slab that stands in the smoke, and posts before and behind it, all matt: light that they reflect on to one
    another is what the shadow pass doesn't know."""
    solids = {
        "Floor": ((0.42, 0.4, 0.38), [(Vector((0, 0, -0.05)), Vector((40, 40, 0.1)))]),
        "Slab": ((0.55, 0.2, 0.12), [(Vector((0.9, 0.1, 0.9)), Vector((0.35, 1.4, 1.8)))]),
        "Posts": (
            (0.12, 0.3, 0.42),
            [(Vector((x, y, 0.75)), Vector((0.22, 0.22, 1.5))) for x, y in ((-1.3, -1.1), (-1.9, 1.3), (1.9, 1.6))],
        ),
    }
    for name, (color, boxes) in solids.items():
        mesh = box_mesh(name, boxes)
        mesh.materials.append(matt_material(name, color))
        add_object(name, mesh, Matrix())


def add_lights() -> None:
    """A warm key from the right and a cool one from behind; both with a size, so that shadows are soft."""
    key = add_light("Key", "POINT", 1500.0, (1.0, 0.86, 0.7), Matrix.Translation((4.2, -3.2, 5.4)))
    rim = add_light("Rim", "POINT", 900.0, (0.5, 0.7, 1.0), Matrix.Translation((-4.6, 3.4, 4.2)))
    key.shadow_soft_size = rim.shadow_soft_size = 0.25


def smoke_scene() -> bpy.types.Scene:
    """The scene that is there, for Fumarole, with all that is in it."""
    scene = bpy.context.scene
    scene.name = "Smoke"
    camera = bpy.data.cameras.new("Camera")
    camera.lens = 50.0
    scene.camera = add_object("Camera", camera, looking(EYE, Vector((0.1, 0.0, 0.95))))
    bpy.utils.register_class(FumaroleName)
    scene.render.engine = "FUMAROLE"
    scene.view_layers[0].use_pass_shadow = True
    return scene


def solids_scene(smoke: bpy.types.Scene) -> bpy.types.Scene:
    """A scene of the same objects but for the smoke, for Cycles."""
    scene = bpy.data.scenes.new("Solids")
    for owner in smoke.collection.objects:
        if owner.name != "Puff":
            scene.collection.objects.link(owner)
    scene.camera = smoke.camera
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 256
    scene.cycles.use_denoising = False
    scene.cycles.max_bounces = 0
    return scene


def compose(smoke: bpy.types.Scene, solids: bpy.types.Scene) -> None:
    """The smoke over the solids, these in its shadow."""
    smoke.use_nodes = True
    tree = smoke.node_tree
    tree.nodes.clear()
    kinds = ("CompositorNodeRLayers",) * 2 + ("CompositorNodeMixRGB", "CompositorNodeAlphaOver", "CompositorNodeComposite")
    back, front, shadow, over, result = (tree.nodes.new(kind) for kind in kinds)
    back.scene, front.scene, shadow.name, shadow.blend_type = solids, smoke, "Shadow", "MULTIPLY"
    for node, x, y in ((back, 0, 200), (front, 0, -200), (shadow, 300, 150), (over, 550, 0), (result, 800, 0)):
        node.location = (x, y)
    tree.links.new(back.outputs["Image"], shadow.inputs[1])
    tree.links.new(front.outputs["Shadow"], shadow.inputs[2])
    tree.links.new(shadow.outputs["Image"], over.inputs[1])
    tree.links.new(front.outputs["Image"], over.inputs[2])
    tree.links.new(over.outputs["Image"], result.inputs["Image"])


def set_picture(scene: bpy.types.Scene) -> None:
    scene.frame_start = scene.frame_end = scene.frame_current = 1
    scene.world = bpy.data.worlds.get("Night") or bpy.data.worlds.new("Night")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    scene.render.resolution_x, scene.render.resolution_y = 960, 540
    scene.render.film_transparent = True
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.compression = "PNG", "RGB", 100
    scene.view_settings.view_transform = "Filmic"


def main() -> None:
    if bpy.app.version[:2] != (3, 4):
        raise SystemExit(f"Blender {bpy.app.version_string} would write a file that 3.4 can't read: use 3.4")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    add_puff("Puff", Vector((0.1, 0.2, 1.25)))
    add_solids()
    add_lights()
    smoke = smoke_scene()
    solids = solids_scene(smoke)
    for scene in (smoke, solids):
        set_picture(scene)
    compose(smoke, solids)
    bpy.ops.wm.save_as_mainfile(filepath=str(Path(__file__).with_suffix(".blend")), compress=True)


main()
