# SPDX-License-Identifier: GPL-3.0-or-later
"""Persistent data: what is kept from one render to the next changes no pixel."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes
from fumarole import engine


@pytest.fixture
def smoke() -> bpy.types.Object:
    """Points above a solid, lit from above, with persistent data on."""
    random = np.random.default_rng(1)
    owner = scenes.points_by_nodes("Points", random.normal(0, 0.6, (200, 3)).tolist())
    scenes.set_point_material(owner, scenes.material("Smoke", Density=6.0, Color=(0.8, 0.7, 0.6, 1)))
    scenes.plane("Blocker", size=0.7, location=(0, 0, 1.5))
    scenes.light("POINT", energy=2000, location=(0, -3, 4))
    scenes.camera()
    bpy.context.scene.render.use_persistent_data = True
    return owner


def render(folder: Path, is_persistent: bool = True) -> tuple[np.ndarray, float]:
    """The picture and the seconds that building octrees and hierarchies took."""
    bpy.context.scene.render.use_persistent_data = is_persistent
    picture = scenes.render_combined(folder)
    return picture, engine.last_stats().build_s


def move_camera() -> None:
    bpy.context.scene.camera.location.x += 0.5


def change_light() -> None:
    bpy.data.lights["Point"].energy *= 2


def remove_light() -> None:
    bpy.data.objects.remove(bpy.data.objects["Point"])
    scenes.light("SUN", energy=3)


def move_point() -> None:
    bpy.data.meshes["Points"].vertices[7].co.x += 0.2
    bpy.data.meshes["Points"].update()


def move_points() -> None:
    bpy.data.objects["Points"].location.z += 0.2


def volume_node() -> bpy.types.Node:
    nodes = bpy.data.materials["Smoke"].node_tree.nodes
    return next(node for node in nodes if node.bl_idname == "ShaderNodeVolumePrincipled")


def change_material() -> None:
    volume_node().inputs["Anisotropy"].default_value = 0.4


def change_tint() -> None:
    volume_node().inputs["Absorption Color"].default_value = (0.0, 0.3, 0.9, 1)


def move_mesh() -> None:
    bpy.data.objects["Blocker"].location.x += 0.2


def bend_mesh() -> None:
    bpy.data.meshes["Blocker"].vertices[0].co.x -= 0.5
    bpy.data.meshes["Blocker"].update()


def hide_mesh() -> None:
    bpy.data.objects["Blocker"].visible_shadow = False


def link_light() -> None:
    linking = getattr(bpy.data.objects["Point"], "light_linking", None)
    if linking is None:
        pytest.skip("this Blender has no light linking")
    linking.receiver_collection = bpy.data.collections.new("Lit")
    linking.receiver_collection.objects.link(bpy.data.objects["Blocker"])
    scenes.light("SUN", energy=3)


def link_blocker() -> None:
    linking = getattr(bpy.data.objects["Point"], "light_linking", None)
    if linking is None:
        pytest.skip("this Blender has no light linking")
    linking.blocker_collection = bpy.data.collections.new("Blocks")
    linking.blocker_collection.objects.link(bpy.data.objects["Blocker"])


def hide_smoke() -> None:
    bpy.data.objects["Points"].visible_camera = False


def hide_shadow_of_smoke() -> None:
    bpy.data.objects["Points"].visible_shadow = False


@pytest.mark.parametrize("change", [move_camera, change_light, remove_light])
def test_matter_is_kept(smoke: bpy.types.Object, change: Callable[[], None], tmp_path: Path) -> None:
    before, build_s = render(tmp_path)
    assert build_s > 0
    change()
    after, build_s = render(tmp_path)
    assert build_s == 0
    fresh, build_s = render(tmp_path, is_persistent=False)
    assert build_s > 0
    assert np.array_equal(after, fresh)
    assert not np.array_equal(before, after)


CHANGES = [
    move_point,
    move_points,
    change_material,
    change_tint,
    move_mesh,
    bend_mesh,
    hide_mesh,
    link_light,
    link_blocker,
    hide_smoke,
    hide_shadow_of_smoke,
]


@pytest.mark.parametrize("change", CHANGES)
def test_changed_matter_is_built_again(
    smoke: bpy.types.Object, change: Callable[[], None], tmp_path: Path
) -> None:
    before, _ = render(tmp_path)
    change()
    after, build_s = render(tmp_path)
    assert build_s > 0
    fresh, _ = render(tmp_path, is_persistent=False)
    assert np.array_equal(after, fresh)
    assert not np.array_equal(before, after)


def test_a_new_colour_of_a_solid_is_seen(smoke: bpy.types.Object, tmp_path: Path) -> None:
    bpy.context.scene.fumarole.solids = "SHADED"
    paint = scenes.material("Paint", None, surface=True)
    blocker = bpy.data.objects["Blocker"]
    blocker.data.materials.append(paint)
    blocker.rotation_euler.x = 1.2  # to face the camera and the light
    before, _ = render(tmp_path)
    paint.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.1, 0.2, 0.3, 1)
    after, _ = render(tmp_path)
    fresh, _ = render(tmp_path, is_persistent=False)
    assert np.array_equal(after, fresh)
    assert not np.array_equal(before, after)


def test_animated_camera(smoke: bpy.types.Object, tmp_path: Path) -> None:
    camera = bpy.context.scene.camera
    for frame, x in ((1, 0.0), (2, 0.5)):
        camera.location.x = x
        camera.keyframe_insert("location", frame=frame)
    pictures = {}
    for is_persistent in (True, False):
        for frame in (1, 2):
            bpy.context.scene.frame_set(frame)
            pictures[is_persistent, frame], build_s = render(tmp_path, is_persistent)
            assert (build_s == 0) == (is_persistent and frame == 2)
    assert all(np.array_equal(pictures[True, frame], pictures[False, frame]) for frame in (1, 2))


@pytest.mark.parametrize("moves", [False, True])
def test_an_animation_builds_again_only_where_particles_move(moves: bool, tmp_path: Path) -> None:
    """A particle system, seen by a camera that moves."""
    scene = bpy.context.scene
    scene.render.use_persistent_data = True
    owner = scenes.emitter(normal_factor=1.0 if moves else 0.0)
    owner.data.materials.append(scenes.material("Smoke", Density=6.0))
    scenes.light("POINT", energy=2000, location=(0, -3, 4))
    camera = scenes.camera()
    for frame in (1, 4):
        camera.location.x = 0.2 * frame
        camera.keyframe_insert("location", frame=frame)
    scene.frame_start, scene.frame_end = 1, 4
    scenes.bake()
    scenes.exr_output(tmp_path / "f_")
    built: list[bool] = []
    bpy.app.handlers.render_post.append(lambda *_: built.append(engine.last_stats().build_s > 0))
    try:
        bpy.ops.render.render(animation=True)
    finally:
        bpy.app.handlers.render_post.pop()
    assert built == [True, moves, moves, moves]


def test_settings_count(smoke: bpy.types.Object, tmp_path: Path) -> None:
    """What is built with settings of its own follows them."""
    render(tmp_path)
    bpy.context.scene.fumarole.subsampling = 0.5
    after, build_s = render(tmp_path)
    assert build_s > 0
    fresh, _ = render(tmp_path, is_persistent=False)
    assert np.array_equal(after, fresh)


def test_nothing_is_kept_when_off(smoke: bpy.types.Object, tmp_path: Path) -> None:
    render(tmp_path, is_persistent=False)
    assert engine._keeper.is_empty
    render(tmp_path)
    assert not engine._keeper.is_empty
    render(tmp_path, is_persistent=False)
    assert engine._keeper.is_empty


def test_another_file_frees_what_is_kept(smoke: bpy.types.Object, tmp_path: Path) -> None:
    render(tmp_path)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert engine._keeper.is_empty


def test_disabling_frees_what_is_kept(smoke: bpy.types.Object, tmp_path: Path) -> None:
    render(tmp_path)
    keeper = engine._keeper
    engine.unregister()
    try:
        assert keeper.is_empty
        assert engine._keeper is None
    finally:
        engine.register()


def test_memory_does_not_grow(smoke: bpy.types.Object, tmp_path: Path) -> None:
    used = []
    for _frame in range(4):
        move_camera()
        render(tmp_path)
        used.append(engine.last_stats().memory_bytes)
    assert used[3] <= used[1]
