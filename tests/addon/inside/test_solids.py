# SPDX-License-Identifier: GPL-3.0-or-later
"""Solids in the picture: their looks and flags as they are exported."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
import scenes
from fumarole.export.surfaces import Surface
from scenes import cube, paint, put_in


def looks() -> list[tuple]:
    bpy.context.scene.fumarole.solids = "SHADED"
    return [(mesh.surface, mesh.is_holdout) for mesh in scenes.export().meshes]


@pytest.mark.parametrize(
    ("kind", "inputs", "albedo", "emission"),
    [
        ("ShaderNodeBsdfDiffuse", {"Color": (0.5, 0.25, 0.125, 1)}, (0.5, 0.25, 0.125), (0, 0, 0)),
        ("ShaderNodeBsdfPrincipled", {"Base_Color": (0.5, 0.25, 0.125, 1)}, (0.5, 0.25, 0.125), (0, 0, 0)),
        ("ShaderNodeEmission", {"Color": (0.5, 0.25, 0, 1), "Strength": 4.0}, (0, 0, 0), (2, 1, 0)),
    ],
)
def test_looks_of_shaders(scene: bpy.types.Scene, kind: str, inputs: dict, albedo: tuple, emission: tuple) -> None:
    paint(scenes.plane("Wall"), kind, **inputs)
    assert looks() == [(Surface(albedo, emission), False)]


def test_emission_of_a_principled_shader(scene: bpy.types.Scene) -> None:
    node = "ShaderNodeBsdfPrincipled"
    color = "Emission_Color" if bpy.app.version >= (4, 0, 0) else "Emission"
    paint(scenes.plane("Wall"), node, Base_Color=(0.5, 0.5, 0.5, 1), Emission_Strength=2.0, **{color: (1, 0.5, 0, 1)})
    assert looks() == [(Surface((0.5,) * 3, (2, 1, 0)), False)]


def test_a_mix_of_shaders(scene: bpy.types.Scene) -> None:
    material = paint(scenes.plane("Wall"), Color=(0.5, 0.5, 0, 1))
    tree = material.node_tree
    output = next(item for item in tree.nodes if item.bl_idname == "ShaderNodeOutputMaterial")
    mix, glow = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeEmission")
    mix.inputs[0].default_value = 0.25
    tree.links.new(output.inputs["Surface"].links[0].from_socket, mix.inputs[1])
    tree.links.new(glow.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    assert looks() == [(Surface((0.375, 0.375, 0), (0.25,) * 3), False)]


def test_without_a_material_it_is_as_bright_as_in_cycles(scene: bpy.types.Scene) -> None:
    scenes.plane("Wall")
    assert looks() == [(Surface((0.8, 0.8, 0.8)), False)]


def test_a_holdout_shader_makes_a_holdout(scene: bpy.types.Scene) -> None:
    paint(scenes.plane("Wall"), "ShaderNodeHoldout")
    assert [is_holdout for _, is_holdout in looks()] == [True]


def test_what_cannot_be_read_is_named(scene: bpy.types.Scene) -> None:
    """A texture and a shader; the viewport's colour takes their place."""
    textured = paint(scenes.plane("Textured"))
    tree = textured.node_tree
    diffuse = next(item for item in tree.nodes if item.bl_idname == "ShaderNodeBsdfDiffuse")
    tree.links.new(tree.nodes.new("ShaderNodeTexNoise").outputs["Color"], diffuse.inputs["Color"])
    velvet = paint(scenes.plane("Shiny"), "ShaderNodeBsdfToon")
    for material, color in ((textured, (0.5, 0.25, 0, 1)), (velvet, (0, 0.25, 0.5, 1))):
        material.diffuse_color = color
    scene.fumarole.solids = "SHADED"
    exported = scenes.export()
    assert [mesh.surface.albedo for mesh in exported.meshes] == [(0.5, 0.25, 0), (0, 0.25, 0.5)]
    for owner, what in (("Textured", "Noise"), ("Shiny", "Toon")):
        found = [text for text in exported.warnings if f"'Paint of {owner}'" in text]
        assert len(found) == 1 and what in found[0] and "viewport colour" in found[0]
    scene.fumarole.solids = "HOLDOUT"
    assert not any("viewport colour" in text for text in scenes.export().warnings), "holdouts have no looks"


def test_what_is_not_matt_is_named(scene: bpy.types.Scene) -> None:
    transmission = "Transmission_Weight" if bpy.app.version >= (4, 0, 0) else "Transmission"
    node = "ShaderNodeBsdfPrincipled"
    paint(scenes.plane("Matt"), node)
    paint(scenes.plane("Glass"), node, Metallic=0.25, Alpha=0.5, **{transmission: 0.75})
    scene.fumarole.solids = "SHADED"
    warnings = scenes.export().warnings
    for what in ("Metallic 0.25", transmission.replace("_", " ") + " 0.75", "Alpha 0.5"):
        assert sum("'Paint of Glass'" in text and what in text for text in warnings) == 1, what
    assert not any("'Paint of Matt'" in text for text in warnings)


def test_colours_out_of_range_are_named(scene: bpy.types.Scene) -> None:
    paint(scenes.plane("Wall"), Color=(1.5, 0.5, 0.5, 1))
    scene.fumarole.solids = "SHADED"
    exported = scenes.export()
    assert exported.meshes[0].surface.albedo == (1, 0.5, 0.5)
    assert any("'Paint of Wall'" in text and "(1.5, 0.5, 0.5)" in text for text in exported.warnings)


def test_faces_of_several_materials(scene: bpy.types.Scene) -> None:
    owner = cube("Cube", 0.5, (0, 0, 0))
    paint(owner, Color=(0.5, 0, 0, 1))
    paint(owner, Color=(0, 0.5, 0, 1))
    owner.data.materials.append(scenes.material("Fog"))
    for face, slot in zip(owner.data.polygons, (0, 0, 0, 1, 1, 2)):
        face.material_index = slot
    scene.fumarole.solids = "SHADED"
    meshes = scenes.export().meshes
    assert [(mesh.name, mesh.surface.albedo, len(mesh.triangles)) for mesh in meshes] == [
        ("Object 'Cube'", (0.5, 0, 0), 6),
        ("Object 'Cube'", (0, 0.5, 0), 4),
    ]
    assert meshes[0].vertices is meshes[1].vertices
    scene.fumarole.solids = "HOLDOUT"
    (mesh,) = scenes.export().meshes
    assert len(mesh.triangles) == 10


def test_smooth_faces_have_normals(scene: bpy.types.Scene) -> None:
    owner = cube("Cube", 0.5, (0, 0, 0))
    scene.fumarole.solids = "SHADED"
    assert scenes.export().meshes[0].normals is None
    for face in owner.data.polygons:
        face.use_smooth = True
    (mesh,) = scenes.export().meshes
    corners = mesh.vertices[mesh.triangles]
    expected = corners / np.linalg.norm(corners, axis=-1, keepdims=True)
    assert np.allclose(mesh.normals, expected, atol=1e-4)
    scene.fumarole.solids = "HOLDOUT"
    assert scenes.export().meshes[0].normals is None


@pytest.mark.parametrize("is_instance", [False, True])
@pytest.mark.parametrize(
    ("object_flags", "layer_flags", "expected"),
    [
        ({}, {}, (True, True, False)),
        ({"is_holdout": True}, {}, (True, True, True)),
        ({}, {"holdout": True}, (True, True, True)),
        ({}, {"indirect_only": True}, (False, True, False)),
        ({}, {"indirect_only": True, "holdout": True}, (True, True, True)),
        ({"is_holdout": True}, {"indirect_only": True}, (True, True, True)),
        ({"is_holdout": True, "visible_camera": False}, {}, (False, True, True)),
        ({"visible_shadow": False}, {}, (True, False, False)),
    ],
)
def test_flags(
    scene: bpy.types.Scene, object_flags: dict, layer_flags: dict, expected: tuple, is_instance: bool
) -> None:
    """Whether the camera sees it, it casts shadows, it is a holdout; of an instance by the flags of what makes it."""
    owner = scenes.plane("Wall")
    if is_instance:
        collection = bpy.data.collections.new("Kept out of the scene")
        scene.collection.objects.unlink(owner)
        collection.objects.link(owner)
        owner = scenes.link("Instance", None)
        owner.instance_type, owner.instance_collection = "COLLECTION", collection
    put_in(owner, "Layer", **layer_flags)
    for flag, value in object_flags.items():
        setattr(owner, flag, value)
    (mesh,) = scenes.export().meshes
    assert (mesh.visible_to_camera, mesh.casts_shadow, mesh.is_holdout) == expected
