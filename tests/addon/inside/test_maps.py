# SPDX-License-Identifier: GPL-3.0-or-later
"""The image that a material's AOV Output node named Map puts on its particles."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes
from fumarole import core
from fumarole.export.scene import build, fingerprint


def picture(height: int = 4, width: int = 6) -> np.ndarray:
    """Straight RGBA (height, width, 4), opaque at its left."""
    rng = np.random.default_rng(1)
    result = rng.uniform(0.1, 0.9, (height, width, 4)).astype(np.float32)
    result[:, 0, 3] = 1.0
    return result


def image(pixels: np.ndarray, name: str = "Wisp", is_float: bool = False, is_data: bool = True) -> bpy.types.Image:
    """A packed image; of floats, colours are kept multiplied by opacity, as Blender does with files."""
    height, width = pixels.shape[:2]
    result = bpy.data.images.new(name, width, height, alpha=True, float_buffer=is_float, is_data=is_data)
    stored = pixels.copy()
    if is_float:
        stored[..., :3] *= stored[..., 3:]
    result.pixels.foreach_set(stored.ravel())
    result.update()
    result.pack()
    return result


def mapped(chosen: bpy.types.Image | None, color: bool = True, value: str | None = "Alpha", **look: object) -> tuple:
    """An emitter whose particles have the image on them; its texture node and its AOV Output node."""
    material = scenes.material("Smoke", **look)
    tree = material.node_tree
    texture, output = tree.nodes.new("ShaderNodeTexImage"), tree.nodes.new("ShaderNodeOutputAOV")
    texture.image = chosen
    if hasattr(output, "aov_name"):
        output.aov_name = "Map"
    else:
        output.name = "Map"
    if color:
        tree.links.new(texture.outputs["Color"], output.inputs["Color"])
    if value is not None:
        tree.links.new(texture.outputs[value], output.inputs["Value"])
    owner = scenes.emitter(count=20, particle_size=0.5)
    owner.data.materials.append(material)
    scenes.bake()
    bpy.context.scene.frame_set(20)
    return texture, output


def exported(*expected_warnings: str) -> np.ndarray | None:
    """The exported map; just these warnings are about the material."""
    result = scenes.export()
    found = [text for text in result.warnings if "Smoke'" in text and "Material" in text]
    assert found == list(expected_warnings)
    return result.particles[0].volume.map


@pytest.mark.parametrize("is_float", [False, True])
def test_colour_and_opacity_of_an_image(is_float: bool, scene: bpy.types.Scene) -> None:
    mapped(image(picture(), is_float=is_float))
    assert np.abs(exported() - picture()).max() < (1e-5 if is_float else 3e-3)


def test_bytes_are_made_linear(scene: bpy.types.Scene) -> None:
    mapped(image(picture(), is_data=False))
    expected = picture()
    expected[..., :3] = ((expected[..., :3] + 0.055) / 1.055) ** 2.4
    assert np.abs(exported() - expected).max() < 5e-3


def test_a_file_is_read(scene: bpy.types.Scene, tmp_path: Path) -> None:
    written = image(picture())
    written.filepath_raw, written.file_format = str(tmp_path / "wisp.png"), "PNG"
    written.save()
    bpy.data.images.remove(written)
    read = bpy.data.images.load(str(tmp_path / "wisp.png"))
    read.colorspace_settings.name = "Non-Color"
    mapped(read)
    assert np.abs(exported() - picture()).max() < 3e-3


def test_a_sequence_has_its_frame(scene: bpy.types.Scene, tmp_path: Path) -> None:
    shades = {20: 0.2, 21: 0.6}
    for frame, shade in shades.items():
        written = image(np.full((3, 5, 4), shade, np.float32))
        written.filepath_raw, written.file_format = str(tmp_path / f"wisp_{frame:04d}.png"), "PNG"
        written.save()
        bpy.data.images.remove(written)
    read = bpy.data.images.load(str(tmp_path / "wisp_0020.png"))
    read.source, read.colorspace_settings.name = "SEQUENCE", "Non-Color"
    texture, _output = mapped(read)
    texture.image_user.frame_start, texture.image_user.frame_offset = 20, 19
    texture.image_user.frame_duration, texture.image_user.use_auto_refresh = 3, True
    for frame, shade in shades.items():
        scene.frame_set(frame)
        assert np.allclose(exported(), shade, atol=3e-3)
    images = len(bpy.data.images)
    scene.frame_set(22)
    result = scenes.export()
    (found,) = (text for text in result.warnings if "wisp_0020.png" in text)
    assert found.startswith(f"Material 'Smoke', node '{texture.name}': image 'wisp_0020.png': ")
    assert "wisp_0022.png" in found and found.endswith("; smoke has no map")
    assert result.particles[0].volume.map is None and len(bpy.data.images) == images


def test_what_is_not_linked_is_one(scene: bpy.types.Scene) -> None:
    mapped(image(picture()), value=None)
    found = exported()
    assert (found[..., 3] == 1).all() and np.abs(found[..., :3] - picture()[..., :3]).max() < 3e-3


def test_opacity_by_brightness_and_nodes_between(scene: bpy.types.Scene) -> None:
    texture, output = mapped(image(picture()), color=False, value=None)
    tree = texture.id_data
    invert = tree.nodes.new("ShaderNodeInvert")
    tree.links.new(texture.outputs["Color"], invert.inputs["Color"])
    tree.links.new(invert.outputs[0], output.inputs["Value"])
    found = exported()
    assert (found[..., :3] == 1).all()
    assert np.abs(found[..., 3] - (1 - picture()[..., :3]) @ (0.2126, 0.7152, 0.0722)).max() < 5e-3


def test_without_an_output_there_is_no_map(scene: bpy.types.Scene) -> None:
    scenes.emitter().data.materials.append(scenes.material("Smoke"))
    assert exported() is None


def test_what_has_no_pixels_is_named(scene: bpy.types.Scene) -> None:
    texture, output = mapped(None)
    node = f"Material 'Smoke', node '{texture.name}'"
    assert exported(f"{node} has no image; smoke has no map") is None
    texture.image = bpy.data.images.new("Gone", 4, 4)
    texture.image.source, texture.image.filepath = "FILE", "//gone.png"
    assert exported(f"{node}: image 'Gone' can't be read; smoke has no map") is None
    texture.image.source = "MOVIE"
    expected = f"{node}: image 'Gone' is of the kind MOVIE, which isn't supported; smoke has no map"
    assert exported(expected) is None
    for entry in output.inputs:
        for link in list(entry.links):
            texture.id_data.links.remove(link)
    expected = f"Material 'Smoke': no Image Texture node is linked to node '{output.name}'; smoke has no map"
    assert exported(expected) is None


def test_what_is_not_modelled_is_named(scene: bpy.types.Scene) -> None:
    texture, output = mapped(image(picture()))
    tree = texture.id_data
    other = tree.nodes.new("ShaderNodeTexImage")
    other.image = image(picture(3, 3), "Other")
    tree.links.new(other.outputs["Alpha"], output.inputs["Value"])
    tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["UV"], texture.inputs["Vector"])
    texture.interpolation = "Closest"
    node = f"Material 'Smoke', node '{texture.name}'"
    found = exported(
        f"{node}: its input 'Vector' isn't supported; the image fills the particle's square",
        f"{node}: interpolation Closest isn't supported; it is linear",
        "Material 'Smoke': image 'Other' isn't of the size of the map's first one, 6 x 4 pixels",
        f"Material 'Smoke': the link from node '{other.name}' to '{output.name}', input 'Value', "
        "isn't supported; the input's own value 0 is used",
    )
    assert (found[..., 3] == 0).all()


def test_values_are_limited(scene: bpy.types.Scene) -> None:
    bright = picture()
    bright[..., 0] = 4.0
    _texture, output = mapped(image(bright, is_float=True))
    expected = f"Material 'Smoke': node '{output.name}' gets values that aren't within 0..1; they are limited to that"
    assert np.allclose(exported(expected)[..., 0], 1)


def test_another_picture_is_another_scene(scene: bpy.types.Scene) -> None:
    texture, _output = mapped(image(picture()))
    first = fingerprint(scenes.export())
    assert fingerprint(scenes.export()) == first
    texture.image.pixels.foreach_set(np.full(96, 0.5, np.float32))
    assert fingerprint(scenes.export()) != first


@pytest.mark.parametrize("device", ["TILES", "GL"])
def test_a_render_has_the_map_and_as_much_smoke(device: str, scene: bpy.types.Scene, tmp_path: Path) -> None:
    half = np.ones((8, 8, 4), np.float32)
    half[:, 4:, 3] = 0
    texture, output = mapped(image(half), Density=0.3)
    scenes.light("SUN", 3.0)
    scenes.camera(location=(0, -8, 1.0))
    scene.render.resolution_x = scene.render.resolution_y = 96
    scene.render.film_transparent = True
    scene.fumarole.device = device
    shaped = scenes.render_combined(tmp_path)[..., 3]
    texture.id_data.nodes.remove(output)
    plain = scenes.render_combined(tmp_path)[..., 3]
    sums = [-np.log1p(-alpha.astype(np.float64)).sum() for alpha in (shaped, plain)]
    assert plain.max() > 0.05 and abs(sums[0] / sums[1] - 1) < 5e-3
    assert np.abs(shaped - plain).max() > 0.4 * plain.max()


def test_a_transparent_map_is_an_error_that_names_the_system(scene: bpy.types.Scene) -> None:
    mapped(image(np.zeros((4, 4, 4), np.float32)))
    result = scenes.export()
    with pytest.raises(core.FumaroleError, match="'.*' of 'Emitter': the map is transparent: its mean opacity is 0"):
        build(result, core.Context())
