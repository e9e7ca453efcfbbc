# SPDX-License-Identifier: GPL-3.0-or-later
"""Particle systems as they are exported."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
import scenes

ALIVE = 3


def exported_and_alive() -> tuple[scenes.Scene, list[int]]:
    """The export, and Blender's own count of living particles in each system of the same depsgraph."""
    alive: list[int] = []

    def count(depsgraph: bpy.types.Depsgraph, _export: scenes.Scene) -> None:
        for instance in depsgraph.object_instances:
            for system in instance.object.particle_systems:
                states = [particle.alive_state for particle in system.particles]
                alive.append(states.count("ALIVE"))

    (result,) = scenes.export_layers(count)
    return result.scene, alive


@pytest.mark.parametrize("frame", [1, 7, 15, 30])
def test_count_is_that_of_living_particles(scene: bpy.types.Scene, frame: int) -> None:
    scenes.emitter(frame_end=20, lifetime=8)
    scenes.bake()
    scene.frame_set(frame)
    result, alive = exported_and_alive()
    assert sum(len(item.positions) for item in result.particles) == alive[0]
    assert frame == 30 or alive[0] > 0


def test_positions_after_a_jump_are_those_of_playing_when_baked(scene: bpy.types.Scene) -> None:
    scenes.emitter(frame_end=20, brownian_factor=2.0)
    scenes.bake()
    for frame in range(1, 13):
        scene.frame_set(frame)
    played = scenes.export().particles[0]
    scene.frame_set(1)
    scene.frame_set(12)
    jumped = scenes.export()
    assert np.array_equal(jumped.particles[0].positions, played.positions)
    assert np.array_equal(jumped.particles[0].ids, played.ids)
    assert not [text for text in jumped.warnings if "bake" in text]


def test_velocity_is_metres_a_frame(scene: bpy.types.Scene) -> None:
    scenes.emitter(time_tweak=1.5)
    scene.render.fps, scene.render.fps_base = 25, 1.25
    scenes.bake()
    scene.frame_set(5)
    before = scenes.export().particles[0]
    scene.frame_set(6)
    after = scenes.export().particles[0]
    moved = after.positions - before.positions
    assert np.array_equal(before.ids, after.ids)
    assert np.allclose(moved, before.velocities, atol=1e-4)
    assert np.allclose(np.linalg.norm(moved, axis=1), 0.06, rtol=1e-3)


def test_ids_stay_with_their_particles_and_differ_between_systems(scene: bpy.types.Scene) -> None:
    scenes.emitter("First", count=50, frame_end=10, lifetime=6)
    scenes.emitter("Second", count=50, frame_end=10, lifetime=6)
    scenes.bake()
    scene.frame_set(6)
    early = scenes.export().particles
    scene.frame_set(9)
    late = scenes.export().particles
    assert len(np.intersect1d(early[0].ids, early[1].ids)) == 0
    common, at_early, at_late = np.intersect1d(early[0].ids, late[0].ids, return_indices=True)
    assert 0 < len(common) < len(early[0].ids)
    moved = late[0].positions[at_late] - early[0].positions[at_early]
    assert np.allclose(moved, (0, 0, 3 * 0.04), atol=1e-4)


def test_radius_is_size_times_scale(scene: bpy.types.Scene) -> None:
    owner = scenes.emitter(particle_size=0.25)
    owner.particle_systems[0].settings.fumarole.radius_scale = 3.0
    assert np.allclose(scenes.export().particles[0].radii, 0.75)


@pytest.mark.parametrize(
    ("render_type", "smoke", "expected"),
    [
        ("HALO", "AUTOMATIC", True),
        ("HALO", "NOT_SMOKE", False),
        ("NONE", "AUTOMATIC", False),
        ("NONE", "SMOKE", True),
        ("LINE", "AUTOMATIC", False),
        ("PATH", "AUTOMATIC", False),
        ("OBJECT", "AUTOMATIC", False),
        ("OBJECT", "SMOKE", True),
        ("COLLECTION", "AUTOMATIC", False),
        ("COLLECTION", "NOT_SMOKE", False),
    ],
)
def test_render_types(scene: bpy.types.Scene, render_type: str, smoke: str, expected: bool) -> None:
    owner = scenes.emitter(count=5, render_type=render_type)
    settings = owner.particle_systems[0].settings
    settings.fumarole.smoke = smoke
    cube = scenes.plane("Chip", size=0.1)
    if render_type == "OBJECT":
        settings.instance_object = cube
    if render_type == "COLLECTION":
        settings.instance_collection = bpy.data.collections.new("Chips")
        settings.instance_collection.objects.link(cube)
    result = scenes.export()
    assert bool(result.particles) == expected
    chips = [mesh for mesh in result.meshes if "Chip" in mesh.name]
    instanced = render_type in ("OBJECT", "COLLECTION") and not expected
    assert len(chips) == (6 if instanced else 1)


def test_hair_is_no_smoke(scene: bpy.types.Scene) -> None:
    owner = scenes.emitter(count=5, type="HAIR")
    owner.particle_systems[0].settings.fumarole.smoke = "SMOKE"
    assert not scenes.export().particles


def test_hidden_in_the_viewport_is_rendered(scene: bpy.types.Scene) -> None:
    owner = scenes.emitter(count=20)
    owner.hide_viewport = True
    owner.modifiers[0].show_viewport = False
    result = scenes.export()
    assert len(result.particles[0].positions) == 20


@pytest.mark.parametrize("how", ["object", "modifier"])
def test_hidden_in_renders_is_not(scene: bpy.types.Scene, how: str) -> None:
    owner = scenes.emitter(count=20)
    if how == "object":
        owner.hide_render = True
    else:
        owner.modifiers[0].show_render = False
    assert not scenes.export().particles


@pytest.mark.parametrize("shown", [True, False])
def test_emitter_is_solid_when_it_is_shown(scene: bpy.types.Scene, shown: bool) -> None:
    owner = scenes.emitter(count=20)
    owner.show_instancer_for_render = shown
    result = scenes.export()
    assert len(result.particles) == 1
    assert len(result.meshes) == shown


def test_instanced_emitter(scene: bpy.types.Scene) -> None:
    owner = scenes.emitter(count=20)
    owner.location = (1, 2, 3)
    collection = bpy.data.collections.new("Smoke")
    scene.collection.objects.unlink(owner)
    collection.objects.link(owner)
    empty = scenes.link("Instance", None, location=(10, 0, 0))
    empty.scale = (2, 2, 2)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    other = scenes.link("Other", None)
    other.instance_type, other.instance_collection = "COLLECTION", collection
    big, plain = sorted(scenes.export().particles, key=lambda item: -item.radii[0])
    assert np.allclose(big.radii, 0.4) and np.allclose(plain.radii, 0.2)
    assert np.allclose(big.positions, plain.positions * 2 + (10, 0, 0), atol=1e-5)
    assert np.allclose(big.velocities, plain.velocities * 2, atol=1e-5)
    assert len(np.intersect1d(big.ids, plain.ids)) == 0


def test_display_amount_changes_no_baked_render(scene: bpy.types.Scene) -> None:
    owner = scenes.emitter(count=100)
    settings = owner.particle_systems[0].settings
    settings.display_percentage = 10
    scenes.bake()
    result = scenes.export()
    assert len(result.particles[0].positions) == 100
    assert not [text for text in result.warnings if "bake" in text]


def test_unbaked_display_amount_is_named(scene: bpy.types.Scene) -> None:
    owner = scenes.emitter("Fire", count=100)
    owner.particle_systems[0].settings.display_percentage = 10
    (warning,) = [text for text in scenes.export().warnings if "baked" in text]
    assert "'Fire'" in warning and "10 %" in warning


def test_material_is_that_of_the_systems_slot(scene: bpy.types.Scene) -> None:
    owner = scenes.emitter()
    owner.data.materials.append(scenes.material("Thin", Density=2.0))
    owner.data.materials.append(scenes.material("Thick", Density=7.0))
    owner.particle_systems[0].settings.material = 2
    assert np.allclose(scenes.export().particles[0].volume.extinction, 7)
    owner.particle_systems[0].settings.material = 1
    assert np.allclose(scenes.export().particles[0].volume.extinction, 2)


def test_emitter_that_also_makes_points_is_exported_once(scene: bpy.types.Scene) -> None:
    owner = scenes.points_by_nodes("Both", [(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    bpy.context.view_layer.objects.active = owner
    owner.modifiers.new("Smoke", "PARTICLE_SYSTEM")
    settings = owner.particle_systems[0].settings
    settings.count, settings.frame_end, settings.emit_from = 20, 1, "VERT"
    bpy.ops.object.modifier_move_to_index(modifier="Smoke", index=0)
    result = scenes.export()
    assert sorted(len(item.positions) for item in result.particles) == [3, 20]
