# SPDX-License-Identifier: GPL-3.0-or-later
"""Volume shaders as they are read."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
import scenes
from fumarole.export.materials import Volume


def read(material: bpy.types.Material) -> tuple[Volume, list[str]]:
    """What a particle system with that material exports, and the warnings that name the material."""
    owner = scenes.emitter(count=1)
    owner.data.materials.append(material)
    result = scenes.export()
    return result.particles[0].volume, [text for text in result.warnings if f"'{material.name}'" in text]


def node_of(material: bpy.types.Material, kind: str) -> bpy.types.Node:
    return next(node for node in material.node_tree.nodes if node.bl_idname == kind)


def output_of(material: bpy.types.Material) -> bpy.types.NodeSocket:
    return node_of(material, "ShaderNodeOutputMaterial").inputs["Volume"]


def test_principled_volume() -> None:
    volume, warnings = read(
        scenes.material(
            "Smoke",
            Color=(0.2, 0.5, 0.9, 1),
            Density=3.0,
            Anisotropy=0.4,
            Emission_Strength=2.0,
            Emission_Color=(1, 0.5, 0.25, 1),
        )
    )
    assert np.allclose(volume.extinction, 3)
    assert np.allclose(volume.albedo, (0.2, 0.5, 0.9))
    assert np.allclose(volume.emission, (2, 1, 0.5))
    assert volume.anisotropy == pytest.approx(0.4)
    assert not warnings


def test_principled_absorption_colour_is_squared_away() -> None:
    look = scenes.material("Smoke", Color=(0.5, 0.5, 0.5, 1), Density=2.0, Absorption_Color=(0.25, 0.25, 0.25, 1))
    volume, warnings = read(look)
    assert np.allclose(volume.extinction, 2 * (0.5 + 0.5 * 0.5))
    assert np.allclose(volume.albedo, 0.5 / 0.75)
    assert not warnings


def test_volume_scatter() -> None:
    volume, warnings = read(
        scenes.material("Smoke", "ShaderNodeVolumeScatter", Color=(0.5, 0.5, 0.5, 1), Density=4.0, Anisotropy=-0.3)
    )
    assert np.allclose(volume.extinction, 2)
    assert np.allclose(volume.albedo, 1)
    assert volume.anisotropy == pytest.approx(-0.3)
    assert not warnings


def test_volume_absorption() -> None:
    volume, _ = read(scenes.material("Smoke", "ShaderNodeVolumeAbsorption", Color=(0.2, 0.2, 0.2, 1), Density=4.0))
    assert np.allclose(volume.extinction, 3.2)
    assert np.allclose(volume.albedo, 0)


def test_volume_coefficients() -> None:
    if not hasattr(bpy.types, "ShaderNodeVolumeCoefficients"):
        pytest.skip("this Blender has no Volume Coefficients node")
    coefficients = {
        "Absorption_Coefficients": (1, 2, 3),
        "Scatter_Coefficients": (3, 2, 1),
        "Emission_Coefficients": (0.1, 0.2, 0.3),
    }
    volume, warnings = read(scenes.material("Smoke", "ShaderNodeVolumeCoefficients", **coefficients))
    assert np.allclose(volume.extinction, 4)
    assert np.allclose(volume.albedo, (0.75, 0.5, 0.25))
    assert np.allclose(volume.emission, (0.1, 0.2, 0.3))
    assert not warnings


def test_other_phase_functions_are_named() -> None:
    look = scenes.material("Smoke", "ShaderNodeVolumeScatter")
    if not hasattr(node_of(look, "ShaderNodeVolumeScatter"), "phase"):
        pytest.skip("this Blender has one phase function")
    node_of(look, "ShaderNodeVolumeScatter").phase = "RAYLEIGH"
    volume, warnings = read(look)
    assert volume.anisotropy == 0
    assert any("RAYLEIGH" in text for text in warnings)


@pytest.mark.parametrize(
    ("kind", "inputs", "extinction"),
    [
        ("Scatter", {"Color": (0.3, 0.6, 0.9, 1)}, (0.3, 0.6, 0.9)),
        ("Absorption", {"Color": (1.0, 0.6, 0.0, 1)}, (0.0, 0.4, 1.0)),
        (
            "Principled",
            {"Color": (0.5, 0.5, 0.5, 1), "Absorption_Color": (0.0, 0.25, 1.0, 1)},
            (1.0, 0.75, 0.5),
        ),
        # a grey absorption colour below a coloured scattering colour
        (
            "Principled",
            {"Color": (0.2, 0.5, 0.8, 1), "Absorption_Color": (0.25, 0.25, 0.25, 1)},
            (0.6, 0.75, 0.9),
        ),
    ],
)
def test_extinction_of_a_colour(kind: str, inputs: dict, extinction: tuple) -> None:
    volume, warnings = read(scenes.material("Smoke", f"ShaderNodeVolume{kind}", Density=4.0, **inputs))
    assert volume.extinction == pytest.approx([4 * np.mean(extinction)])
    assert np.allclose(volume.tint * volume.extinction[:, None], 4 * np.array(extinction))
    scattering = np.zeros(3) if kind == "Absorption" else np.array(inputs["Color"][:3])
    assert np.allclose(volume.albedo * volume.tint * volume.extinction[:, None], 4 * scattering)
    assert not warnings


def test_grey_extinction_is_exactly_grey() -> None:
    """Scattering and absorption of each channel are rounded, but no channel is rendered by itself for that."""
    for colour in np.random.default_rng(1).uniform(0, 1, (5, 3)):
        volume, _ = read(scenes.material("Smoke", Color=(*colour, 1), Density=3.3))
        assert (volume.tint == 1).all()
        bpy.data.objects.remove(bpy.data.objects["Emitter"])
        bpy.data.materials.remove(bpy.data.materials["Smoke"])


def test_a_colour_a_point() -> None:
    colours = [(0.2, 0.5, 0.8, 1), (0.5, 0.5, 0.5, 1)]
    owner = scenes.points_by_nodes("Points", [(0, 0, 0), (1, 0, 0)], attributes={"ink": ("FLOAT_COLOR", colours)})
    look = scenes.material("Smoke", "ShaderNodeVolumeScatter", Density=2.0)
    attribute = look.node_tree.nodes.new("ShaderNodeAttribute")
    attribute.attribute_name = "ink"
    look.node_tree.links.new(attribute.outputs["Color"], node_of(look, "ShaderNodeVolumeScatter").inputs["Color"])
    scenes.set_point_material(owner, look)
    result = scenes.export()
    volume = result.particles[0].volume
    assert np.allclose(volume.tint * volume.extinction[:, None], 2 * np.array(colours)[:, :3])
    assert (volume.tint[1] == 1).all()
    assert not [text for text in result.warnings if "extinction" in text]


@pytest.mark.parametrize("factor", [0.0, 0.25, 1.0])
def test_mix_and_add(factor: float) -> None:
    look = scenes.material("Smoke", None)
    nodes, links = look.node_tree.nodes, look.node_tree.links
    scatter, absorption = nodes.new("ShaderNodeVolumeScatter"), nodes.new("ShaderNodeVolumeAbsorption")
    scatter.inputs["Color"].default_value = absorption.inputs["Color"].default_value = (0.5, 0.5, 0.5, 1)
    scatter.inputs["Density"].default_value, absorption.inputs["Density"].default_value = 8, 4
    mix, add = nodes.new("ShaderNodeMixShader"), nodes.new("ShaderNodeAddShader")
    mix.inputs[0].default_value = factor
    links.new(scatter.outputs[0], mix.inputs[1])
    links.new(absorption.outputs[0], mix.inputs[2])
    links.new(mix.outputs[0], add.inputs[0])
    links.new(absorption.outputs[0], add.inputs[1])
    links.new(add.outputs[0], output_of(look))
    volume, warnings = read(look)
    scattering, absorbing = 4 * (1 - factor), 2 * factor + 2
    assert np.allclose(volume.extinction, scattering + absorbing)
    assert np.allclose(volume.albedo, scattering / (scattering + absorbing))
    assert not warnings


def test_mixed_anisotropies_are_averaged_with_a_warning() -> None:
    look = scenes.material("Smoke", None)
    add = look.node_tree.nodes.new("ShaderNodeAddShader")
    for index, (density, g) in enumerate([(3.0, 0.5), (1.0, -0.5)]):
        node = look.node_tree.nodes.new("ShaderNodeVolumeScatter")
        node.inputs["Density"].default_value, node.inputs["Anisotropy"].default_value = density, g
        look.node_tree.links.new(node.outputs[0], add.inputs[index])
    look.node_tree.links.new(add.outputs[0], output_of(look))
    volume, warnings = read(look)
    assert volume.anisotropy == pytest.approx(0.25)
    assert any("anisotropies" in text for text in warnings)


def test_links_through_reroutes_groups_and_muted_nodes() -> None:
    look = scenes.material("Smoke", None)
    tree = look.node_tree
    inner = bpy.data.node_groups.new("Inner", "ShaderNodeTree")
    if hasattr(inner, "interface"):
        inner.interface.new_socket("Amount", in_out="INPUT", socket_type="NodeSocketFloat")
        inner.interface.new_socket("Volume", in_out="OUTPUT", socket_type="NodeSocketShader")
    else:
        inner.inputs.new("NodeSocketFloat", "Amount")
        inner.outputs.new("NodeSocketShader", "Volume")
    start, end = inner.nodes.new("NodeGroupInput"), inner.nodes.new("NodeGroupOutput")
    principled, reroute = inner.nodes.new("ShaderNodeVolumePrincipled"), inner.nodes.new("NodeReroute")
    inner.links.new(start.outputs["Amount"], reroute.inputs[0])
    inner.links.new(reroute.outputs[0], principled.inputs["Density"])
    inner.links.new(principled.outputs[0], end.inputs["Volume"])
    group, value = tree.nodes.new("ShaderNodeGroup"), tree.nodes.new("ShaderNodeValue")
    group.node_tree = inner
    muted = tree.nodes.new("ShaderNodeMath")
    muted.mute = True
    value.outputs[0].default_value = 6.0
    tree.links.new(value.outputs[0], muted.inputs[0])
    tree.links.new(muted.outputs[0], group.inputs["Amount"])
    tree.links.new(group.outputs[0], output_of(look))
    volume, warnings = read(look)
    assert np.allclose(volume.extinction, 6)
    assert not warnings


def test_value_and_colour_nodes() -> None:
    look = scenes.material("Smoke")
    colour = look.node_tree.nodes.new("ShaderNodeRGB")
    colour.outputs[0].default_value = (0.1, 0.2, 0.3, 1)
    principled = node_of(look, "ShaderNodeVolumePrincipled")
    look.node_tree.links.new(colour.outputs[0], principled.inputs["Color"])
    volume, warnings = read(look)
    assert np.allclose(volume.albedo, (0.1, 0.2, 0.3))
    assert not warnings


def test_unsupported_link_is_named_and_its_socket_used() -> None:
    look = scenes.material("Smoke", Density=3.0)
    noise = look.node_tree.nodes.new("ShaderNodeTexNoise")
    look.node_tree.links.new(noise.outputs[0], node_of(look, "ShaderNodeVolumePrincipled").inputs["Density"])
    volume, (warning,) = read(look)
    assert np.allclose(volume.extinction, 3)
    assert "'Noise Texture'" in warning and "'Density'" in warning and "3" in warning


def test_unsupported_shader_is_named() -> None:
    look = scenes.material("Smoke", "ShaderNodeBsdfDiffuse")
    volume, (warning,) = read(look)
    assert np.allclose(volume.extinction, 0)
    assert "Diffuse" in warning


@pytest.mark.parametrize("kind", ["none", "surface"])
def test_without_volume_it_is_grey_smoke_with_a_warning(kind: str) -> None:
    owner = scenes.emitter("Fire", count=1)
    if kind == "surface":
        owner.data.materials.append(scenes.material("Skin", None, surface=True))
    result = scenes.export()
    volume = result.particles[0].volume
    assert np.allclose(volume.extinction, 10) and np.allclose(volume.albedo, 0.8)
    (warning,) = [text for text in result.warnings if "grey smoke" in text]
    assert "'Fire'" in warning and ("'Skin'" in warning) == (kind == "surface")


def test_animated_material_follows_the_frame(scene: bpy.types.Scene) -> None:
    look = scenes.material("Smoke")
    density = node_of(look, "ShaderNodeVolumePrincipled").inputs["Density"]
    for frame, value in ((1, 1.0), (11, 11.0)):
        density.default_value = value
        density.keyframe_insert("default_value", frame=frame)
    owner = scenes.emitter(count=1)
    owner.data.materials.append(look)
    scene.frame_set(11)
    assert np.allclose(scenes.export().particles[0].volume.extinction, 11)
