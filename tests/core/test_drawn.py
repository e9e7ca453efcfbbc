# SPDX-License-Identifier: GPL-3.0-or-later
"""Close particles are drawn as one. The same pictures particle by particle: the pass Albedo draws them once more, for
which each is needed."""

from __future__ import annotations

import numpy as np
import pytest

from clouds import FRONT, SIDE, WALL, cloud, lit, smoke
from fumarole import core

BALL = cloud(40_000, 0.16, 4e-3)  # n sigma^3 = 4.9


def render(
    particles: dict, is_full: bool, lights: tuple = (SIDE,), wall: tuple = (), threads: int = 0, **view
) -> core.RenderResult:
    tolerance = view.pop("tolerance", 0.01)
    camera = core.Camera(**({"matrix": FRONT, "lens": 60, "width": 400, "height": 300} | view))
    settings = core.Settings(device="TILES", tolerance=tolerance)
    scene = lit(particles, lights, wall, threads)
    return core.render(scene, camera, settings, ("Combined", "Albedo") if is_full else ("Combined",))


def difference(found: np.ndarray, full: np.ndarray) -> float:
    """Relative RMS."""
    return float(np.sqrt(((found - full) ** 2).mean() / (full**2).mean()))


VIEWS = {
    "perspective": {},
    "wide": {"lens": 14, "matrix": [[1, 0, 0, 2], [0, 1, 0, 1], [0, 0, 1, 3.5], [0, 0, 0, 1]]},
    "orthographic": {"type": "ORTHOGRAPHIC", "ortho_scale": 3.0},
    "cut by a wall": {"wall": WALL},
}


@pytest.mark.parametrize("name", VIEWS)
def test_same_as_particle_by_particle(name: str) -> None:
    """Within a fifth of the tolerance; opacity closer, and as much of it in all."""
    found, full = (render(BALL, is_full, **VIEWS[name]) for is_full in (False, True))
    assert found.stats.drawn_count == full.stats.drawn_count > 30_000
    a, b = (np.asarray(result["Combined"], float) for result in (found, full))
    assert difference(a[..., :3], b[..., :3]) < 2e-3
    assert 1e-5 < difference(a[..., 3], b[..., 3]) < 1e-3
    assert a[..., 3].mean() == pytest.approx(b[..., 3].mean(), rel=2e-4)


def line_integrals(places: np.ndarray, sigma: float, depth: float, lens: float) -> np.ndarray:
    """Optical depth along the rays of 400 x 300 pixels of the one Gaussian that has the moments of equal particles at
    `places`, seen from 0 along -z; `depth`: of all of them at one place."""
    u = ((np.arange(400) + 0.5) / 400 - 0.5) * 36 / lens
    v = ((np.arange(300) + 0.5) / 400 - 0.375) * 36 / lens
    rays = np.stack(np.broadcast_arrays(u, v[:, None], -1.0), -1)
    centre = places.mean(0)
    covariance = sigma**2 * np.eye(3) + np.cov(places.T, bias=True)
    precision = np.linalg.inv(covariance)
    along = np.einsum("yxi,ij,yxj->yx", rays, precision, rays)
    mixed = np.einsum("yxi,ij,j->yx", rays, precision, centre)
    left = centre @ precision @ centre - mixed**2 / along
    peak = depth * sigma**2 / np.sqrt(np.linalg.det(covariance) * along / (rays**2).sum(-1))
    return peak * np.exp(-0.5 * left)


@pytest.mark.parametrize("middle", [(0.0, 0.0, -8.0), (3.0, -2.0, -6.0)])
@pytest.mark.parametrize("across", [(1, 0, 0), (0, 0, 1), (1, -2, 1), (1, 1, 3)])
def test_two_heaps_are_one_gaussian(middle: tuple, across: tuple) -> None:
    """Thousands of particles at two places share a cell: one Gaussian with their moments, in closed form."""
    sigma, depth, lens = 0.05, 0.02, 25.0
    offset = 0.7 * sigma * np.array(across) / np.abs(across).max()
    places = np.array([middle - offset, middle + offset])
    particles = smoke(np.repeat(places, 6000, axis=0), 2 * sigma, depth / 12_000)
    result = render(particles, False, lights=(), matrix=np.eye(4), lens=lens)
    expected = -np.expm1(-line_integrals(places, sigma, depth, lens))
    found = np.asarray(result["Combined"], float)[..., 3]
    assert result.stats.drawn_count == 12_000
    assert np.abs(found - expected).max() < 6e-3 * expected.max()
    assert found.sum() == pytest.approx(expected.sum(), rel=2e-3)


@pytest.mark.parametrize(
    "particles, view",
    [
        (BALL, {"tolerance": 0.001}),
        (cloud(9000, 0.25, 4e-3), {}),  # few: each is seen
        (cloud(40_000, 0.05, 0.02), {}),  # far apart
        (cloud(40_000, 0.16, 0.5), {}),  # thick
        (BALL | {"albedo": np.random.default_rng(1).uniform(size=(40_000, 3))}, {}),  # of many looks
        (cloud(40_000, 0.16, 4e-3), {"width": 20, "height": 15}),  # narrow against pixels
    ],
)
def test_particles_that_are_drawn_by_themselves(particles: dict, view: dict) -> None:
    """Bit by bit: these pictures are too small for the grid of test_coarse.py."""
    view = {"width": 150, "height": 112} | view
    found, full = (render(particles, is_full, **view)["Combined"] for is_full in (False, True))
    assert np.array_equal(found, full)


def test_as_close_to_the_reference() -> None:
    scene = lit(BALL, (SIDE,))
    camera = core.Camera(matrix=FRONT, lens=60, width=400, height=300)
    window = (250, 150, 258, 156)
    expected = core.render_reference(scene, camera.crop(*window), tolerance=1e-4, passes=("Combined",))["Combined"]
    left, bottom, right, top = window
    for passes in (("Combined",), ("Combined", "Albedo")):
        found = core.render(scene, camera, core.Settings(device="TILES"), passes)["Combined"][bottom:top, left:right]
        assert difference(found[..., :3].astype(float), expected[..., :3].astype(float)) < 5e-3


def test_threads_change_no_bit() -> None:
    one, four = (render(BALL, False, threads=threads)["Combined"] for threads in (1, 4))
    assert np.array_equal(one, four)
