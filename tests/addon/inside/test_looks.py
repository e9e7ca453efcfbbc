# SPDX-License-Identifier: GPL-3.0-or-later
"""Looks that change over a particle's life, and what function nodes compute, against Cycles."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes
from exr import stack
from fumarole.export.functions import blackbody
from fumarole.export.nodes import NodeReader


def fail(text: str) -> None:
    raise AssertionError(text)


class Tree:
    """A material whose emission is what nodes compute: rendered by Cycles, read by us."""

    def __init__(self) -> None:
        self.material = bpy.data.materials.new("Look")
        self.material.use_nodes = True
        self.tree = self.material.node_tree
        self.tree.nodes.clear()
        self.emission = self.tree.nodes.new("ShaderNodeEmission")
        output = self.tree.nodes.new("ShaderNodeOutputMaterial")
        self.tree.links.new(self.emission.outputs[0], output.inputs["Surface"])

    def add(self, kind: str, *inputs: object, **settings: object) -> bpy.types.Node:
        """A node with settings, and inputs that are values or the outputs of other nodes; None: as it is."""
        node = self.tree.nodes.new(kind)
        for name, value in settings.items():
            setattr(node, name, value)
        for socket, value in zip([entry for entry in node.inputs if entry.enabled], inputs):
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, socket)
            elif value is not None:
                socket.default_value = value
        return node

    def show(self, output: bpy.types.NodeSocket) -> None:
        self.tree.links.new(output, self.emission.inputs["Color"])

    def ours(self) -> np.ndarray:
        return NodeReader("Look", fail).color(self.emission, "Color")[0]

    def of_cycles(self, folder: Path) -> np.ndarray:
        scene = bpy.context.scene
        card = scenes.plane("Card", size=9.0, rotation=(90, 0, 0))
        card.data.materials.append(self.material)
        scenes.camera()
        scene.render.engine = "CYCLES"
        scene.cycles.samples, scene.cycles.use_denoising = 1, False
        scene.render.resolution_x = scene.render.resolution_y = 8
        scene.view_settings.view_transform = "Standard"
        return stack(scenes.render_channels(folder), f"{bpy.context.view_layer.name}.Combined", "RGB")[4, 4]


def value(tree: Tree, number: float) -> bpy.types.NodeSocket:
    node = tree.add("ShaderNodeValue")
    node.outputs[0].default_value = number
    return node.outputs[0]


MATH = {
    "ADD": (0.3, 0.4),
    "SUBTRACT": (0.9, 0.4),
    "MULTIPLY": (0.3, 0.4),
    "DIVIDE": (0.3, 0.4),
    "MULTIPLY_ADD": (0.3, 0.4, 0.2),
    "POWER": (0.3, 1.7),
    "LOGARITHM": (5.0, 7.0),
    "SQRT": (0.3,),
    "INVERSE_SQRT": (2.3,),
    "ABSOLUTE": (-0.3,),
    "EXPONENT": (0.3,),
    "MINIMUM": (0.3, 0.4),
    "MAXIMUM": (0.3, 0.4),
    "LESS_THAN": (0.3, 0.4),
    "GREATER_THAN": (0.3, 0.2),
    "SIGN": (0.3,),
    "COMPARE": (0.3, 0.35, 0.1),
    "SMOOTH_MIN": (0.3, 0.35, 0.2),
    "SMOOTH_MAX": (0.3, 0.35, 0.2),
    "ROUND": (0.6,),
    "FLOOR": (2.6,),
    "CEIL": (0.3,),
    "TRUNC": (2.6,),
    "FRACT": (2.6,),
    "MODULO": (2.6, 0.7),
    "WRAP": (2.6, 0.9, 0.2),
    "SNAP": (2.6, 0.7),
    "PINGPONG": (2.6, 0.7),
    "SINE": (0.3,),
    "COSINE": (0.3,),
    "TANGENT": (0.3,),
    "ARCSINE": (0.3,),
    "ARCCOSINE": (0.3,),
    "ARCTANGENT": (0.3,),
    "ARCTAN2": (0.3, 0.4),
    "SINH": (0.3,),
    "COSH": (0.3,),
    "TANH": (0.3,),
    "RADIANS": (70.0,),
    "DEGREES": (0.02,),
}


def test_math_is_that_of_cycles(tmp_path: Path) -> None:
    """Three at once, one in each channel."""
    for start in range(0, len(MATH), 3):
        tree = Tree()
        operations = list(MATH)[start : start + 3]
        channels = []
        for operation in operations:
            inputs = [value(tree, number) for number in MATH[operation]]
            channels.append(tree.add("ShaderNodeMath", *inputs, operation=operation).outputs[0])
        tree.show(tree.add("ShaderNodeCombineXYZ", *channels).outputs[0])
        assert tree.ours() == pytest.approx(tree.of_cycles(tmp_path), rel=2e-4, abs=2e-5), operations


def ramp(tree: Tree) -> bpy.types.NodeSocket:
    node = tree.add("ShaderNodeValToRGB", value(tree, 0.37))
    node.color_ramp.elements[0].color = (0.9, 0.1, 0.0, 1)
    node.color_ramp.elements[1].color = (0.1, 0.2, 0.7, 1)
    node.color_ramp.elements.new(0.55).color = (0.3, 0.8, 0.5, 1)
    return node.outputs["Color"]


def float_curve(tree: Tree) -> bpy.types.NodeSocket:
    node = tree.add("ShaderNodeFloatCurve", 0.8, value(tree, 0.37))
    node.mapping.curves[0].points.new(0.3, 0.8)
    node.mapping.update()
    return node.outputs[0]


def rgb_curves(tree: Tree) -> bpy.types.NodeSocket:
    colour = tree.add("ShaderNodeRGB")
    colour.outputs[0].default_value = (0.2, 0.5, 0.8, 1)
    node = tree.add("ShaderNodeRGBCurve", 0.7, colour.outputs[0])
    node.mapping.curves[3].points.new(0.4, 0.7)
    node.mapping.curves[1].points.new(0.5, 0.2)
    node.mapping.update()
    return node.outputs[0]


def map_range(tree: Tree, kind: str) -> bpy.types.NodeSocket:
    numbers = [0.37, 0.1, 0.9, 0.2, 0.8, 5.0]
    return tree.add("ShaderNodeMapRange", *numbers, interpolation_type=kind).outputs[0]


def mix(tree: Tree, blend: str) -> bpy.types.NodeSocket:
    node = tree.add("ShaderNodeMix", data_type="RGBA", blend_type=blend)
    values = {"Factor_Float": 0.3, "A_Color": (0.2, 0.5, 0.9, 1), "B_Color": (0.7, 0.4, 0.1, 1)}
    for socket in node.inputs:
        if socket.identifier in values:
            socket.default_value = values[socket.identifier]
    return next(socket for socket in node.outputs if socket.identifier == "Result_Color")


RANGES = ("LINEAR", "STEPPED", "SMOOTHSTEP", "SMOOTHERSTEP")
BLENDS = ("MIX", "ADD", "MULTIPLY", "SUBTRACT", "DIVIDE", "SCREEN", "DIFFERENCE", "DARKEN", "LIGHTEN")

NODES = {
    "ramp": ramp,
    "float curve": float_curve,
    "rgb curves": rgb_curves,
    "invert": lambda tree: tree.add("ShaderNodeInvert", 0.3, (0.2, 0.5, 0.9, 1)).outputs[0],
    "gamma": lambda tree: tree.add("ShaderNodeGamma", (0.2, 0.5, 0.9, 1), 1.7).outputs[0],
    "clamp": lambda tree: tree.add("ShaderNodeClamp", 0.9, 0.2, 0.6).outputs[0],
    **{f"map range {kind.lower()}": lambda tree, kind=kind: map_range(tree, kind) for kind in RANGES},
    **{f"mix {kind.lower()}": lambda tree, kind=kind: mix(tree, kind) for kind in BLENDS},
}


@pytest.mark.parametrize("name", NODES)
def test_nodes_compute_what_cycles_does(name: str, tmp_path: Path) -> None:
    tree = Tree()
    tree.show(NODES[name](tree))
    assert tree.ours() == pytest.approx(tree.of_cycles(tmp_path), abs=3e-3)


@pytest.mark.parametrize("kelvin", [900.0, 1500.0, 3000.0, 6500.0, 11000.0])
def test_blackbody_is_that_of_cycles(kelvin: float, tmp_path: Path) -> None:
    tree = Tree()
    tree.show(tree.add("ShaderNodeBlackbody", kelvin).outputs[0])
    expected = np.maximum(tree.of_cycles(tmp_path), 0)
    # Cycles has a fit of its own, which is off by more where red is all that is left.
    assert blackbody(np.array([kelvin]))[0] == pytest.approx(expected, rel=0.04 if kelvin > 1000 else 0.09, abs=0.05)


def age_of_life(material: bpy.types.Material) -> bpy.types.NodeSocket:
    tree = material.node_tree
    info, share = tree.nodes.new("ShaderNodeParticleInfo"), tree.nodes.new("ShaderNodeMath")
    share.operation = "DIVIDE"
    tree.links.new(info.outputs["Age"], share.inputs[0])
    tree.links.new(info.outputs["Lifetime"], share.inputs[1])
    return share.outputs[0]


def test_looks_over_life(scene: bpy.types.Scene) -> None:
    """Fire to smoke in one system: dense, glowing and small when young."""
    look = scenes.material("Fire", Color=(0.5, 0.5, 0.5, 1))
    tree = look.node_tree
    principled = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeVolumePrincipled")
    share = age_of_life(look)
    fade, glow, grow = (tree.nodes.new("ShaderNodeMapRange") for _ in range(3))
    for node, low, high in ((fade, 8.0, 2.0), (glow, 5.0, 0.0), (grow, 1.0, 3.0)):
        tree.links.new(share, node.inputs["Value"])
        node.inputs["To Min"].default_value, node.inputs["To Max"].default_value = low, high
    tree.links.new(fade.outputs[0], principled.inputs["Density"])
    tree.links.new(glow.outputs[0], principled.inputs["Emission Strength"])
    radius = tree.nodes.new("ShaderNodeOutputAOV")
    if hasattr(radius, "aov_name"):
        radius.aov_name = "Radius"
    else:
        radius.name = "Radius"
    tree.links.new(grow.outputs[0], radius.inputs["Value"])
    owner = scenes.emitter(count=40, frame_end=20, lifetime=40)
    owner.data.materials.append(look)
    scenes.bake()
    scene.frame_set(21)
    (item,) = (exported := scenes.export()).particles
    system = owner.evaluated_get(bpy.context.evaluated_depsgraph_get()).particle_systems[0]
    share = (21 - np.array([particle.birth_time for particle in system.particles])) / 40
    assert share.min() < 0.1 and share.max() > 0.4
    assert np.allclose(item.volume.extinction, 8 - 6 * share, atol=1e-4)
    assert np.allclose(item.volume.emission[:, 0], 5 - 5 * share, atol=1e-4)
    assert np.allclose(item.radii, 0.2 * (1 + 2 * share), atol=1e-5)
    assert not [text for text in exported.warnings if "Fire" in text]


def test_random_is_even_and_stays_with_particles(scene: bpy.types.Scene) -> None:
    look = scenes.material("Smoke")
    tree = look.node_tree
    info = tree.nodes.new("ShaderNodeParticleInfo")
    principled = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeVolumePrincipled")
    tree.links.new(info.outputs["Random"], principled.inputs["Density"])
    owner = scenes.emitter(count=2000)
    owner.data.materials.append(look)
    scenes.bake()
    numbers = []
    for frame in (2, 9):
        scene.frame_set(frame)
        numbers.append(scenes.export().particles[0].volume.extinction)
    assert np.array_equal(*numbers)
    counts, _ = np.histogram(numbers[0], bins=10, range=(0, 1))
    assert counts.sum() == 2000 and counts.min() > 140 and counts.max() < 260


def test_particle_info_of_other_outputs(scene: bpy.types.Scene) -> None:
    look = scenes.material("Smoke")
    tree = look.node_tree
    info, length = tree.nodes.new("ShaderNodeParticleInfo"), tree.nodes.new("ShaderNodeVectorMath")
    length.operation = "LENGTH"
    tree.links.new(info.outputs["Velocity"], length.inputs[0])
    principled = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeVolumePrincipled")
    tree.links.new(length.outputs["Value"], principled.inputs["Density"])
    tree.links.new(info.outputs["Location"], principled.inputs["Color"])
    owner = scenes.emitter(count=20)
    owner.data.materials.append(look)
    scenes.bake()
    scene.frame_set(2)
    (item,) = scenes.export().particles
    assert np.allclose(item.volume.extinction, 1.0, atol=1e-3)
    assert np.allclose(item.volume.albedo, np.clip(item.positions, 0, 1), atol=1e-5)


def test_blackbody_of_principled_volume_is_that_of_cycles(tmp_path: Path) -> None:
    """A cube that glows, thin enough to see through: radiance is emission times length."""
    glow = {"Blackbody_Intensity": 1.0, "Temperature": 1500.0, "Blackbody_Tint": (1, 0.8, 0.5, 1)}
    look = scenes.material("Fire", Density=0.0, **glow)
    mesh = bpy.data.meshes.new("Cube")
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    mesh.from_pydata(corners, [], [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    cube = scenes.link("Cube", mesh)
    mesh.materials.append(look)
    scenes.camera()
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = 4, False
    scene.render.resolution_x = scene.render.resolution_y = 8
    expected = stack(scenes.render_channels(tmp_path), f"{bpy.context.view_layer.name}.Combined", "RGB")[4, 4]
    bpy.data.objects.remove(cube)
    owner = scenes.points_by_nodes("Points", [(0, 0, 0)])
    scenes.set_point_material(owner, look)
    (item,) = scenes.export().particles
    assert expected.max() > 0.05
    assert 2 * item.volume.emission[0] == pytest.approx(expected, rel=0.04, abs=0.02 * float(expected.max()))


def test_fire_becomes_smoke(tmp_path: Path) -> None:
    """The example: without lamps the flames are left, at the foot."""
    bpy.ops.wm.open_mainfile(filepath=str(Path(__file__).resolve().parents[3] / "example_blends" / "fire.blend"))
    bpy.context.scene.render.resolution_percentage = 10
    bpy.context.view_layer.use_pass_emit = True
    channels = scenes.render_channels(tmp_path)
    lit = stack(channels, "ViewLayer.Combined", "RGB") - stack(channels, "ViewLayer.Emit", "RGB")
    emitted, half = stack(channels, "ViewLayer.Emit", "RGB"), lit.shape[0] // 2
    assert emitted[:half].max() > 0.5 and emitted[half:].max() < 0.1 * emitted.max()
    assert lit[half:].max() > 0.02
