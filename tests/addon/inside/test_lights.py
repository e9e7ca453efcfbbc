# SPDX-License-Identifier: GPL-3.0-or-later
"""Lights: their units against Cycles of the same Blender, and what is said about those that aren't modelled."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes
from exr import read_exr, stack
from fumarole import core
from fumarole.export.scene import build

# Width of the white plane's part that is compared, m, and the number of points along it.
SIZE = 4.0
PIXELS = 9


def cycles_irradiance(folder: Path) -> np.ndarray:
    """Irradiance (PIXELS, PIXELS, 3) of the plane z = 0 as Cycles renders it, at the pixels' centres."""
    scene = bpy.context.scene
    ground = scenes.plane("Ground", size=SIZE * 2)
    white = bpy.data.materials.new("White")
    white.use_nodes = True
    diffuse = white.node_tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (1, 1, 1, 1)
    output = next(node for node in white.node_tree.nodes if node.bl_idname == "ShaderNodeOutputMaterial")
    white.node_tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    ground.data.materials.append(white)
    scenes.camera(location=(0, 0, 10), rotation=(0, 0, 0), type="ORTHO", ortho_scale=SIZE)
    render = scene.render
    render.engine = "CYCLES"
    render.resolution_x = render.resolution_y = PIXELS
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "GAUSSIAN", 0.01
    scene.cycles.samples = 1024
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.use_denoising = False
    scene.cycles.max_bounces = 0
    scene.cycles.device = "CPU"
    scenes.exr_output(folder / "cycles.exr")
    bpy.ops.render.render(write_still=True)
    bpy.data.objects.remove(ground)
    return stack(read_exr(folder / "cycles.exr"), "", "RGB") * np.pi


def our_irradiance() -> np.ndarray:
    """The same through the exporter."""
    exported = scenes.export()
    centres = (np.arange(PIXELS) + 0.5) / PIXELS * SIZE - SIZE / 2
    x, y = np.meshgrid(centres, centres)
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    settings = core.Settings(light_samples=256)
    with core.Context() as context:
        scene = build(exported, context)
        lights = range(len(exported.lights))
        total = sum(core.irradiance(scene, points, light, (0, 0, 1), settings) for light in lights)
    return total.reshape(PIXELS, PIXELS, 3)


def assert_like_cycles(folder: Path, on_average: bool = False) -> None:
    """Within 1 % at every point, or only on average, where the few samples of a soft edge are visible."""
    expected = cycles_irradiance(folder)
    found = our_irradiance()
    if on_average:
        expected, found = expected.mean(axis=(0, 1)), found.mean(axis=(0, 1))
    assert expected.max() > 0
    assert np.allclose(found, expected, rtol=0.01, atol=0.01 * expected.mean()), (found / expected).round(3)


LIGHTS = {
    "point": ("POINT", {"shadow_soft_size": 0.0}),
    "large point": ("POINT", {"shadow_soft_size": 0.8}),
    "sun": ("SUN", {"energy": 3.0, "angle": 0.0}),
    "wide sun": ("SUN", {"energy": 3.0, "angle": 0.6}),
    "spot": ("SPOT", {"shadow_soft_size": 0.0, "spot_size": 1.2, "spot_blend": 0.6}),
    "narrow spot": ("SPOT", {"shadow_soft_size": 0.0, "spot_size": 0.7, "spot_blend": 1.0}),
    "large spot": ("SPOT", {"shadow_soft_size": 0.5, "spot_size": 1.2, "spot_blend": 0.6}),
    "square": ("AREA", {"shape": "SQUARE", "size": 1.5}),
    "rectangle": ("AREA", {"shape": "RECTANGLE", "size": 2.0, "size_y": 0.5}),
    "disk": ("AREA", {"shape": "DISK", "size": 1.5}),
    "ellipse": ("AREA", {"shape": "ELLIPSE", "size": 2.0, "size_y": 0.7}),
    "spread": ("AREA", {"shape": "SQUARE", "size": 1.0, "spread": 2.0}),
}


@pytest.mark.parametrize("name", LIGHTS)
def test_units_are_those_of_cycles(name: str, tmp_path: Path) -> None:
    kind, settings = LIGHTS[name]
    scenes.light(kind, location=(0.5, 0.2, 3), rotation=(15, -10, 30), color=(1, 0.5, 0.25), **settings)
    assert_like_cycles(tmp_path, on_average=name == "large spot")


@pytest.mark.parametrize("kind", ["POINT", "SPOT", "AREA"])
def test_scale_acts_as_in_cycles(kind: str, tmp_path: Path) -> None:
    owner = scenes.light(kind, location=(0.5, 0.2, 3), rotation=(15, -10, 30))
    if kind != "AREA":
        owner.data.shadow_soft_size = 0
    owner.scale = (1.5, 0.7, 1.2)
    assert_like_cycles(tmp_path)


@pytest.mark.parametrize("kind", ["POINT", "SPOT", "SUN", "AREA"])
def test_exposure_temperature_and_normalisation(kind: str, tmp_path: Path) -> None:
    data = scenes.light(kind, location=(0, 0, 3), energy=10.0).data
    if not hasattr(data, "normalize"):
        pytest.skip("this Blender's lights have no such settings")
    data.exposure = 1.5
    data.use_temperature, data.temperature = True, 3000
    data.normalize = False
    if kind == "SUN":
        data.angle = 0.5
    elif kind != "AREA":
        data.shadow_soft_size = 0.4
    assert_like_cycles(tmp_path, on_average=kind == "SPOT")


def test_emission_node_multiplies(tmp_path: Path) -> None:
    data = scenes.light("POINT", location=(0, 0, 3), shadow_soft_size=0.0).data
    data.use_nodes = True
    emission = next(node for node in data.node_tree.nodes if node.bl_idname == "ShaderNodeEmission")
    emission.inputs["Strength"].default_value = 2.5
    emission.inputs["Color"].default_value = (0.2, 0.4, 0.8, 1)
    assert_like_cycles(tmp_path)


def test_lights_of_instances(scene: bpy.types.Scene, tmp_path: Path) -> None:
    lamp = scenes.light("POINT", location=(0, 0, 3), shadow_soft_size=0.0)
    collection = bpy.data.collections.new("Lamps")
    scene.collection.objects.unlink(lamp)
    collection.objects.link(lamp)
    for x in (-1, 1):
        empty = scenes.link("Instance", None, location=(x, 0, 0))
        empty.instance_type, empty.instance_collection = "COLLECTION", collection
    assert_like_cycles(tmp_path)


def test_lights_that_reach_nothing_are_left_out(scene: bpy.types.Scene) -> None:
    scenes.light("POINT").hide_render = True
    unseen = scenes.light("POINT")
    unseen.visible_volume_scatter = unseen.visible_diffuse = False
    scenes.light("POINT", energy=0.0)
    scenes.light("AREA").data.cycles.is_portal = True
    assert not scenes.export().lights


def named(word: str) -> bool:
    return any("'Point'" in text and word in text for text in scenes.export().warnings)


def test_sphere_is_named(scene: bpy.types.Scene) -> None:
    data = scenes.light("POINT", shadow_soft_size=0.3).data
    if not hasattr(data, "use_soft_falloff"):
        pytest.skip("this Blender's lights are discs")
    assert not named("fall-off")
    data.use_soft_falloff = False
    assert named("fall-off")


def test_negative_light_is_off_and_named(scene: bpy.types.Scene) -> None:
    scenes.light("POINT", energy=-5.0)
    assert not scenes.export().lights
    assert named("negative")


def test_area_light_without_size_is_off_and_named(scene: bpy.types.Scene) -> None:
    owner = scenes.light("AREA")
    owner.name = "Point"
    owner.scale = (0, 1, 1)
    assert not scenes.export().lights
    assert named("scale of 0")


def test_unsupported_light_node_is_named(scene: bpy.types.Scene) -> None:
    data = scenes.light("POINT").data
    data.use_nodes = True
    emission = next(node for node in data.node_tree.nodes if node.bl_idname == "ShaderNodeEmission")
    falloff = data.node_tree.nodes.new("ShaderNodeLightFalloff")
    data.node_tree.links.new(falloff.outputs[0], emission.inputs["Strength"])
    assert named("'Light Falloff'")


def test_a_light_without_shadows_is_told_to_the_library(scene: bpy.types.Scene) -> None:
    lamp = scenes.light("POINT")
    assert scenes.export().lights[0].casts_shadows
    data = lamp.data
    if hasattr(getattr(data, "cycles", None), "cast_shadow"):
        data.cycles.cast_shadow = False
    else:
        data.use_shadow = False
    exported = scenes.export()
    assert not exported.lights[0].casts_shadows
    assert not [text for text in exported.warnings if "shadow" in text]
