# SPDX-License-Identifier: GPL-3.0-or-later
"""The world's background, and what else belongs to a view layer."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
import scenes


def world(scene: bpy.types.Scene) -> bpy.types.Node:
    """A new world's background node."""
    scene.world = bpy.data.worlds.new("Sky")
    scene.world.use_nodes = True
    return next(node for node in scene.world.node_tree.nodes if node.bl_idname == "ShaderNodeBackground")


def test_no_world_is_black(scene: bpy.types.Scene) -> None:
    result = scenes.export()
    assert not result.background.any()
    assert not [text for text in result.warnings if "World" in text]


def test_background_is_colour_times_strength_and_lights_nothing_yet(scene: bpy.types.Scene) -> None:
    background = world(scene)
    background.inputs["Color"].default_value = (0.1, 0.2, 0.4, 1)
    background.inputs["Strength"].default_value = 3.0
    result = scenes.export()
    assert np.allclose(result.background, (0.3, 0.6, 1.2))
    (warning,) = [text for text in result.warnings if "'Sky'" in text]
    assert "lights no smoke" in warning
    background.inputs["Strength"].default_value = 0.0
    assert not [text for text in scenes.export().warnings if "'Sky'" in text]


def test_world_without_nodes(scene: bpy.types.Scene) -> None:
    if bpy.app.version >= (5, 0, 0):
        pytest.skip("worlds always use nodes in this Blender")
    scene.world = bpy.data.worlds.new("Sky")
    scene.world.color = (0.5, 0.25, 0.125)
    assert np.allclose(scenes.export().background, (0.5, 0.25, 0.125))


def test_texture_is_named_and_the_sockets_colour_used(scene: bpy.types.Scene) -> None:
    background = world(scene)
    background.inputs["Color"].default_value = (0.1, 0.2, 0.4, 1)
    texture = scene.world.node_tree.nodes.new("ShaderNodeTexEnvironment")
    scene.world.node_tree.links.new(texture.outputs[0], background.inputs["Color"])
    result = scenes.export()
    assert np.allclose(result.background, (0.1, 0.2, 0.4))
    assert any("'Sky'" in text and "'Environment Texture'" in text for text in result.warnings)


def test_material_override_is_named(scene: bpy.types.Scene) -> None:
    bpy.context.view_layer.material_override = bpy.data.materials.new("Clay")
    assert any("material_override" in text for text in scenes.export().warnings)
