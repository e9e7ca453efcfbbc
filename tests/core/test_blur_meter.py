# SPDX-License-Identifier: GPL-3.0-or-later
"""The meter of blur: what one picture by mean optical depths is off by, against closed forms and many pictures."""

from __future__ import annotations

import numpy as np
import pytest

from fumarole import core

SIDE = 48


def camera(x: float = 0.0, **changes: object) -> core.Camera:
    matrix = [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 6], [0, 0, 0, 1]]
    return core.Camera(
        **{"matrix": matrix, "type": "ORTHOGRAPHIC", "ortho_scale": 4.0, "width": SIDE, "height": SIDE} | changes
    )


def puff(depth: float, velocity: tuple[float, float, float] = (0.0, 0.0, 0.0), x: float = 0.0) -> core.Scene:
    """One particle of sigma 0.2 with an optical depth through its centre."""
    scene = core.Scene()
    scene.add_particles([(x, 0, 0)], radius=0.4, density=depth / (0.2 * np.sqrt(2 * np.pi)), velocity=velocity)
    return scene


def depth_of_puff(x: np.ndarray, y: np.ndarray, depth: float) -> np.ndarray:
    return depth * np.exp(-(x**2 + y**2) / (2 * 0.2**2))


def error_of_means(depths: np.ndarray) -> float:
    """Of opacities with mean optical depths; `depths` [instant][pixel]."""
    truth = (1 - np.exp(-depths)).mean(0)
    return float(np.sqrt(np.mean((truth - (1 - np.exp(-depths.mean(0)))) ** 2) / np.mean(truth**2)))


def grid() -> tuple[np.ndarray, np.ndarray]:
    axis = (np.arange(200) + 0.5) / 50 - 2
    return np.meshgrid(axis, axis)


@pytest.mark.parametrize("depth", [0.1, 1.0, 8.0])
def test_error_of_a_moving_puff_is_that_of_the_closed_form(depth: float) -> None:
    x, y = grid()
    ways = np.linspace(-0.5, 0.5, 201)
    expected = error_of_means(np.array([depth_of_puff(x - way, y, depth) for way in ways]))
    found = core.measure_blur(puff(depth, (2.0, 0, 0)), camera().blurred((-0.25, 0.25)))
    assert found.error == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize("depth", [0.1, 1.0, 8.0])
def test_error_of_a_defocused_puff_is_that_of_the_closed_form(depth: float) -> None:
    """Two metres before the focus at eight: the circle of confusion is a quarter of the aperture."""
    x, y = grid()
    radius, angle = np.sqrt((np.arange(400) + 0.5) / 400), np.arange(400) * 2.399963
    places = 0.6 * np.stack([radius * np.cos(angle), radius * np.sin(angle)])
    expected = error_of_means(np.array([depth_of_puff(x - a, y - b, depth) for a, b in places.T]))
    found = core.measure_blur(puff(depth), camera().blurred(aperture=core.Aperture(radius=2.4, focus=8.0)))
    assert found.error == pytest.approx(expected, rel=0.15)


def test_a_moving_camera_is_a_moving_puff() -> None:
    moving = camera().moving(camera(-2.0), camera(2.0))
    by_camera = core.measure_blur(puff(4.0), moving.blurred((-0.25, 0.25)))
    by_puff = core.measure_blur(puff(4.0, (-2.0, 0, 0)), camera().blurred((-0.25, 0.25)))
    assert by_camera.error == pytest.approx(by_puff.error, rel=1e-3)
    assert by_camera.samples == by_puff.samples > 1


def test_thin_smoke_and_sharp_pictures_need_one() -> None:
    assert core.measure_blur(puff(0.01, (2.0, 0, 0)), camera().blurred((-0.25, 0.25))).samples == 1
    assert core.measure_blur(puff(8.0, (2.0, 0, 0)), camera()) == core.Blur(0.0, 1)
    assert core.measure_blur(puff(8.0), camera().blurred((-0.25, 0.25))).error < 1e-6
    in_focus = camera().blurred(aperture=core.Aperture(radius=0.2, focus=6.0))
    assert core.measure_blur(puff(1.0), in_focus).samples == 1
    assert core.measure_blur(core.Scene(), in_focus) == core.Blur(0.0, 1)


def test_samples_grow_with_the_motion_and_with_what_is_asked_for() -> None:
    slow, fast = (core.measure_blur(puff(4.0, (v, 0, 0)), camera().blurred((-0.25, 0.25))) for v in (0.4, 4.0))
    assert 1 < slow.samples < fast.samples
    exact = core.measure_blur(puff(4.0, (0.4, 0, 0)), camera().blurred((-0.25, 0.25)), core.Settings(tolerance=1e-3))
    assert exact.samples > slow.samples


@pytest.mark.parametrize("depth", [1.0, 6.0])
def test_samples_are_enough(depth: float) -> None:
    """Means of as many pictures by mean optical depths, and not of a third of them."""
    x, y = grid()
    tolerance = 0.01
    found = core.measure_blur(puff(depth, (3.0, 0, 0)), camera().blurred((-0.25, 0.25)))

    def error(samples: int) -> float:
        ways = (np.arange(480) + 0.5) / 480 * 1.5 - 0.75
        depths = np.array([depth_of_puff(x - way, y, depth) for way in ways[:: 480 // 240]])
        truth = (1 - np.exp(-depths)).mean(0)
        parts = np.array_split(depths, samples)
        mean = np.mean([1 - np.exp(-part.mean(0)) for part in parts], axis=0)
        return float(np.sqrt(np.mean((truth - mean) ** 2) / np.mean(truth**2)))

    assert error(found.samples) < 1.2 * tolerance
    assert error(max(1, found.samples // 3)) > tolerance


def test_solids_edges_are_seen() -> None:
    """A puff half behind a wall while the camera moves: smears are cut where the wall is in the middle of the shutter."""
    scene = puff(0.05)
    wall = [(0.0, -9, 1), (9, -9, 1), (9, 9, 1), (0.0, 9, 1)]
    scene.add_mesh(wall, [(0, 1, 2), (0, 2, 3)])
    moving = camera().moving(camera(-1.0), camera(1.0)).blurred((-0.25, 0.25))
    assert core.measure_blur(scene, moving).error > 0.1
    assert core.measure_blur(puff(0.05), moving).error < 0.01


def test_edges_out_of_focus_are_seen() -> None:
    """A wall halfway to the smoke in focus: smears end where the lens's middle sees its edge."""
    scene = puff(0.05)
    scene.add_mesh([(0.0, -9, 3), (9, -9, 3), (9, 9, 3), (0.0, 9, 3)], [(0, 1, 2), (0, 2, 3)])
    in_focus = camera().blurred(aperture=core.Aperture(radius=0.4, focus=6.0))
    assert core.measure_blur(scene, in_focus).error > 0.1
    assert core.measure_blur(puff(0.05), in_focus).error < 1e-3


def test_bits_do_not_depend_on_threads_and_order() -> None:
    rng = np.random.default_rng(1)
    positions, velocities = rng.uniform(-1, 1, (3000, 3)), rng.normal(0, 0.5, (3000, 3))
    moving = camera().blurred((-0.25, 0.25), core.Aperture(radius=0.2, focus=8.0))
    found = []
    for threads in (1, 3):
        with core.Context(threads) as context:
            scene = core.Scene(context)
            scene.add_particles(positions, radius=0.1, density=2.0, velocity=velocities)
            found.append(core.measure_blur(scene, moving))
    assert found[0] == found[1]
    assert found[0].error > 0


def test_wrong_camera_is_an_error() -> None:
    with pytest.raises(core.FumaroleError, match="focus_distance is 0"):
        core.measure_blur(puff(1.0), camera().blurred(aperture=core.Aperture(radius=1.0, focus=0.0)))
