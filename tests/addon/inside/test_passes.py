# SPDX-License-Identifier: GPL-3.0-or-later
"""Passes that a view layer asks for: in the file, by the names that Blender and Cycles use."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes
from exr import stack

EXAMPLES = Path(__file__).resolve().parents[3] / "example_blends"


def stage() -> None:
    """A puff between the camera and a floor that looks at it from above, and two lights over both."""
    owner = scenes.emitter(count=300)
    owner.show_instancer_for_render = False
    owner.data.materials.append(scenes.material("Smoke", Density=4.0, Color=(0.8, 0.8, 0.8, 1)))
    scenes.plane("Floor", size=8.0, location=(0, 0, -1.5))
    scenes.light("POINT", energy=800, location=(2, 0, 4)).name = "Key"
    scenes.light("SUN", energy=1.0, rotation=(20, 0, 0)).name = "Fill"
    scenes.camera(location=(0, 0, 8), rotation=(0, 0, 0))
    bpy.context.scene.render.film_transparent = True


def test_passes_are_off_by_default(tmp_path: Path) -> None:
    stage()
    layer = bpy.context.view_layer.name
    names = {name.rsplit(".", 1)[0] for name in scenes.render_channels(tmp_path)}
    assert {name for name in names if name.startswith(layer)} == {f"{layer}.Combined"}


def test_switches_of_blender(tmp_path: Path) -> None:
    stage()
    view_layer = bpy.context.view_layer
    view_layer.use_pass_position = view_layer.use_pass_emit = view_layer.use_pass_shadow = True
    channels = scenes.render_channels(tmp_path)
    shadow = stack(channels, f"{view_layer.name}.Shadow", "RGB")
    assert 0 < shadow.min() < 0.7
    assert shadow[0, 0] == pytest.approx(1.0, abs=0.02)
    assert np.abs(stack(channels, f"{view_layer.name}.Emit", "RGB")).max() == 0
    position = stack(channels, f"{view_layer.name}.Position", "XYZ")
    assert position[0, 0, 2] == pytest.approx(-1.5, abs=1e-3)


def test_lights_add_up_to_combined(tmp_path: Path) -> None:
    stage()
    view_layer = bpy.context.view_layer
    view_layer.fumarole.use_pass_lights = True
    channels = scenes.render_channels(tmp_path)
    parts = [stack(channels, f"{view_layer.name}.Light {name}", "RGB") for name in ("Key", "Fill")]
    combined = stack(channels, f"{view_layer.name}.Combined", "RGB")
    assert all(part.max() > 1e-3 for part in parts)
    assert np.abs(sum(parts) - combined).max() < 2e-3 * combined.max()  # the file may hold half floats


def test_shadows_of_lights(tmp_path: Path) -> None:
    stage()
    view_layer = bpy.context.view_layer
    view_layer.fumarole.use_pass_light_shadows = True
    channels = scenes.render_channels(tmp_path)
    key, fill = (stack(channels, f"{view_layer.name}.Shadow {name}", "RGB") for name in ("Key", "Fill"))
    assert key.min() < 0.7 and fill.min() < 0.7
    assert np.abs(key - fill).max() > 0.1, "they fall on different places"


def test_light_groups_have_cycles_names(tmp_path: Path) -> None:
    stage()
    view_layer = bpy.context.view_layer
    for name in ("warm", "empty"):
        view_layer.lightgroups.add().name = name
    bpy.data.objects["Key"].lightgroup = "warm"
    view_layer.fumarole.use_pass_lights = True
    channels = scenes.render_channels(tmp_path)
    warm = stack(channels, f"{view_layer.name}.Combined_warm", "RGB")
    assert np.array_equal(warm, stack(channels, f"{view_layer.name}.Light Key", "RGB"))
    assert np.abs(stack(channels, f"{view_layer.name}.Combined_empty", "RGB")).max() == 0


def test_a_light_that_shines_on_no_smoke_has_an_empty_pass(tmp_path: Path) -> None:
    stage()
    bpy.data.objects["Fill"].data.energy = 0.0
    view_layer = bpy.context.view_layer
    view_layer.fumarole.use_pass_lights = view_layer.fumarole.use_pass_light_shadows = True
    channels = scenes.render_channels(tmp_path)
    assert np.abs(stack(channels, f"{view_layer.name}.Light Fill", "RGB")).max() == 0
    assert (stack(channels, f"{view_layer.name}.Shadow Fill", "RGB") == 1).all()


@pytest.mark.parametrize("name", ["lights", "composite"])
def test_example_is_composed(name: str, tmp_path: Path) -> None:
    """The file renders, and what its compositor makes of the passes is not what is muted in it."""
    bpy.ops.wm.open_mainfile(filepath=str(EXAMPLES / f"{name}.blend"))
    scene = bpy.context.scene
    for other in bpy.data.scenes:
        other.render.resolution_percentage = 10
        other.cycles.samples = 4
    tree = getattr(scene, "compositing_node_group", None) or scene.node_tree
    pictures = []
    for is_mute in (False, True):
        for node in tree.nodes:
            node.mute = is_mute and (node.name == "Shadow" or node.name.startswith("Gain"))
        scene.render.filepath = str(tmp_path / f"{is_mute}.png")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        pictures.append(np.array(image.pixels[:]).reshape(-1, 4)[:, :3])
    assert all(picture.max() > 0.2 for picture in pictures)
    assert np.abs(pictures[0] - pictures[1]).max() > 0.1
