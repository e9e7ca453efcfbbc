# SPDX-License-Identifier: GPL-3.0-or-later
"""Light and shadow linking and the ray visibility of smoke, against Cycles of the same Blender.

Two puffs of smoke, Upper and Lower, each a single Gaussian: a point for Fumarole, a cube with a volume for Cycles. A red
lamp shines from above, a green one from the side; between the puffs hangs a wall that the camera doesn't see.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes
from fumarole import core

SIZE = 24
SIGMA, DENSITY, HALF = 0.25, 3.0, 0.85
PUFFS = {"Upper": (0.0, 0.0, 0.9), "Lower": (0.1, 0.0, -0.9)}
RED = 0

has_linking = "light_linking" in bpy.types.Object.bl_rna.properties
shades_itself = bpy.app.version < (5, 0, 0)
needs_linking = pytest.mark.skipif(not has_linking, reason="this Blender has no light linking")


def gaussian_material(center: tuple) -> bpy.types.Material:
    """A volume of which the density is a Gaussian."""
    material = scenes.material("Gaussian", Color=(0.8, 0.8, 0.8, 1))
    tree = material.node_tree
    link = tree.links.new
    offset, squared = tree.nodes.new("ShaderNodeVectorMath"), tree.nodes.new("ShaderNodeVectorMath")
    offset.operation, squared.operation = "SUBTRACT", "DOT_PRODUCT"
    offset.inputs[1].default_value = center
    exponent, power, density = (tree.nodes.new("ShaderNodeMath") for _ in range(3))
    exponent.operation, power.operation, density.operation = "MULTIPLY", "EXPONENT", "MULTIPLY"
    exponent.inputs[1].default_value = -1.0 / (2.0 * SIGMA**2)
    density.inputs[1].default_value = DENSITY
    link(tree.nodes.new("ShaderNodeNewGeometry").outputs["Position"], offset.inputs[0])
    link(offset.outputs["Vector"], squared.inputs[0])
    link(offset.outputs["Vector"], squared.inputs[1])
    link(squared.outputs["Value"], exponent.inputs[0])
    link(exponent.outputs[0], power.inputs[0])
    link(power.outputs[0], density.inputs[0])
    volume = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeVolumePrincipled")
    link(density.outputs[0], volume.inputs["Density"])
    return material


def cube(name: str, center: tuple) -> bpy.types.Object:
    corners = [(x, y, z) for x in (-HALF, HALF) for y in (-HALF, HALF) for z in (-HALF, HALF)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners, [], faces)
    mesh.materials.append(gaussian_material(center))
    return scenes.link(name, mesh, location=center)


@pytest.fixture
def stage(scene: bpy.types.Scene) -> dict[str, list[bpy.types.Object]]:
    """The objects by name: those of Fumarole and of Cycles, or what both have."""
    objects: dict[str, list[bpy.types.Object]] = {}
    for name, center in PUFFS.items():
        points = scenes.points_by_nodes(f"{name} points", [(0, 0, 0)], radius=2 * SIGMA)
        points.location = center
        scenes.set_point_material(points, scenes.material(name, Density=DENSITY, Color=(0.8, 0.8, 0.8, 1)))
        objects[name] = [points, cube(f"{name} cube", center)]
    objects["Wall"] = [scenes.plane("Wall", size=0.5, location=(0.1, 0.0, 0.0))]
    objects["Wall"][0].visible_camera = False
    objects["Red"] = [scenes.light("POINT", 3000, (0.0, 0.0, 5.0), color=(1, 0, 0), shadow_soft_size=0.0)]
    objects["Green"] = [scenes.light("POINT", 3000, (5.0, 0.0, 0.3), color=(0, 1, 0), shadow_soft_size=0.0)]
    scenes.camera(type="ORTHO", ortho_scale=3.6)
    scene.world = None
    scene.render.film_transparent = True
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    return objects


def collection(name: str, *members: tuple[list[bpy.types.Object], str]) -> bpy.types.Collection:
    """A linking collection of objects, each INCLUDE or EXCLUDE."""
    result = bpy.data.collections.new(name)
    for objects, _state in members:
        for owner in objects:
            result.objects.link(owner)
    states = {owner.name: state for objects, state in members for owner in objects}
    for owner, entry in zip(result.objects, result.collection_objects):
        entry.light_linking.link_state = states[owner.name]
    return result


def include_receiver(stage: dict) -> None:
    stage["Red"][0].light_linking.receiver_collection = collection("Lit", (stage["Upper"], "INCLUDE"))


def exclude_receiver(stage: dict) -> None:
    stage["Red"][0].light_linking.receiver_collection = collection("Dark", (stage["Upper"], "EXCLUDE"))


def both_receivers(stage: dict) -> None:
    chosen = collection("Both", (stage["Upper"], "EXCLUDE"), (stage["Lower"], "INCLUDE"))
    stage["Green"][0].light_linking.receiver_collection = chosen


def empty_collection(stage: dict) -> None:
    stage["Red"][0].light_linking.receiver_collection = collection("Empty")


def nested_collection(stage: dict) -> None:
    """The outermost nested collection decides, whatever those in it say; an object's own entry goes before it."""
    inner = collection("Inner", (stage["Lower"], "INCLUDE"), (stage["Upper"], "INCLUDE"))
    middle = bpy.data.collections.new("Middle")
    middle.children.link(inner)
    outer = collection("Outer", (stage["Upper"], "INCLUDE"))
    outer.children.link(middle)
    outer.collection_children[0].light_linking.link_state = "EXCLUDE"
    stage["Red"][0].light_linking.receiver_collection = outer


def shared_collection(stage: dict) -> None:
    chosen = collection("Lit", (stage["Lower"], "INCLUDE"))
    for lamp in ("Red", "Green"):
        stage[lamp][0].light_linking.receiver_collection = chosen


def exclude_blocker(stage: dict) -> None:
    stage["Red"][0].light_linking.blocker_collection = collection("Clear", (stage["Upper"], "EXCLUDE"))


def include_blocker(stage: dict) -> None:
    stage["Red"][0].light_linking.blocker_collection = collection("Blocks", (stage["Lower"], "INCLUDE"))


def exclude_wall(stage: dict) -> None:
    stage["Red"][0].light_linking.blocker_collection = collection("Clear", (stage["Wall"], "EXCLUDE"))


def only_wall_blocks(stage: dict) -> None:
    stage["Red"][0].light_linking.blocker_collection = collection("Blocks", (stage["Wall"], "INCLUDE"))


def no_shadow(stage: dict) -> None:
    for owner in stage["Upper"]:
        owner.visible_shadow = False


def unseen(stage: dict) -> None:
    for owner in stage["Upper"]:
        owner.visible_camera = False


def indirect_only(stage: dict) -> None:
    hidden = bpy.data.collections.new("Hidden")
    bpy.context.scene.collection.children.link(hidden)
    for owner in stage["Upper"]:
        bpy.context.scene.collection.objects.unlink(owner)
        hidden.objects.link(owner)
    bpy.context.view_layer.layer_collection.children["Hidden"].indirect_only = True


def holdout(stage: dict) -> None:
    for owner in stage["Upper"]:
        owner.is_holdout = True


def render_cycles(stage: dict, folder: Path) -> np.ndarray:
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples = 256
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.volume_bounces = 0
    cycles.volume_step_rate = 0.15
    if hasattr(cycles, "volume_biased"):
        cycles.volume_biased = True
    for name in PUFFS:
        stage[name][0].hide_render, stage[name][1].hide_render = True, False
    return scenes.render_combined(folder)


def render_ours(stage: dict, folder: Path) -> np.ndarray:
    bpy.context.scene.render.engine = "FUMAROLE"
    for name in PUFFS:
        stage[name][0].hide_render, stage[name][1].hide_render = False, True
    return scenes.render_combined(folder)


def sums(picture: np.ndarray) -> np.ndarray:
    """Mean of red, green and alpha over the lower and the upper half of the picture, (2, 3)."""
    return picture.reshape(2, -1, 4).mean(axis=1)[:, [0, 1, 3]]


LINKS = [
    include_receiver,
    exclude_receiver,
    both_receivers,
    nested_collection,
    shared_collection,
    exclude_wall,
]
VISIBILITY = [no_shadow, unseen, indirect_only, holdout]

# What the red lamp isn't blocked by any more.
BLOCKERS = {
    exclude_blocker: ("Upper",),
    include_blocker: ("Upper", "Wall"),
    only_wall_blocks: ("Upper", "Lower"),
    exclude_wall: ("Wall",),
}


@pytest.mark.parametrize("change", [pytest.param(change, marks=needs_linking) for change in LINKS] + VISIBILITY)
def test_as_in_cycles(stage: dict, change: Callable[[dict], None], tmp_path: Path) -> None:
    change(stage)
    expected = sums(render_cycles(stage, tmp_path))
    found = sums(render_ours(stage, tmp_path))
    rows = slice(0, 1) if change is no_shadow and shades_itself else slice(0, 2)
    assert np.allclose(found[rows], expected[rows], rtol=0.03, atol=2e-4), (found, expected)


@needs_linking
@pytest.mark.parametrize("change", BLOCKERS)
def test_blockers(stage: dict, change: Callable[[dict], None], tmp_path: Path) -> None:
    """Smoke that a lamp isn't blocked by casts no shadow in it, as without the visibility to shadow rays in Cycles.

    With shadow linking Cycles lets a volume go on shading itself, and before 5.0 without that visibility as well: then
    there is nothing to compare with.
    """
    rows = [row for row, name in enumerate(("Lower", "Upper")) if not (shades_itself and name in BLOCKERS[change])]
    plain = sums(render_ours(stage, tmp_path))[:, RED]
    for name in BLOCKERS[change]:
        for owner in stage[name]:
            owner.visible_shadow = False
    expected = sums(render_cycles(stage, tmp_path))[:, RED]
    for name in BLOCKERS[change]:
        for owner in stage[name]:
            owner.visible_shadow = True
    change(stage)
    found = sums(render_ours(stage, tmp_path))
    assert np.allclose(found[rows, RED], expected[rows], rtol=0.03), (found, expected)
    assert np.abs(found[:, RED] / plain - 1).max() > 0.2


@needs_linking
def test_blockers_that_shade_others_as_in_cycles(stage: dict, tmp_path: Path) -> None:
    exclude_blocker(stage)
    expected, found = sums(render_cycles(stage, tmp_path)), sums(render_ours(stage, tmp_path))
    assert np.allclose(found[0], expected[0], rtol=0.03), (found, expected)


@needs_linking
def test_empty_collection_links_nothing(stage: dict, tmp_path: Path) -> None:
    plain = render_ours(stage, tmp_path)
    empty_collection(stage)
    assert np.array_equal(render_ours(stage, tmp_path), plain)


def sets_of(exported: scenes.Scene, lamp: str, kind: str = "particles") -> list[bool]:
    """Whether a lamp shines on each of the particles or meshes, in the order of their names."""
    (light,) = [light for light in exported.lights if light.owner == lamp]
    items = sorted(getattr(exported, kind), key=lambda item: item.name)
    return [light.light_sets is None or item.light_set in light.light_sets for item in items]


@needs_linking
def test_particle_systems_are_linked_with_their_object(scene: bpy.types.Scene) -> None:
    first, second = scenes.emitter("First"), scenes.emitter("Second")
    lamp = scenes.light("POINT")
    assert sets_of(scenes.export(), "Point") == [True, True]
    lamp.light_linking.receiver_collection = collection("Lit", ([second], "INCLUDE"))
    exported = scenes.export()
    assert sets_of(exported, "Point") == [False, True]
    assert sets_of(exported, "Point", "meshes") == [False, True]
    assert not [text for text in exported.warnings if "ink" in text]


@needs_linking
def test_instances_are_linked_with_what_instances_them(scene: bpy.types.Scene) -> None:
    """As in Cycles: where that is linked to any light, else as themselves."""
    points = scenes.points_by_nodes("Points", [(0, 0, 0)])
    chips = bpy.data.collections.new("Chips")
    scene.collection.objects.unlink(points)
    chips.objects.link(points)
    for name in ("A", "B"):
        empty = scenes.link(name, None)
        empty.instance_type, empty.instance_collection = "COLLECTION", chips
    lamp = scenes.light("POINT")
    lamp.light_linking.receiver_collection = collection("Lit", ([bpy.data.objects["A"]], "INCLUDE"))
    assert sorted(sets_of(scenes.export(), "Point")) == [False, True]
    lamp.light_linking.receiver_collection = collection("Lit", ([points], "INCLUDE"))
    assert sets_of(scenes.export(), "Point") == [True, True]
    both = collection("Lit", ([points], "INCLUDE"), ([bpy.data.objects["A"]], "EXCLUDE"))
    lamp.light_linking.receiver_collection = both
    assert sorted(sets_of(scenes.export(), "Point")) == [False, True]


@needs_linking
def test_lamps_of_instances_are_linked(scene: bpy.types.Scene) -> None:
    scenes.points_by_nodes("A", [(0, 0, 0)])
    second = scenes.points_by_nodes("B", [(0, 0, 0)])
    lamp = scenes.light("POINT")
    lamp.light_linking.receiver_collection = collection("Lit", ([second], "INCLUDE"))
    lamps = bpy.data.collections.new("Lamps")
    scene.collection.objects.unlink(lamp)
    lamps.objects.link(lamp)
    empty = scenes.link("Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", lamps
    assert sets_of(scenes.export(), "Point") == [False, True]


def test_light_that_solids_or_smoke_do_not_see(scene: bpy.types.Scene, tmp_path: Path) -> None:
    scenes.points_by_nodes("Points", [(0, 0, 0)])
    scenes.plane("Floor", size=20, location=(0, 0, -1))
    lamp = scenes.light("SUN", energy=3.0)
    exported = scenes.export()
    assert sets_of(exported, "Sun") == sets_of(exported, "Sun", "meshes") == [True]
    lamp.visible_diffuse = False
    exported = scenes.export()
    assert sets_of(exported, "Sun") == [True] and sets_of(exported, "Sun", "meshes") == [False]
    lamp.visible_diffuse, lamp.visible_volume_scatter = True, False
    exported = scenes.export()
    assert sets_of(exported, "Sun") == [False] and sets_of(exported, "Sun", "meshes") == [True]
    assert any("no lights" in text for text in exported.warnings)


def test_shadow_pass_leaves_out_what_lights_no_solid(scene: bpy.types.Scene, tmp_path: Path) -> None:
    points = scenes.points_by_nodes("Points", [(0, 0, 0)], radius=1.0)
    scenes.set_point_material(points, scenes.material("Smoke", Density=4.0))
    scenes.plane("Floor", size=40, location=(0, 0, -1))
    lamp = scenes.light("SUN", energy=3.0)
    scenes.camera(location=(0, 0, 9), rotation=(0, 0, 0))
    scene.render.engine = "FUMAROLE"
    scene.render.resolution_x = scene.render.resolution_y = 16
    bpy.context.view_layer.use_pass_shadow = True
    name = f"{bpy.context.view_layer.name}.Shadow.R"
    assert scenes.render_channels(tmp_path)[name].min() < 0.7
    lamp.visible_diffuse = False
    assert (scenes.render_channels(tmp_path)[name] == 1).all()


@needs_linking
def test_too_many_sets_are_an_error_that_names_the_object(scene: bpy.types.Scene) -> None:
    owners = [scenes.plane(f"Plane {number:02}", size=0.1) for number in range(core.LINK_SETS + 1)]
    for number in range(7):
        lamp = scenes.light("POINT")
        chosen = [owner for place, owner in enumerate(owners) if place >> number & 1]
        lamp.light_linking.receiver_collection = collection(f"Lit {number}", (chosen, "INCLUDE"))
    with pytest.raises(AssertionError, match="exporter raised"):
        scenes.export()
    scene.render.engine = "FUMAROLE"
    with pytest.raises(RuntimeError, match="'Plane 64': light linking makes more than 64 different sets"):
        bpy.ops.render.render()


def test_smoke_as_a_holdout_is_named(scene: bpy.types.Scene) -> None:
    owner = scenes.points_by_nodes("Points", [(0, 0, 0)])
    assert not [text for text in scenes.export().warnings if "holdout" in text]
    owner.is_holdout = True
    assert any("'Points'" in text and "holdout" in text for text in scenes.export().warnings)
