# SPDX-License-Identifier: GPL-3.0-or-later
"""Solids as they are exported."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
import scenes


def corners(mesh: scenes.Scene) -> np.ndarray:
    """World positions of all triangles' corners, (m, 3, 3)."""
    world = mesh.vertices @ mesh.matrix[:3, :3].T + mesh.matrix[:3, 3]
    return world[mesh.triangles]


def area(mesh: scenes.Scene) -> float:
    a, b, c = np.moveaxis(corners(mesh), 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_modifiers_are_applied_and_transforms_kept(scene: bpy.types.Scene) -> None:
    owner = scenes.plane("Ground", size=2, location=(0, 0, -3))
    owner.scale = (2, 2, 2)
    array = owner.modifiers.new("Array", "ARRAY")
    array.count = 3
    (mesh,) = scenes.export().meshes
    assert area(mesh) == pytest.approx(3 * 16)
    assert np.allclose(corners(mesh)[..., 2], -3)
    assert "'Ground'" in mesh.name


@pytest.mark.parametrize("kind", ["CURVE", "FONT", "SURFACE", "META"])
def test_objects_that_convert_to_meshes(scene: bpy.types.Scene, kind: str) -> None:
    if kind == "META":
        data = bpy.data.metaballs.new("Ball")
        data.elements.new()
        scenes.link("Ball", data)
    elif kind == "SURFACE":
        bpy.ops.surface.primitive_nurbs_surface_sphere_add()
    else:
        data = bpy.data.curves.new("Shape", kind)
        if kind == "FONT":
            data.body = "smoke"
        else:
            data.bevel_depth = 0.1
            data.splines.new("POLY").points.add(1)
            data.splines[0].points[1].co = (1, 0, 0, 1)
        scenes.link("Shape", data)
    (mesh,) = scenes.export().meshes
    assert area(mesh) > 0.1


def test_instances_share_their_arrays(scene: bpy.types.Scene) -> None:
    source = scenes.plane("Chip", size=1)
    collection = bpy.data.collections.new("Chips")
    scene.collection.objects.unlink(source)
    collection.objects.link(source)
    for x in range(5):
        empty = scenes.link("Instance", None, location=(x, 0, 0))
        empty.instance_type, empty.instance_collection = "COLLECTION", collection
    meshes = scenes.export().meshes
    assert sorted(mesh.matrix[0, 3] for mesh in meshes) == [0, 1, 2, 3, 4]
    assert all(mesh.vertices is meshes[0].vertices for mesh in meshes)


def test_geometry_nodes_instances(scene: bpy.types.Scene) -> None:
    owner = scenes.points_by_nodes("Points", [(0, 0, 0), (3, 0, 0)])
    tree = owner.modifiers["Points"].node_group
    end = next(node for node in tree.nodes if node.bl_idname == "NodeGroupOutput")
    before = end.inputs[0].links[0].from_socket
    cube, place = tree.nodes.new("GeometryNodeMeshCube"), tree.nodes.new("GeometryNodeInstanceOnPoints")
    tree.links.new(before, place.inputs["Points"])
    tree.links.new(cube.outputs[0], place.inputs["Instance"])
    tree.links.new(place.outputs[0], end.inputs[0])
    result = scenes.export()
    assert sorted(mesh.matrix[0, 3] for mesh in result.meshes) == [0, 3]
    assert [area(mesh) for mesh in result.meshes] == pytest.approx([6, 6])


def test_hidden_objects(scene: bpy.types.Scene) -> None:
    scenes.plane("Hidden").hide_render = True
    scenes.plane("Viewport").hide_viewport = True
    assert [mesh.name for mesh in scenes.export().meshes] == ["Object 'Viewport'"]


@pytest.mark.parametrize(("camera", "shadow"), [(True, True), (True, False), (False, True), (False, False)])
def test_ray_visibility(scene: bpy.types.Scene, camera: bool, shadow: bool) -> None:
    owner = scenes.plane("Wall")
    owner.visible_camera, owner.visible_shadow = camera, shadow
    found = [(mesh.visible_to_camera, mesh.casts_shadow) for mesh in scenes.export().meshes]
    assert found == ([(camera, shadow)] if camera or shadow else [])


def test_indirect_only_collection_casts_shadows_alone(scene: bpy.types.Scene) -> None:
    owner = scenes.plane("Wall")
    collection = bpy.data.collections.new("Shadows")
    scene.collection.children.link(collection)
    scene.collection.objects.unlink(owner)
    collection.objects.link(owner)
    bpy.context.view_layer.layer_collection.children["Shadows"].indirect_only = True
    (mesh,) = scenes.export().meshes
    assert (mesh.visible_to_camera, mesh.casts_shadow) == (False, True)


def test_volume_only_materials_are_no_solids(scene: bpy.types.Scene) -> None:
    owner = scenes.plane("Domain")
    owner.data.materials.append(scenes.material("Fog"))
    assert not scenes.export().meshes
    owner.data.materials.clear()
    owner.data.materials.append(scenes.material("Both", surface=True))
    assert len(scenes.export().meshes) == 1


def test_faces_with_volume_only_materials_are_left_out(scene: bpy.types.Scene) -> None:
    owner = scenes.plane("Mixed")
    mesh = owner.data
    mesh.clear_geometry()
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [], [(0, 1, 2), (0, 1, 3)])
    mesh.materials.append(scenes.material("Skin", None, surface=True))
    mesh.materials.append(scenes.material("Fog"))
    mesh.polygons[1].material_index = 1
    (solid,) = scenes.export().meshes
    assert np.allclose(corners(solid)[..., 2], 0) and len(solid.triangles) == 1


def test_edit_mode(scene: bpy.types.Scene) -> None:
    owner = scenes.plane("Edited")
    bpy.context.view_layer.objects.active = owner
    bpy.ops.object.mode_set(mode="EDIT")
    (mesh,) = scenes.export().meshes
    assert area(mesh) == pytest.approx(4)


def test_mesh_without_faces(scene: bpy.types.Scene) -> None:
    mesh = bpy.data.meshes.new("Wire")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0)], [(0, 1)], [])
    scenes.link("Wire", mesh)
    assert not scenes.export().meshes


@pytest.mark.parametrize(
    ("kind", "word"), [("ShaderNodeBsdfTransparent", "opaque"), ("ShaderNodeEmission", "lights no smoke")]
)
def test_looks_that_are_not_modelled_are_named(scene: bpy.types.Scene, kind: str, word: str) -> None:
    look = scenes.material("Pane", None)
    output = next(node for node in look.node_tree.nodes if node.bl_idname == "ShaderNodeOutputMaterial")
    look.node_tree.links.new(look.node_tree.nodes.new(kind).outputs[0], output.inputs["Surface"])
    scenes.plane("Window").data.materials.append(look)
    result = scenes.export()
    assert len(result.meshes) == 1
    assert any("'Window'" in text and "'Pane'" in text and word in text for text in result.warnings)


def test_volume_objects_are_named(scene: bpy.types.Scene) -> None:
    scenes.link("Cloud", bpy.data.volumes.new("Cloud"))
    assert any("'Cloud'" in text for text in scenes.export().warnings)
