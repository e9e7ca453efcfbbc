# SPDX-License-Identifier: GPL-3.0-or-later
"""Solids in the picture against the same scenes by Cycles."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes
from scenes import cube, paint, put_in

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "scripts"))

import compare_cycles  # noqa: E402

SIZE = 20
SIGMA = 0.45
SMOKE = np.array([(*place, SIGMA, 1.6) for place in ((-0.6, 0.0, 0.3), (0.3, -0.3, 0.0), (0.9, 0.5, 0.5))])


def build(monkeypatch: pytest.MonkeyPatch, size: int = SIZE) -> None:
    """The smoke of both engines under a sun and a point light, seen a little from above."""
    monkeypatch.setattr(compare_cycles, "GAUSSIANS", SMOKE)
    lamps = (
        ("POINT", {"power": 500.0, "color": (1.0, 0.9, 0.8)}, (2.0, -2.0, 2.5), (0, 0, 0)),
        ("SUN", {"power": 2.0, "color": (0.7, 0.85, 1.0)}, (0, 0, 5.0), (0.5, 0.3, 0)),
    )
    monkeypatch.setattr(compare_cycles, "LAMPS", lamps[:1])
    compare_cycles.build_blender_scene(size, step=0.08)
    bpy.data.objects.remove(bpy.data.objects["Wall"])
    _, sun, _, rotation = lamps[1]
    lamp = scenes.light("SUN", sun["power"], color=sun["color"], angle=0.0)
    lamp.rotation_euler = rotation
    particles = scenes.points_by_nodes("Particles", [tuple(row[:3]) for row in SMOKE], radius=2 * SIGMA)
    fog = scenes.material(
        "Fog",
        Color=(*compare_cycles.ALBEDO, 1),
        Density=float(SMOKE[0, 4]),
        Anisotropy=compare_cycles.ANISOTROPY,
    )
    scenes.set_point_material(particles, fog)
    view = bpy.context.scene.camera
    view.location, view.rotation_euler = (0, -7, 3.5), (math.pi / 2 - math.atan2(3.5, 7), 0, 0)
    view.data.lens = 60
    cycles = bpy.context.scene.cycles
    cycles.max_bounces = 0
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0


def by_cycles(samples: int = 64, runs: int = 4) -> np.ndarray:
    """(height, width, 4), premultiplied."""
    bpy.context.scene.render.engine = "CYCLES"
    particles = bpy.data.objects.get("Particles")
    if particles is not None:
        particles.hide_render = True
    return np.mean([compare_cycles.render_cycles(samples, 1001 * run) for run in range(runs)], axis=0)


def by_fumarole(folder: Path) -> np.ndarray:
    scene = bpy.context.scene
    scene.render.engine = "FUMAROLE"
    scene.fumarole.light_samples = 64
    for owner in scene.objects:
        owner.hide_render = owner.name == "Smoke"
    return scenes.render_combined(folder).astype(float)


def relative_rms(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.sqrt(((found - expected) ** 2).mean() / (expected**2).mean()))


def check(found: np.ndarray, expected: np.ndarray, pixels: float, squares: float) -> None:
    """Relative RMS of RGB, and RMS of alpha, of single pixels, where edges are told to a sixteenth and Cycles is noisy, and
    of squares of 4 x 4."""
    blocks = (len(found) // 4, 4, len(found) // 4, 4, 4)
    for a, b, limit, limit_of_alpha in (
        (found, expected, pixels, 0.025),
        (found.reshape(blocks).mean((1, 3)), expected.reshape(blocks).mean((1, 3)), squares, 0.01),
    ):
        assert relative_rms(a[..., :3], b[..., :3]) < limit
        assert np.sqrt(((a[..., 3] - b[..., 3]) ** 2).mean()) < limit_of_alpha
    ratio = found[..., :3].mean((0, 1)) / expected[..., :3].mean((0, 1))
    assert (np.abs(ratio - 1) < squares).all()


def holdouts() -> list[bpy.types.Object]:
    """A wall behind the smoke, a cube within it, a wall in front."""
    behind = scenes.plane("Behind", 1.6, location=(0.7, 2.2, 0.3), rotation=(70, 20, 0))
    within = cube("Within", 0.35, (0.2, -0.1, 0.2), (20, 30, 40))
    in_front = scenes.plane("In Front", 0.9, location=(-0.7, -1.9, 0.7), rotation=(60, -30, 10))
    return [behind, within, in_front]


@pytest.mark.parametrize("is_transparent", [True, False])
def test_holdouts_are_those_of_cycles(
    scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, is_transparent: bool
) -> None:
    build(monkeypatch)
    solids = holdouts()
    for owner in solids:
        owner.is_holdout = True
    scene = bpy.context.scene
    scene.render.film_transparent = is_transparent
    expected = by_cycles()
    found = by_fumarole(tmp_path)
    check(found, expected, 0.1, 0.03)
    assert expected[..., 3].min() < 0.1
    assert expected[..., 3].max() > (0.6 if is_transparent else 0.999)
    for owner in solids:
        owner.visible_camera = False
    without = by_fumarole(tmp_path)
    assert relative_rms(without[..., :3], expected[..., :3]) > 0.1, "they matter"


def test_a_holdout_before_a_background(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """Where nothing else is: black and transparent, whatever the film."""
    scenes.camera()
    scenes.plane("Wall", 2, rotation=(90, 30, 0)).is_holdout = True
    world = bpy.data.worlds.new("World")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.2, 0.4, 0.6, 1)
    scene.world = world
    scene.render.resolution_x = scene.render.resolution_y = 32
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 1.0
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    for is_transparent in (False, True):
        scene.render.film_transparent = is_transparent
        expected, found = by_cycles(256, 1), by_fumarole(tmp_path)
        assert np.abs(found - expected).max() < 0.13, "an edge is told to a sixteenth"
        assert np.sqrt(((found - expected) ** 2).mean()) < 0.01
    scene.render.film_transparent = False
    opaque = by_fumarole(tmp_path)
    assert opaque[..., 3].min() == 0 and opaque[..., 3].max() == 1
    assert np.allclose(opaque[opaque[..., 3] == 1][:, :3], (0.2, 0.4, 0.6))


def still_life() -> None:
    """A floor, a cube and walls of which each has another flag."""
    floor = scenes.plane("Floor", 8, location=(0, 0, -1.2))
    paint(floor, Color=(0.5, 0.5, 0.5, 1))
    paint(cube("Cube", 0.4, (-0.9, -0.6, -0.8), (0, 0, 30)), Color=(0.8, 0.3, 0.1, 1))
    bpy.ops.mesh.primitive_uv_sphere_add(segments=24, ring_count=12, radius=0.5, location=(1.1, -0.4, -0.7))
    ball = bpy.context.object
    for face in ball.data.polygons:
        face.use_smooth = True
    paint(ball, Color=(0.3, 0.6, 0.8, 1))


def test_a_shaded_scene_is_that_of_cycles(
    scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    build(monkeypatch)
    still_life()
    scene = bpy.context.scene
    expected = by_cycles()
    scene.fumarole.solids = "SHADED"
    found = by_fumarole(tmp_path)
    check(found, expected, 0.03, 0.01)
    scene.fumarole.solids = "HOLDOUT"
    assert relative_rms(by_fumarole(tmp_path)[..., :3], expected[..., :3]) > 0.3


def test_flags_are_those_of_cycles(scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Holdouts, walls that only cast shadows and one that casts none, among shaded solids."""
    build(monkeypatch)
    still_life()
    flat = {"rotation": (10, 0, 0)}
    flagged = {
        "Holdout": scenes.plane("Holdout", 0.8, location=(0.6, -1.2, 0.2), rotation=(70, 0, 0)),
        "Holdout of a Collection": scenes.plane("Of a Collection", 0.7, location=(-1.2, 0.2, 0.9), rotation=(60, 0, 0)),
        "Indirect": scenes.plane("Indirect", 0.8, location=(0.9, 0.2, 1.5), **flat),
        "Unseen": scenes.plane("Unseen", 0.7, location=(-0.3, -0.2, 1.4), **flat),
        "Shadowless": scenes.plane("Shadowless", 0.8, location=(1.3, -0.9, 1.0), **flat),
    }
    for owner in flagged.values():
        paint(owner, Color=(0.2, 0.6, 0.3, 1))
    flagged["Holdout"].is_holdout = True
    put_in(flagged["Holdout of a Collection"], "Held", holdout=True)
    put_in(flagged["Indirect"], "Indirect", indirect_only=True)
    flagged["Unseen"].visible_camera = False
    flagged["Shadowless"].visible_shadow = False
    scene = bpy.context.scene
    scene.fumarole.solids = "SHADED"
    expected = by_cycles()
    found = by_fumarole(tmp_path)
    check(found, expected, 0.035, 0.012)
    assert expected[..., 3].min() < 0.4
    for flag, value in (("is_holdout", False), ("visible_camera", True), ("visible_shadow", True)):
        before = {name: getattr(owner, flag) for name, owner in flagged.items()}
        for owner in flagged.values():
            setattr(owner, flag, value)
        changed = by_fumarole(tmp_path)
        assert relative_rms(changed[..., :3], expected[..., :3]) > 0.05, f"{flag} matters"
        for name, owner in flagged.items():
            setattr(owner, flag, before[name])


LAMPS = {
    "point": ("POINT", {"energy": 100.0, "shadow_soft_size": 0.4}),
    "sun": ("SUN", {"energy": 2.0, "angle": 0.3}),
    "spot": ("SPOT", {"energy": 300.0, "spot_size": 1.2, "spot_blend": 0.5, "shadow_soft_size": 0.1}),
    "square": ("AREA", {"energy": 100.0, "size": 0.8, "spread": 2.0}),
    "ellipse": ("AREA", {"energy": 100.0, "shape": "ELLIPSE", "size": 0.8, "size_y": 0.4}),
}


@pytest.mark.parametrize("name", LAMPS)
def test_each_light_on_a_floor_is_that_of_cycles(scene: bpy.types.Scene, tmp_path: Path, name: str) -> None:
    """With the shadow of a cube."""
    kind, settings = LAMPS[name]
    energy = settings["energy"]
    options = {key: value for key, value in settings.items() if key != "energy"}
    scenes.light(kind, energy, (0.7, -0.4, 2.5), (10, 12, 0), **options)
    paint(scenes.plane("Floor", 9), Color=(0.8, 0.4, 0.2, 1))
    paint(cube("Cube", 0.3, (-0.3, 0.2, 0.5), (0, 0, 20)), Color=(0.3, 0.6, 0.9, 1))
    scenes.camera((0, -4, 4), (45, 0, 0), lens=40)
    scene.render.resolution_x = scene.render.resolution_y = 24
    scene.render.film_transparent = True
    scene.fumarole.solids = "SHADED"
    cycles = scene.cycles
    cycles.max_bounces, cycles.use_adaptive_sampling, cycles.use_denoising = 0, False, False
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    expected, found = by_cycles(512, 1), by_fumarole(tmp_path)
    check(found, expected, 0.035, 0.012)
