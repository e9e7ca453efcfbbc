# SPDX-License-Identifier: GPL-3.0-or-later
"""The passes Vector, Albedo, Solid Shadow, Error and Cryptomatte as Blender and its compositor see them."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes
from exr import read_exr, read_metadata, stack

from fumarole import core


def smoke(name: str, location: tuple, **attributes: tuple) -> bpy.types.Object:
    owner = scenes.points_by_nodes(name, [(0, 0, 0)], radius=0.6, attributes=attributes)
    owner.location = location
    look = scenes.material(name, Density=6.0, Color=(0.8, 0.4, 0.2, 1))
    scenes.set_point_material(owner, look)
    return owner


def two_puffs() -> None:
    smoke("Left", (-1.3, 0, 0))
    smoke("Right", (1.3, 0, 0))
    scenes.light("SUN", energy=2.0)
    scenes.camera()
    bpy.context.scene.render.film_transparent = True


def move(owner: bpy.types.Object, axis: int, expression: str) -> None:
    owner.driver_add("location", axis).driver.expression = expression


def test_vector_is_that_of_cycles(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """A camera and something in front of it move: a square for Cycles, a puff for us."""
    scene.render.film_transparent = True
    scene.frame_set(10)
    owner = scenes.camera()
    move(owner, 0, "0.05 * frame")
    layer = bpy.context.view_layer
    layer.use_pass_vector = True
    card = scenes.plane("Card", size=3.0, rotation=(90, 0, 0))
    move(card, 0, "0.25 * frame - 2.0")
    move(card, 2, "1.5 - 0.15 * frame")
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 1
    scene.cycles.use_denoising = False
    expected = stack(scenes.render_channels(tmp_path), f"{layer.name}.Vector", "XYZW")
    bpy.data.objects.remove(card)
    puff = smoke("Puff", (0, 0, 0), velocity=("FLOAT_VECTOR", [np.array((0.25, 0, -0.15)) * scene.render.fps]))
    move(puff, 0, "0.25 * frame - 2.0")
    move(puff, 2, "1.5 - 0.15 * frame")
    scene.render.engine = "FUMAROLE"
    found = stack(scenes.render_channels(tmp_path), f"{layer.name}.Vector", "XYZW")
    assert scene.frame_current == 10
    middle = np.s_[found.shape[0] // 2, found.shape[1] // 2]
    assert np.abs(expected[middle]).min() > 1.0, "it moves in every direction"
    assert found[middle] == pytest.approx(expected[middle], abs=0.05)


def test_particles_have_their_velocity(scene: bpy.types.Scene, tmp_path: Path) -> None:
    owner = scenes.emitter(count=200, particle_size=0.4)
    owner.show_instancer_for_render = False
    owner.data.materials.append(scenes.material("Smoke", Density=3.0))
    scenes.light("SUN")
    scenes.bake()
    scene.frame_set(5)
    view = scenes.camera(location=(0, -8, 0.2), type="ORTHO", ortho_scale=4.0)
    layer = bpy.context.view_layer
    layer.use_pass_vector = True
    vector = stack(scenes.render_channels(tmp_path), f"{layer.name}.Vector", "XYZW")
    per_metre = vector.shape[1] / view.data.ortho_scale
    # 1 m/s, 0.04 s a frame, upwards: the frame before is below.
    middle = vector[vector.shape[0] // 2, vector.shape[1] // 2]
    assert middle == pytest.approx(np.array([0, -0.04, 0, -0.04]) * per_metre, rel=0.02, abs=0.05)


def test_switches_of_our_own(tmp_path: Path) -> None:
    two_puffs()
    scenes.plane("Roof", size=1.5, location=(-1.3, 0, 3))
    layer = bpy.context.view_layer
    settings = layer.fumarole
    settings.use_pass_albedo = settings.use_pass_solid_shadow = settings.use_pass_error = True
    settings.use_pass_light_solid_shadows = True
    channels = scenes.render_channels(tmp_path)
    combined = stack(channels, f"{layer.name}.Combined", "RGBA")
    albedo = stack(channels, f"{layer.name}.Albedo", "RGB")
    assert np.abs(albedo - combined[..., 3:] * np.float32((0.8, 0.4, 0.2))).max() < 2e-3
    shadow = stack(channels, f"{layer.name}.Solid Shadow", "RGB")
    assert shadow[:, : shadow.shape[1] // 2].min() < 0.1 and (shadow[:, shadow.shape[1] // 2 :] > 0.99).all()
    assert np.abs(shadow - stack(channels, f"{layer.name}.Solid Shadow Sun", "RGB")).max() < 2e-3
    error = channels[f"{layer.name}.Error.V"].astype(np.float32)
    assert 0 < np.abs(error).max() < 0.03


def compose_matte(name: str) -> None:
    """Has the compositor show the matte that Blender's Cryptomatte node makes of a name."""
    scene = bpy.context.scene
    if bpy.app.version >= (5, 0, 0):
        tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
        scene.compositing_node_group = tree
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        out = tree.nodes.new("NodeGroupOutput")
    else:
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
        out = tree.nodes.new("CompositorNodeComposite")
    tree.nodes.new("CompositorNodeRLayers")  # without one Blender 3 thinks that nothing is to be rendered
    node = tree.nodes.new("CompositorNodeCryptomatteV2")
    node.source, node.scene = "RENDER", scene
    node.layer_name = f"{bpy.context.view_layer.name}.CryptoObject"
    node.matte_id = name
    tree.links.new(node.outputs["Matte"], out.inputs[0])


@pytest.mark.parametrize("name", ["Left", "Right"])
def test_cryptomatte_node_picks_one_plume(name: str, tmp_path: Path) -> None:
    two_puffs()
    layer = bpy.context.view_layer
    combined = scenes.render_combined(tmp_path)
    layer.use_pass_cryptomatte_object = True
    compose_matte(name)
    scenes.exr_output(tmp_path / "matte.exr")
    bpy.ops.render.render(write_still=True)
    matte = read_exr(tmp_path / "matte.exr")["R"]
    half = combined.shape[1] // 2
    own, other = (np.s_[:, :half], np.s_[:, half:]) if name == "Left" else (np.s_[:, half:], np.s_[:, :half])
    assert matte[own].max() > 0.8
    assert np.abs(matte[own] - combined[..., 3][own]).max() < 2e-3
    assert np.abs(matte[other]).max() < 2e-3


def test_cryptomatte_of_a_file(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """Levels, names of systems, and the manifest in the metadata."""
    two_puffs()
    owner = scenes.emitter("Emitter", count=20)
    owner.modifiers.new("Second", "PARTICLE_SYSTEM")
    second = owner.particle_systems[1].settings
    second.count, second.frame_start, second.frame_end, second.lifetime = 20, 1, 1, 100
    scenes.bake()
    layer = bpy.context.view_layer
    layer.use_pass_cryptomatte_object = True
    layer.pass_cryptomatte_depth = 5
    scenes.render_channels(tmp_path)
    channels = read_exr(tmp_path / "render.exr")
    pairs = {name.split(".")[1] for name in channels if ".Crypto" in name}
    assert pairs == {"CryptoObject00", "CryptoObject01", "CryptoObject02"}
    metadata = read_metadata(tmp_path / "render.exr")
    key = f"cryptomatte/{core.crypto_hash(f'{layer.name}.CryptoObject'):08x}"[:-1]
    assert metadata[f"{key}/name"].decode() == f"{layer.name}.CryptoObject"
    assert metadata[f"{key}/hash"] == b"MurmurHash3_32"
    assert metadata[f"{key}/conversion"] == b"uint32_to_float32"
    manifest = json.loads(metadata[f"{key}/manifest"])
    systems = [f"Emitter.{system.name}" for system in owner.particle_systems]
    assert set(manifest) == {"Left", "Right", *systems}
    ids = stack(channels, f"{layer.name}.CryptoObject00", "RGBA")
    found = {f"{number:08x}" for number in np.ascontiguousarray(ids[..., 0]).view(np.uint32).ravel() if number}
    assert found <= set(manifest.values())
    assert {manifest["Left"], manifest["Right"]} <= found


def test_no_cryptomatte_no_metadata(tmp_path: Path) -> None:
    two_puffs()
    scenes.render_channels(tmp_path)
    assert not [name for name in read_metadata(tmp_path / "render.exr") if name.startswith("cryptomatte")]
