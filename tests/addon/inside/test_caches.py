# SPDX-License-Identifier: GPL-3.0-or-later
"""Caches that don't hold what a frame needs are named."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest
import scenes

LAST = 12


def about_caches() -> list[str]:
    others = ("no smoke", "no lights", "no material")
    return [text for text in scenes.export().warnings if not any(other in text for other in others)]


def fire() -> bpy.types.PointCache:
    """Particles whose cache ends soon."""
    owner = scenes.emitter("Größe", count=50, lifetime=LAST - 2)
    cache = owner.particle_systems[0].point_cache
    cache.frame_end = LAST
    return cache


@pytest.fixture
def disk(tmp_path: Path) -> Path:
    """The folder of the disk cache of fire()."""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.b.blend"))
    cache = fire()
    cache.use_disk_cache = True
    scenes.bake()
    folder = tmp_path / "blendcache_a.b"
    assert len(list(folder.glob("*.bphys"))) >= cache.frame_end == LAST
    return folder


def test_a_jump_is_named_the_same_in_every_frame(scene: bpy.types.Scene) -> None:
    fire()
    texts = []
    for frame in (8, 9):
        scene.frame_set(frame)
        texts += about_caches()
    assert len(texts) == 2 and texts[0] == texts[1]
    assert "Particle system 'Smoke' of 'Größe' isn't baked and wasn't played from its first frame, 1" in texts[0]


@pytest.mark.parametrize("step", [1, 5])
def test_what_was_played_or_baked_is_right(scene: bpy.types.Scene, step: int) -> None:
    cache = fire()
    cache.frame_step = step
    for frame in range(1, 10):
        scene.frame_set(frame)
        assert not about_caches()
    scenes.bake()
    scene.frame_set(2)
    scene.frame_set(7)
    assert not about_caches()


def test_whole_disk_cache(scene: bpy.types.Scene, disk: Path) -> None:
    for frame in (1, 7, LAST + 5):
        scene.frame_set(frame)
        assert not about_caches()


def test_lost_disk_cache(scene: bpy.types.Scene, disk: Path) -> None:
    for file in disk.iterdir():
        file.unlink()
    scene.frame_set(7)
    (text,) = about_caches()
    assert text == f"Particle system 'Smoke' of 'Größe': its cache has no files in '{disk}': its positions are wrong"


def test_gap_in_a_disk_cache(scene: bpy.types.Scene, disk: Path) -> None:
    for frame in (5, 6):
        (file,) = disk.glob(f"*_{frame:06d}_00.bphys")
        file.unlink()
    scene.frame_set(7)
    (text,) = about_caches()
    assert "'Größe': of 12 frames of its cache 2 are missing" in text and "the first is 5: its positions" in text


def test_moved_file_leaves_its_disk_cache_behind(scene: bpy.types.Scene, disk: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    moved = tmp_path / "elsewhere" / "a.b.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(moved), copy=True)
    bpy.ops.wm.open_mainfile(filepath=str(moved))
    (text,) = about_caches()
    assert "no files in" in text and str(tmp_path / "elsewhere" / "blendcache_a.b") in text


def test_external_cache(scene: bpy.types.Scene, disk: Path) -> None:
    cache = bpy.data.objects["Größe"].particle_systems[0].point_cache
    bpy.ops.ptcache.free_bake_all()
    for file in disk.iterdir():
        file.unlink()
    cache.use_external = True
    cache.name = "from_afar"
    cache.filepath = str(disk.parent / "nowhere")
    (text,) = about_caches()
    assert "'Größe': its cache has no files in" in text and "nowhere" in text


def test_cloth_that_was_not_played_is_named(scene: bpy.types.Scene) -> None:
    owner = scenes.plane("Curtain")
    owner.modifiers.new("Cloth", "CLOTH").point_cache.frame_end = LAST
    scene.frame_set(8)
    (text,) = about_caches()
    assert "Modifier 'Cloth' of 'Curtain' isn't baked" in text
    scenes.bake()
    assert not about_caches()


def test_files_of_modifiers(scene: bpy.types.Scene, tmp_path: Path) -> None:
    owner = scenes.plane("Wall")
    modifier = owner.modifiers.new("Moves", "MESH_CACHE")
    assert not about_caches()
    modifier.filepath = str(tmp_path / "lost.pc2")
    (text,) = about_caches()
    assert text == f"Modifier 'Moves' of 'Wall': there is no file '{tmp_path}/lost.pc2', so that it does nothing"
    modifier.show_render = False
    assert not about_caches()


def test_lost_alembic_file(scene: bpy.types.Scene, tmp_path: Path) -> None:
    if not bpy.app.alembic.supported:
        pytest.skip("this Blender has no Alembic")
    path = tmp_path / "wall.abc"
    owner = scenes.plane("Wall")
    owner.scale.x = 2
    owner.keyframe_insert("scale", frame=1)
    owner.shape_key_add(name="Basis")
    bent = owner.shape_key_add(name="Bent")
    bent.data[0].co.x -= 1
    for frame in (1, 2):
        bent.value = frame - 1
        bent.keyframe_insert("value", frame=frame)
    bpy.ops.wm.alembic_export(filepath=str(path), start=1, end=2, as_background_job=False)
    bpy.data.objects.remove(owner)
    bpy.ops.wm.alembic_import(filepath=str(path), as_background_job=False)
    assert any(modifier.type == "MESH_SEQUENCE_CACHE" for modifier in bpy.data.objects["Wall"].modifiers)
    assert not about_caches()
    path.unlink()
    (text,) = about_caches()
    assert "of 'Wall': there is no file" in text and "wall.abc" in text
