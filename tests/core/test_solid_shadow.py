# SPDX-License-Identifier: GPL-3.0-or-later
"""What solids let through to the smoke, and how far light in the smoke is off: the passes Solid Shadow and Error."""

from __future__ import annotations

import numpy as np
import pytest

from fumarole import core

SHADOW, LIGHT_SHADOW = "Solid Shadow", "Light Solid Shadow"


def at(x: float, y: float, z: float) -> list[list[float]]:
    return [[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z], [0, 0, 0, 1]]


SIDEWAYS = [[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]]  # light comes along -X


def cloud(density: float = 0.6, **particles: object) -> core.Scene:
    scene = core.Scene()
    positions = np.random.default_rng(4).normal(0.0, 0.7, (400, 3))
    scene.add_particles(positions, radius=0.5, density=density, **particles)
    return scene


def add_wall(scene: core.Scene, x: float, **changes: object) -> None:
    """Blocks the light from beyond +X in the half of the space where y is above 0."""
    corners = [(x, 0, -9), (x, 9, -9), (x, 9, 9), (x, 0, 9)]
    scene.add_mesh(corners, [(0, 1, 2), (0, 2, 3)], **{"visible_to_camera": False} | changes)


def camera(**changes: object) -> core.Camera:
    return core.Camera(**{"matrix": at(0, 0, 8), "width": 64, "height": 64} | changes)


def test_solid_shadow_is_light_with_solids_over_light_without() -> None:
    passes = ("Combined", SHADOW, (LIGHT_SHADOW, 0), (LIGHT_SHADOW, 1))
    results = {}
    for is_blocked in (False, True):
        scene = cloud(albedo=(0.9, 0.6, 0.3))
        if is_blocked:
            add_wall(scene, 4.0)
        scene.add_light("SUN", SIDEWAYS, power=3.0)
        scene.add_light("POINT", at(0, -3, 4), power=300.0, color=(0.2, 0.5, 1.0))
        results[is_blocked] = core.render(scene, camera(), passes=passes)
    clear, blocked = results[False], results[True]
    assert (clear[SHADOW] == 1).all()
    shown = clear["Combined"][..., 3] > 0.02
    ratio = blocked["Combined"][..., :3] / np.maximum(clear["Combined"][..., :3], 1e-12)
    assert ratio[shown].min() < 0.9, "there is a shadow"
    assert np.abs(blocked[SHADOW] - ratio)[shown].max() < 5e-3
    assert np.abs(blocked[LIGHT_SHADOW, 1] - 1).max() < 1e-3, "nothing stands before the point light"
    sun = blocked[LIGHT_SHADOW, 0]
    assert sun[40:, :][shown[40:, :]].max() < 0.05, "behind the wall it is dark"
    assert np.abs(sun[:24][shown[:24]] - 1).max() < 1e-3
    assert (blocked[SHADOW][clear["Combined"][..., 3] == 0] == 1).all()


def test_smoke_shades_alike_with_solids_and_without() -> None:
    """A window in front of dense smoke: what smoke blocks isn't a shadow of solids, nor is what it emits in the dark."""
    scene = cloud(density=3.0, emission=(2.0, 1.0, 0.0))
    add_wall(scene, 4.0)
    scene.add_light("SUN", SIDEWAYS, power=3.0)
    result = core.render(scene, camera(), passes=("Combined", SHADOW))
    shown = result["Combined"][..., 3] > 0.1
    assert np.abs(result[SHADOW][:24][shown[:24]] - 1).max() < 2e-3
    assert result[SHADOW][40:][shown[40:]].max() < 0.05


def test_half_a_shadow() -> None:
    """The artistic setting lets half of the light through."""
    scene = cloud()
    add_wall(scene, 4.0)
    scene.add_light("SUN", SIDEWAYS, power=3.0)
    result = core.render(scene, camera(), core.Settings(solid_shadow_intensity=0.5), ("Combined", SHADOW))
    dark = result[SHADOW][42:][result["Combined"][42:, :, 3] > 0.02]
    assert np.abs(dark - 0.5).max() < 2e-3


def test_opengl_has_no_solid_shadow_and_no_error() -> None:
    for name in (SHADOW, "Error", (LIGHT_SHADOW, 0)):
        scene = cloud()
        scene.add_light("SUN")
        with pytest.raises(core.FumaroleError, match="use the device tiles"):
            core.render(scene, camera(), core.Settings(device="GL"), [name])


def plume(count: int = 40_000) -> core.Scene:
    scene = core.Scene()
    random = np.random.default_rng(9)
    positions = random.normal(0.0, 1.0, (count, 3))
    scene.add_particles(positions, radius=0.12, density=0.6)
    scene.add_light("POINT", at(5, 2, 3), power=500.0)
    return scene


def test_error_is_small_and_agrees_with_the_meter() -> None:
    settings = core.Settings(solver="SWEEP")
    result = core.render(plume(), camera(lens=60), settings, ("Combined", "Error"))
    error = result["Error"][..., 0][result["Combined"][..., 3] > 0.05]
    rms = float(np.sqrt(np.mean(error.astype(float) ** 2)))
    assert 0 < rms < 5e-3
    assert 0.2 < rms / result.stats.accuracy_rms < 5, "two samples of the same errors"
    assert (result["Error"][result["Combined"][..., 3] == 0] == 0).all()


def test_error_shows_what_a_coarse_tolerance_costs() -> None:
    scene = cloud(density=4.0)
    scene.add_light("SUN", SIDEWAYS, power=3.0)
    rms = {}
    for tolerance in (0.2, 0.005):
        error = core.render(scene, camera(), core.Settings(tolerance=tolerance), ["Error"])["Error"].astype(float)
        rms[tolerance] = np.sqrt(np.mean(error**2))
    assert rms[0.2] > 4 * rms[0.005]
    assert np.abs(rms[0.005]) < 3e-3


def test_error_is_signed_light_used_less_light_found() -> None:
    """Shadows thinned out by a setting are no error: both sides have them. A light nearby, in perspective."""
    scene = cloud(density=2.0)
    scene.add_light("POINT", at(1.5, 0.0, 1.5), power=100.0)
    for settings in (core.Settings(), core.Settings(shadowing_density=0.3, subsampling=0.5)):
        error = core.render(scene, camera(), settings, ["Error"])["Error"]
        assert 0 < np.abs(error).max() < 0.02


def test_error_leaves_out_lights_that_shine_on_no_smoke() -> None:
    scene = cloud(density=2.0)
    scene.add_light("SUN", SIDEWAYS, power=3.0)
    alone = core.render(scene, camera(), passes=["Error"])["Error"]
    scene.add_light("POINT", at(0, 0, 4), power=500.0, light_sets=[5])
    assert (core.render(scene, camera(), passes=["Error"])["Error"] == alone).all()


def test_passes_do_not_depend_on_threads() -> None:
    pictures = []
    for threads in (1, 3):
        scene = core.Scene(core.Context(threads=threads))
        positions = np.random.default_rng(4).normal(0.0, 0.7, (400, 3))
        scene.add_particles(positions, radius=0.5, density=0.6, velocity=(1.0, 0.5, 0.0))
        add_wall(scene, 1.0, visible_to_camera=True)
        scene.add_light("SUN", SIDEWAYS, power=3.0)
        passes = (SHADOW, "Error", "Albedo", "Vector", ("CryptoObject", 0))
        result = core.render(scene, camera(), passes=passes)
        pictures.append([result[name] for name in passes])
    assert all((one == other).all() for one, other in zip(*pictures))
