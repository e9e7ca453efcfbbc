# SPDX-License-Identifier: GPL-3.0-or-later
"""Run inside Blender: -- FOLDER [WORD...]. Saves FOLDER/batch.blend, baked smoke of 12 frames with pictures, deep files
and files of an Output node in FOLDER.

Words: keep (Overwrite off), placeholders, fails (the camera's clip range is wrong in frame 3), unbaked.
"""

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


def add_output_node(scene: bpy.types.Scene, folder: Path) -> None:
    """The picture goes through the compositor, where an Output node writes it into FOLDER/node as well."""
    if bpy.app.version >= (5, 0, 0):
        tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
        scene.compositing_node_group = tree
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        end, output = tree.nodes.new("NodeGroupOutput"), tree.nodes.new("CompositorNodeOutputFile")
        output.directory, output.file_name = str(folder / "node"), "node_"
        output.format.media_type = "IMAGE"
        output.format.file_format = "OPEN_EXR"
        output.file_output_items.clear()
        output.file_output_items.new("RGBA", "")
    else:
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
        end, output = tree.nodes.new("CompositorNodeComposite"), tree.nodes.new("CompositorNodeOutputFile")
        output.base_path = str(folder / "node")
        output.format.file_format = "OPEN_EXR"
        output.file_slots[0].path = "node_"
    layers = tree.nodes.new("CompositorNodeRLayers")
    layers.scene = scene
    for node in (end, output):
        tree.links.new(layers.outputs["Image"], node.inputs[0])


def main(folder: Path, words: set[str]) -> None:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    scene.render.engine = "FUMAROLE"
    scene.render.resolution_x = scene.render.resolution_y = 32
    scene.render.film_transparent = True
    scene.frame_end = 12
    owner = scenes.emitter()
    owner.data.materials.append(scenes.material("Smoke", Density=8.0))
    owner.particle_systems[0].point_cache.frame_end = 12
    scenes.light("POINT", location=(0, -3, 4))
    camera = scenes.camera(clip_end=50)
    if "fails" in words:
        for frame, start in ((1, 0.1), (2, 0.1), (3, 60.0), (4, 0.1)):
            camera.data.clip_start = start
            camera.data.keyframe_insert("clip_start", frame=frame)
    if "unbaked" not in words:
        scenes.bake()
    scene.render.use_overwrite = "keep" not in words
    scene.render.use_placeholder = "placeholders" in words
    scene.fumarole.use_deep = True
    scene.fumarole.deep_path = "//deep_####.exr"
    add_output_node(scene, folder)
    scenes.exr_output(folder / "flat_####")
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "batch.blend"))


main(Path(sys.argv[sys.argv.index("--") + 1]), set(sys.argv[sys.argv.index("--") + 2 :]))
sys.stdout.flush()
os._exit(0)
