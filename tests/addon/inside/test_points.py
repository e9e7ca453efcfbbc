# SPDX-License-Identifier: GPL-3.0-or-later
"""Point clouds as they are exported."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
import scenes

THREE = [(0, 0, 0), (1, 0, 0), (0, 2, 0)]


def test_points_of_geometry_nodes(scene: bpy.types.Scene) -> None:
    owner = scenes.points_by_nodes("Cloud", THREE, radius=0.3)
    owner.location, owner.scale = (5, 0, 0), (2, 2, 2)
    (item,) = scenes.export().particles
    assert np.allclose(item.positions, [(5, 0, 0), (7, 0, 0), (5, 4, 0)])
    assert np.allclose(item.radii, 0.6)
    assert item.velocities is None
    assert len(np.unique(item.ids)) == 3


def test_point_cloud_object(scene: bpy.types.Scene) -> None:
    if "pointcloud_random_add" in dir(bpy.ops.object):
        bpy.ops.object.pointcloud_random_add()
    else:
        bpy.context.preferences.experimental.use_new_point_cloud_type = True
        bpy.ops.object.pointcloud_add()
    cloud = bpy.context.object
    cloud.location = (0, 0, 5)
    local = np.empty(3 * len(cloud.data.points), dtype=np.float32)
    cloud.data.attributes["position"].data.foreach_get("vector", local)
    radii = np.empty(len(cloud.data.points), dtype=np.float32)
    cloud.data.attributes["radius"].data.foreach_get("value", radii)
    (item,) = scenes.export().particles
    assert len(item.positions) == 400
    assert np.allclose(item.positions, local.reshape(-1, 3) + (0, 0, 5), atol=1e-6)
    assert np.array_equal(item.radii, radii)


def test_empty_point_cloud_object(scene: bpy.types.Scene) -> None:
    scenes.link("Empty", bpy.data.pointclouds.new("Empty"))
    assert not scenes.export().particles


def test_points_on_instances_differ_in_place_and_id(scene: bpy.types.Scene) -> None:
    owner = scenes.points_by_nodes("Cloud", THREE)
    collection = bpy.data.collections.new("Clouds")
    scene.collection.objects.unlink(owner)
    collection.objects.link(owner)
    for x in (0, 10):
        empty = scenes.link("Instance", None, location=(x, 0, 0))
        empty.instance_type, empty.instance_collection = "COLLECTION", collection
    first, second = scenes.export().particles
    assert np.allclose(np.abs(second.positions - first.positions), (10, 0, 0))
    assert len(np.intersect1d(first.ids, second.ids)) == 0


@pytest.mark.parametrize(("smoke", "count"), [("AUTOMATIC", 1), ("SMOKE", 1), ("NOT_SMOKE", 0)])
def test_switch(scene: bpy.types.Scene, smoke: str, count: int) -> None:
    owner = scenes.points_by_nodes("Cloud", THREE, radius=0.5)
    owner.fumarole.smoke = smoke
    owner.fumarole.radius_scale = 2.0
    items = scenes.export().particles
    assert len(items) == count
    assert all(np.allclose(item.radii, 1) for item in items)


def test_attributes_by_name(scene: bpy.types.Scene) -> None:
    colours = [(1, 0, 0, 1), (0, 0.5, 0, 1), (0, 0, 0.25, 1)]
    attributes = {
        "density": ("FLOAT", [1, 2, 3]),
        "tint": ("FLOAT_COLOR", colours),
        "velocity": ("FLOAT_VECTOR", [(1, 0, 0), (0, 1, 0), (0, 0, 1)]),
        "id": ("INT", [30, 10, 20]),
    }
    owner = scenes.points_by_nodes("Cloud", THREE, attributes=attributes)
    owner.rotation_euler.z = np.pi / 2
    look = scenes.material("Smoke", Density=4.0, Color=(1, 1, 1, 1), Color_Attribute="tint")
    scenes.set_point_material(owner, look)
    (item,) = scenes.export().particles
    assert np.allclose(item.volume.extinction, [4, 8, 12])
    assert np.allclose(item.volume.albedo, np.array(colours)[:, :3])
    a_frame = scene.render.fps_base / scene.render.fps
    assert np.allclose(item.velocities, np.array([(0, 1, 0), (-1, 0, 0), (0, 0, 1)]) * a_frame, atol=1e-6)
    assert list(item.ids & np.uint64(0xFFFFFFFF)) == [30, 10, 20]


def test_attribute_nodes(scene: bpy.types.Scene) -> None:
    owner = scenes.points_by_nodes("Cloud", THREE, attributes={"thick": ("FLOAT", [1, 2, 3])})
    look = scenes.material("Smoke", "ShaderNodeVolumeScatter", Color=(0.5, 0.5, 0.5, 1))
    node = look.node_tree.nodes.new("ShaderNodeAttribute")
    node.attribute_name = "thick"
    scatter = next(node for node in look.node_tree.nodes if node.bl_idname == "ShaderNodeVolumeScatter")
    look.node_tree.links.new(node.outputs["Fac"], scatter.inputs["Density"])
    scenes.set_point_material(owner, look)
    result = scenes.export()
    assert np.allclose(result.particles[0].volume.extinction, [0.5, 1, 1.5])
    node.attribute_name = "missing"
    result = scenes.export()
    assert np.allclose(result.particles[0].volume.extinction, 0)
    assert any("'missing'" in text and "'Smoke'" in text for text in result.warnings)


def test_points_without_material_are_grey_with_a_warning(scene: bpy.types.Scene) -> None:
    scenes.points_by_nodes("Cloud", THREE)
    result = scenes.export()
    assert np.allclose(result.particles[0].volume.albedo, 0.8)
    assert any("'Cloud'" in text and "no material" in text for text in result.warnings)
