# SPDX-License-Identifier: GPL-3.0-or-later
"""The reference against Cycles of this Blender: a small version of scripts/compare_cycles.py."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes

from fumarole import core

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "scripts"))

import compare_cycles  # noqa: E402


def test_single_scattering_is_that_of_cycles(scene: bpy.types.Scene) -> None:
    """Gaussians in shader nodes, a point light, an area light and a wall that shades part of the smoke."""
    size = 16
    compare_cycles.build_blender_scene(size, step=0.08)
    renders = np.stack([compare_cycles.render_cycles(64, 1001 * run) for run in range(10)])
    reference = compare_cycles.render_reference(size)
    found = compare_cycles.compare(renders, reference)
    ratio, error = np.array(found["mean_ratio"]), np.array(found["mean_error"])
    assert (np.abs(ratio - 1.0) < 0.005 + 2.5 * error).all() and error.max() < 0.01, found
    assert found["z_blocks"] < 2.0, found
    # without the wall it is brighter by far more than that
    bpy.data.objects.remove(bpy.data.objects["Wall"])
    assert compare_cycles.render_cycles(64, 0)[..., :3].mean() > 1.1 * reference[..., :3].mean()


def principled(tree: bpy.types.NodeTree, density: bpy.types.NodeSocket | None) -> bpy.types.NodeSocket:
    """Smoke that scatters blue more than red, and absorbs what isn't red."""
    output = compare_cycles.grey_shade(tree, density)
    output.node.inputs["Color"].default_value = (0.3, 0.5, 0.7, 1)
    output.node.inputs["Absorption Color"].default_value = (0.8, 0.2, 0.05, 1)
    return output


def scatter_and_absorption(tree: bpy.types.NodeTree, density: bpy.types.NodeSocket | None) -> bpy.types.NodeSocket:
    """A mix of both nodes, and more of the second added."""
    nodes = [tree.nodes.new(f"ShaderNodeVolume{kind}") for kind in ("Scatter", "Absorption")]
    for node, colour in zip(nodes, [(0.9, 0.5, 0.2, 1), (0.1, 0.9, 1.0, 1)]):
        node.inputs["Color"].default_value, node.inputs["Density"].default_value = colour, 1.0
        if density is not None:
            tree.links.new(density, node.inputs["Density"])
    nodes[0].inputs["Anisotropy"].default_value = compare_cycles.ANISOTROPY
    mix, add = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeAddShader")
    mix.inputs[0].default_value = 0.3
    for k in (0, 1):
        tree.links.new(nodes[k].outputs[0], mix.inputs[1 + k])
        tree.links.new((mix, nodes[1])[k].outputs[0], add.inputs[k])
    return add.outputs[0]


def coefficients(tree: bpy.types.NodeTree, density: bpy.types.NodeSocket | None) -> bpy.types.NodeSocket:
    node = tree.nodes.new("ShaderNodeVolumeCoefficients")
    for name, value in (("Absorption", (0.1, 0.3, 0.0)), ("Scatter", (0.2, 0.5, 0.9))):
        socket = node.inputs[f"{name} Coefficients"]
        socket.default_value = value
        if density is not None:
            scale = tree.nodes.new("ShaderNodeVectorMath")
            scale.operation = "SCALE"
            scale.inputs[0].default_value = value
            tree.links.new(density, next(entry for entry in scale.inputs if entry.identifier == "Scale"))
            tree.links.new(scale.outputs["Vector"], socket)
    node.inputs["Anisotropy"].default_value = compare_cycles.ANISOTROPY
    return node.outputs[0]


@pytest.fixture(params=[principled, scatter_and_absorption, coefficients])
def shade(request: pytest.FixtureRequest) -> compare_cycles.Shade:
    if request.param is coefficients and not hasattr(bpy.types, "ShaderNodeVolumeCoefficients"):
        pytest.skip("this Blender has no Volume Coefficients node")
    return request.param


def look_of(shade: compare_cycles.Shade) -> dict:
    """The Gaussians' look with that shader as the add-on reads it, as of core.Scene.add_particles."""
    material = scenes.material("Smoke", None)
    tree = material.node_tree
    output = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputMaterial")
    tree.links.new(shade(tree, None), output.inputs["Volume"])
    scenes.emitter(count=1).data.materials.append(material)
    volume = scenes.export().particles[0].volume
    assert volume.anisotropy == pytest.approx(compare_cycles.ANISOTROPY)
    (extinction,), (tint,), (albedo,) = volume.extinction, volume.tint, volume.albedo
    assert np.ptp(tint) > 0.3
    return {"density": compare_cycles.GAUSSIANS[:, 4] * extinction, "extinction_color": tint, "albedo": albedo}


def test_tinted_shadow_is_that_of_cycles(scene: bpy.types.Scene, shade: compare_cycles.Shade) -> None:
    """A sun shines through the smoke on a plane below, which the camera sees from between them."""
    look, size, height = look_of(shade), 16, -3.5
    compare_cycles.build_blender_scene(size, 0.05, shade)
    for name in ("Wall", "POINT", "AREA"):
        bpy.data.objects.remove(bpy.data.objects[name])
    scenes.light("SUN", energy=3.0, angle=0.0)
    floor = scenes.plane("Floor", size=20.0, location=(0, 0, height))
    floor.data.materials.append(bpy.data.materials.new("White"))
    scenes.camera((0, 0, height + 0.3), (0, 0, 0), type="ORTHO", ortho_scale=3.0)
    scene.cycles.max_bounces = 0
    smoky = compare_cycles.render_cycles(16, 1)[..., :3]
    bpy.data.objects.remove(bpy.data.objects["Smoke"])
    shadow = smoky / compare_cycles.render_cycles(16, 1)[..., :3]

    smoke = core.Scene(core.Context())
    smoke.add_particles(compare_cycles.GAUSSIANS[:, :3], radius=2 * compare_cycles.GAUSSIANS[:, 3], **look)
    smoke.add_light("SUN", power=3.0)
    axis = (np.arange(size) + 0.5) / size * 3.0 - 1.5
    x, y = np.meshgrid(axis, axis)
    points = np.stack([x, y, np.full_like(x, height)], -1).reshape(-1, 3)
    found = core.irradiance(smoke, points).reshape(size, size, 3) / 3.0
    assert np.ptp(found, 2).max() > 0.15
    assert np.abs(found - shadow).max() < 0.01


@pytest.mark.skipif(
    bpy.app.version < (5, 0, 0),
    reason="its Cycles chooses a channel at every step by the same random number: pictures of coloured extinction "
    "depend on how distances are sampled, by a tenth",
)
def test_tinted_smoke_is_that_of_cycles(scene: bpy.types.Scene, shade: compare_cycles.Shade) -> None:
    """Radiance and alpha of smoke with extinction that differs by channel."""
    look, size = look_of(shade), 16
    compare_cycles.build_blender_scene(size, 0.08, shade)
    for material in bpy.data.materials:  # distances that depend on extinction are sampled with such a bias here too
        material.cycles.volume_sampling = "EQUIANGULAR"
    renders = np.stack([compare_cycles.render_cycles(32, 1001 * run) for run in range(6)])
    reference = compare_cycles.render_reference(size, **look)
    found = compare_cycles.compare(renders, reference)
    ratio, error = np.array(found["mean_ratio"]), np.array(found["mean_error"])
    assert (np.abs(ratio - 1.0) < 0.005 + 2.5 * error).all() and error.max() < 0.025, found
    assert error[3] < 0.003 and found["z_blocks"] < 2.0, found
    # with their mean for all channels it is off by far more than that
    grey = compare_cycles.render_reference(size, **look | {"extinction_color": 1.0})
    off = grey.mean((0, 1)) / reference.mean((0, 1))
    assert np.abs(off[:3] - 1).max() > 0.1 and abs(off[3] - 1) > 0.01, off
