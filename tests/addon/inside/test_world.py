# SPDX-License-Identifier: GPL-3.0-or-later
"""The world: its light and its picture against Cycles of the same Blender, and what else belongs to a view layer."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes
from exr import read_exr, stack
from fumarole.export.image import read_picture, reduce
from test_lights import assert_like_cycles


def world(scene: bpy.types.Scene, color: tuple = (0.1, 0.2, 0.4), strength: float = 1.0) -> bpy.types.Node:
    """A new world's background node."""
    scene.world = bpy.data.worlds.new("Sky")
    scene.world.use_nodes = True
    background = next(node for node in scene.world.node_tree.nodes if node.bl_idname == "ShaderNodeBackground")
    background.inputs["Color"].default_value = (*color, 1)
    background.inputs["Strength"].default_value = strength
    return background


def sky(height: int = 16, width: int = 32) -> np.ndarray:
    """A smooth picture (height, width, 3) without symmetry: a warm spot in a blue sky above dark ground."""
    up = np.pi * ((np.arange(height) + 0.5) / height - 0.5)[:, None]
    around = np.pi - 2 * np.pi * ((np.arange(width) + 0.5) / width)[None, :]
    d = np.stack(np.broadcast_arrays(np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)), -1)
    spot = np.exp(8 * (d @ np.array([0.6, -0.48, 0.64]) - 1))[..., None]
    blue = (0.6 + 0.4 * d[..., 2:]) * np.array([0.1, 0.2, 0.5])
    return (blue + 2 * spot * np.array([1.0, 0.8, 0.4])).astype(np.float32)


def image(pixels: np.ndarray, is_float: bool = True) -> bpy.types.Image:
    """A packed image of (height, width, 3) values."""
    height, width = pixels.shape[:2]
    result = bpy.data.images.new("Around", width, height, float_buffer=is_float)
    result.pixels.foreach_set(np.dstack([pixels, np.ones((height, width))]).astype(np.float32).ravel())
    result.update()
    result.pack()
    return result


def textured(scene: bpy.types.Scene, picture: np.ndarray, rotation: tuple | None = None, **settings: object) -> bpy.types.Node:
    """A world with a picture, turned by a Mapping node, whose settings are given; returns the texture node."""
    background = world(scene, strength=1.5)
    tree = scene.world.node_tree
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = image(picture)
    tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    if rotation is not None:
        mapping, place = tree.nodes.new("ShaderNodeMapping"), tree.nodes.new("ShaderNodeTexCoord")
        mapping.inputs["Rotation"].default_value = rotation
        for name, value in settings.items():
            if name in ("Location", "Scale"):
                mapping.inputs[name].default_value = value
            else:
                setattr(mapping, name, value)
        tree.links.new(place.outputs["Generated"], mapping.inputs["Vector"])
        tree.links.new(mapping.outputs[0], texture.inputs["Vector"])
    return texture


def set_cycles(samples: int) -> None:
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples = samples
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.cycles.max_bounces = scene.cycles.volume_bounces = 0
    scene.cycles.device = "CPU"


def render(folder: Path) -> np.ndarray:
    """The current engine's picture (height, width, 4)."""
    scenes.exr_output(folder / "picture.exr")
    bpy.ops.render.render(write_still=True)
    return stack(read_exr(folder / "picture.exr"), "", "RGBA")


def test_no_world_is_black(scene: bpy.types.Scene) -> None:
    result = scenes.export()
    assert result.world is None and not result.lights
    assert not [text for text in result.warnings if "World" in text]


def test_a_colour_is_seen_and_shines(scene: bpy.types.Scene) -> None:
    background = world(scene, strength=3.0)
    result = scenes.export()
    assert np.allclose(result.world.color, (0.3, 0.6, 1.2))
    assert result.lights == [result.world] and result.world.light_sets is None
    assert not [text for text in result.warnings if "'Sky'" in text]
    background.inputs["Strength"].default_value = 0.0
    assert scenes.export().world is None


def test_world_without_nodes(scene: bpy.types.Scene) -> None:
    if bpy.app.version >= (5, 0, 0):
        pytest.skip("worlds always use nodes in this Blender")
    scene.world = bpy.data.worlds.new("Sky")
    scene.world.color = (0.5, 0.25, 0.125)
    assert np.allclose(scenes.export().world.color, (0.5, 0.25, 0.125))


def test_light_of_a_colour_is_that_of_cycles(scene: bpy.types.Scene, tmp_path: Path) -> None:
    world(scene, strength=3.0)
    assert_like_cycles(tmp_path)


def test_a_world_and_a_lamp_add_up(scene: bpy.types.Scene, tmp_path: Path) -> None:
    world(scene)
    scenes.light("POINT", location=(0.5, 0.2, 3), energy=30.0, shadow_soft_size=0.0)
    assert_like_cycles(tmp_path)


TURNS = {
    "as it is": (None, {}),
    "turned": ((0.4, 0.8, 1.9), {}),
    "texture": ((0.4, 0.8, 1.9), {"vector_type": "TEXTURE"}),
    "mirrored": ((0.0, 0.0, 0.7), {"Scale": (1.0, -1.0, 1.0)}),
}


@pytest.mark.parametrize("name", ["as it is", "turned"])
def test_light_of_a_picture_is_that_of_cycles(name: str, scene: bpy.types.Scene, tmp_path: Path) -> None:
    rotation, settings = TURNS[name]
    textured(scene, sky(), rotation, **settings)
    assert not [text for text in scenes.export().warnings if "'Sky'" in text]
    assert_like_cycles(tmp_path)


@pytest.mark.parametrize("name", TURNS)
def test_picture_behind_the_smoke_is_that_of_cycles(name: str, scene: bpy.types.Scene, tmp_path: Path) -> None:
    rotation, settings = TURNS[name]
    textured(scene, sky(), rotation, **settings)
    scenes.camera(location=(0, 0, 0), rotation=(70, 10, 25), lens=20)
    scenes.emitter(count=1).location = (0, 100, 0)
    scene.render.resolution_x = scene.render.resolution_y = 32
    ours = render(tmp_path)
    set_cycles(16)
    cycles = render(tmp_path)
    assert np.ptp(cycles[..., 0]) > 0.05
    assert np.abs(ours - cycles).max() < 0.02 * cycles.max() and np.abs(ours - cycles).mean() < 2e-3 * cycles.mean()


def lit_share(picture: np.ndarray) -> np.ndarray:
    """Radiance (3,) of thin smoke over its opacity."""
    seen = picture[..., 3] > 0.5 * picture[..., 3].max()
    return picture[seen][:, :3].sum(axis=0) / picture[seen][:, 3].sum()


def cycles_share(folder: Path, samples: int = 2048) -> np.ndarray:
    """The same of a thin cube of smoke in Cycles."""
    scene = bpy.context.scene
    mesh = bpy.data.meshes.new("Cube")
    corners = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
    mesh.from_pydata(corners, [], [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    cube = scenes.link("Cube", mesh)
    mesh.materials.append(scenes.material("Thin", "ShaderNodeVolumeScatter", Density=0.02, Anisotropy=0.4, Color=(0.7, 0.7, 0.7, 1)))
    engine = scene.render.engine
    set_cycles(samples)
    # Light that is met by scattering counts as a bounce.
    scene.cycles.max_bounces = scene.cycles.volume_bounces = 1
    result = lit_share(render(folder))
    scene.render.engine = engine
    bpy.data.objects.remove(cube)
    return result


def our_share(folder: Path) -> np.ndarray:
    owner = scenes.emitter(count=1, particle_size=0.6)
    owner.show_instancer_for_render = False
    owner.scale = (0.01, 0.01, 0.01)
    thin = scenes.material("Thin", "ShaderNodeVolumeScatter", Density=0.02, Anisotropy=0.4, Color=(0.7, 0.7, 0.7, 1))
    owner.data.materials.append(thin)
    bpy.context.scene.frame_set(1)
    return lit_share(render(folder))


@pytest.mark.parametrize("is_textured", [False, True])
def test_smoke_is_lit_as_in_cycles(is_textured: bool, scene: bpy.types.Scene, tmp_path: Path) -> None:
    if is_textured:
        textured(scene, sky(), (0.4, 0.8, 1.9))
    else:
        world(scene, strength=2.0)
    scene.render.resolution_x = scene.render.resolution_y = 16
    scene.render.film_transparent = True
    scenes.camera(location=(0, -3, 0))
    expected = cycles_share(tmp_path)
    found = our_share(tmp_path)
    assert expected.max() > 0.05
    assert found == pytest.approx(expected, rel=0.03), (found, expected)


def test_a_world_that_volumes_do_not_see_lights_no_smoke(scene: bpy.types.Scene, tmp_path: Path) -> None:
    world(scene, strength=2.0)
    owner = scenes.emitter(count=1)
    scenes.plane("Floor", location=(0, 0, -2))
    scene.world.cycles_visibility.scatter = False
    result = scenes.export()
    assert all(item.light_set not in result.world.light_sets for item in result.particles)
    assert all(item.light_set in result.world.light_sets for item in result.meshes)
    scene.world.cycles_visibility.diffuse = False
    result = scenes.export()
    assert result.world is not None and not result.lights
    bpy.data.objects.remove(owner)
    scene.render.resolution_x = scene.render.resolution_y = 8
    scene.render.film_transparent = True
    scenes.camera(location=(0, -3, 0))
    assert cycles_share(tmp_path, samples=16).max() < 1e-6


def test_a_world_that_the_camera_does_not_see_is_black_behind_smoke(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """And shines all the same."""
    world(scene, strength=2.0)
    scenes.plane("Floor", location=(50, 0, 0))
    scenes.camera(location=(0, -3, 0))
    scene.render.resolution_x = scene.render.resolution_y = 8
    for is_seen in (True, False):
        scene.world.cycles_visibility.camera = is_seen
        scene.render.engine = "FUMAROLE"
        assert scenes.export().world.light_sets is None
        found = render(tmp_path)
        set_cycles(samples=1)
        assert found == pytest.approx(render(tmp_path), rel=1e-3)
        assert (found[..., :3].max() > 0) == is_seen


def test_8_bit_colours_become_linear(scene: bpy.types.Scene) -> None:
    values = np.array([0, 0.02, 0.5, 0.75, 1], dtype=np.float32)
    texture = textured(scene, np.zeros((1, 1, 3)))
    texture.image = image(np.repeat(values[None, :, None], 3, axis=2), is_float=False)
    rounded = np.round(values * 255) / 255
    linear = np.where(rounded <= 0.04045, rounded / 12.92, ((rounded + 0.055) / 1.055) ** 2.4)
    assert scenes.export().world.picture[0, :, 1] == pytest.approx(linear, abs=1e-5)
    texture.image.colorspace_settings.name = "Non-Color"
    assert scenes.export().world.picture[0, :, 1] == pytest.approx(rounded, abs=1e-5)


def test_large_pictures_keep_their_light() -> None:
    picture = np.random.default_rng(1).random((37, 75, 3)).astype(np.float32)
    angles = np.diff(np.sin(np.pi * (np.arange(38) / 37 - 0.5)))[:, None, None]
    small = reduce(picture, 25)
    assert small.shape == (13, 25, 3)
    rows = np.append(np.arange(0, 37, 3), 37)
    small_angles = np.diff(np.sin(np.pi * (rows / 37 - 0.5)))[:, None, None]
    assert (small * small_angles).mean(axis=1).sum(axis=0) == pytest.approx((picture * angles).mean(axis=1).sum(axis=0), rel=1e-5)


def warned(words: str) -> bool:
    return any("'Sky'" in text and words in text for text in scenes.export().warnings)


def test_what_is_not_supported_is_named(scene: bpy.types.Scene) -> None:
    texture = textured(scene, sky(), (0, 0, 1))
    assert not warned("")
    tree = scene.world.node_tree
    mapping = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeMapping")
    mapping.inputs["Location"].default_value = (0, 0, 1)
    assert warned("'Mapping' moves or stretches")
    mapping.inputs["Location"].default_value = (0, 0, 0)
    texture.projection = "MIRROR_BALL"
    assert warned("MIRROR_BALL") and scenes.export().world is None
    texture.projection = "EQUIRECTANGULAR"
    texture.image = None
    assert warned("'Environment Texture' has no image")
    background = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeBackground")
    other = tree.nodes.new("ShaderNodeTexSky")
    tree.links.new(other.outputs[0], background.inputs["Color"])
    assert warned("'Sky Texture'") and np.allclose(scenes.export().world.color, (0.15, 0.3, 0.6))
    mix = tree.nodes.new("ShaderNodeMixShader")
    output = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputWorld")
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    assert warned("'Mix Shader'") and scenes.export().world is None


def test_negative_light_and_pixels_are_named(scene: bpy.types.Scene) -> None:
    world(scene, strength=-1.0)
    assert warned("negative light") and scenes.export().world is None
    picture = np.full((4, 8, 3), -0.5, np.float32) + np.arange(8)[:, None]
    found: list[str] = []
    assert read_picture(image(picture), "Sky", found.append).min() == 0
    assert "negative or not finite" in found[0]


def test_passes_and_groups_of_the_world(scene: bpy.types.Scene, tmp_path: Path) -> None:
    world(scene)
    view_layer = bpy.context.view_layer
    group = view_layer.lightgroups.add(name="Around")
    scene.world.lightgroup = group.name
    scenes.light("SUN", energy=1.0)
    owner = scenes.emitter(count=100)
    owner.data.materials.append(scenes.material("Smoke", Density=4.0))
    scenes.camera(location=(0, -6, 0))
    scene.render.film_transparent = True
    scene.render.resolution_x = scene.render.resolution_y = 32
    view_layer.fumarole.use_pass_lights = True
    channels = scenes.render_channels(tmp_path)
    parts = {name: stack(channels, f"{view_layer.name}.{name}", "RGB") for name in ("Light Sun", "Light World", "Combined_Around")}
    combined = stack(channels, f"{view_layer.name}.Combined", "RGB")
    assert parts["Light World"].max() > 1e-3 and parts["Light Sun"].max() > 1e-3
    assert np.array_equal(parts["Light World"], parts["Combined_Around"])
    assert np.abs(parts["Light Sun"] + parts["Light World"] - combined).max() < 1e-4 * combined.max()


def test_a_layer_without_sky_has_no_world(scene: bpy.types.Scene) -> None:
    world(scene)
    bpy.context.view_layer.use_sky = False
    result = scenes.export()
    assert result.world is None and not result.lights


def test_material_override_is_named(scene: bpy.types.Scene) -> None:
    bpy.context.view_layer.material_override = bpy.data.materials.new("Clay")
    assert any("material_override" in text for text in scenes.export().warnings)
