# SPDX-License-Identifier: GPL-3.0-or-later
"""The reference from Python: clouds, soft lights and solids, and the fast renderer where it must agree."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fumarole import core

FRONT = np.array([[1, 0, 0, 0], [0, 0, -1, -6.0], [0, 1, 0, 0], [0, 0, 0, 1]])


def at(x: float, y: float, z: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def camera(size: int = 16, **settings) -> core.Camera:
    return core.Camera(**{"matrix": FRONT, "lens": 60, "width": size, "height": size} | settings)


def ball(count: int, depth: float, seed: int = 1) -> dict:
    """Random particles in a ball of radius 1, overlapping (n sigma^3 = 0.5), `depth` thick across."""
    rng = np.random.default_rng(seed)
    position = rng.normal(size=(count, 3))
    position *= rng.random((count, 1)) ** (1 / 3) / np.linalg.norm(position, axis=1, keepdims=True)
    sigma = (0.5 * 4 / 3 * math.pi / count) ** (1 / 3)
    return {"position": position, "radius": 2 * sigma, "density": depth / ((2 * math.pi) ** 1.5), "albedo": 0.9}


def scene_of(particles: dict, *lights: dict) -> core.Scene:
    scene = core.Scene(core.Context())
    scene.add_particles(**particles)
    for light in lights:
        scene.add_light(**light)
    return scene


def relative_rms(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.sqrt(((found - expected) ** 2).mean() / (expected**2).mean()))


SIDE = {"type": "POINT", "matrix": at(4, -1, 1), "power": 1000.0, "color": (1.0, 0.5, 0.25)}


def test_result_and_stats() -> None:
    result = core.render_reference(scene_of(ball(50, 3), SIDE), camera(12), passes=("Combined", "Depth"))
    assert set(result) == {"Combined", "Depth"}
    assert result["Combined"].shape == (12, 12, 4) and result["Depth"].shape == (12, 12, 1)
    assert result["Combined"].dtype == result["Depth"].dtype == np.float64
    stats = result.stats
    assert stats.particle_count == 50 and stats.light_sample_count == 1 and stats.unconverged_count == 0
    assert 0 < stats.error < 1e-4 and stats.step_count > 144 and stats.total_s > 0
    colors = result["Combined"][..., :3]
    assert colors[..., 1] == pytest.approx(colors[..., 0] * 0.5)


def test_converges_in_tolerance() -> None:
    scene = scene_of(ball(200, 10), SIDE)
    truth = core.render_reference(scene, camera(), tolerance=1e-8)["Combined"]
    for tolerance in (1e-2, 1e-4, 1e-6):
        result = core.render_reference(scene, camera(), tolerance=tolerance)
        error = relative_rms(result["Combined"][..., :3], truth[..., :3])
        assert error <= tolerance and error <= 3 * result.stats.error + 1e-7


def test_many_small_particles_are_drawn_as_the_reference() -> None:
    """The fast renderer converges to the reference: colour, alpha and depth."""
    scene = scene_of(ball(20_000, 0.7), SIDE, {"type": "SUN", "power": 2.0})
    view = camera(16, lens=350)  # pixels smaller than the particles
    reference = core.render_reference(scene, view, tolerance=1e-3, passes=("Combined", "Depth"))
    fast = core.render(scene, view)
    assert relative_rms(fast["Combined"][..., :3], reference["Combined"][..., :3]) < 0.02
    assert np.abs(fast["Combined"][..., 3] - reference["Combined"][..., 3]).max() < 0.005
    seen = reference["Depth"] < 100
    assert np.abs(fast["Depth"] - reference["Depth"])[seen].max(initial=0.0) < 0.01


def test_slab_of_overlapping_particles_is_homogeneous() -> None:
    """A lattice one sigma apart is homogeneous: lit along the view by a sun it is a p E (1 - exp(-2 tau)) / 2 bright; lit
    from the side, the light's optical depth grows with the distance from the slab's edge."""
    step, extinction = 0.1, 1.0
    ticks = np.arange(-1.0 + step / 2, 1.0, step)
    position = np.stack(np.meshgrid(ticks, ticks, ticks), -1).reshape(-1, 3)
    density = extinction * step**3 / ((2 * math.pi) ** 1.5 * step**3)
    lattice = {"position": position, "radius": 2 * step, "density": density, "albedo": 1.0}
    view = core.Camera(matrix=at(0, 0, 5), type="ORTHOGRAPHIC", ortho_scale=0.8, width=8, height=8)
    above = core.render_reference(scene_of(lattice, {"type": "SUN", "power": 1.0}), view)["Combined"]
    expected = (1 - math.exp(-2 * 2.0 * extinction)) / 2 / (4 * math.pi)
    assert above[..., 0] == pytest.approx(expected, rel=2e-3)
    assert above[..., 3] == pytest.approx(1 - math.exp(-2.0 * extinction), rel=2e-3)
    west = np.array([[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1.0]])  # shines along -x
    side = core.render_reference(scene_of(lattice, {"type": "SUN", "power": 1.0, "matrix": west}), view)["Combined"]
    z = np.linspace(2.0, -2.0, 4001)[:, None]
    local = np.exp(-((z - ticks) ** 2) / (2 * step**2)).sum(1, keepdims=True) * extinction / math.sqrt(2 * math.pi)
    dz = 4.0 / 4000
    x = (np.arange(8) + 0.5) / 8 * 0.8 - 0.4
    integrand = local * np.exp(-(np.cumsum(local, 0) - local / 2) * dz - local * (1.0 - x))  # thinner near the faces
    assert side[..., 0] == pytest.approx(np.tile(integrand.sum(0) * dz / (4 * math.pi), (8, 1)), rel=2e-3)


@pytest.mark.parametrize(
    ("light", "far"),
    [
        ({"type": "POINT", "radius": 0.3}, 5e-3),
        ({"type": "SPOT", "radius": 0.3, "spot_angle": 1.5}, 5e-3),
        ({"type": "AREA", "size": 0.6}, 2e-2),
        ({"type": "AREA", "size": 0.6, "shape": "DISK", "spread": 2.0}, 2e-2),
        ({"type": "SUN", "angle": 0.2}, 2e-2),
    ],
)
def test_soft_lights_converge(light: dict, far: float) -> None:
    """More samples change little; one sample of each is a hard light, which differs as little as the light is small."""
    particles = ball(20, 3)
    lamp = light | {"matrix": at(0.2, 0.3, 4.0), "power": 100.0}
    view = camera(4)
    pictures = {
        samples: core.render_reference(scene_of(particles, lamp), view, tolerance=1e-4, light_samples=samples)
        for samples in (1, 64, 256)
    }
    assert [result.stats.light_sample_count for result in pictures.values()] == [1, 64, 256]
    rgb = {samples: result["Combined"][..., :3] for samples, result in pictures.items()}
    assert relative_rms(rgb[64], rgb[256]) < 1e-3
    assert relative_rms(rgb[1], rgb[256]) < far


def test_penumbra_of_a_wall() -> None:
    """Thin smoke over a wall's edge under a strip light: light grows with the share of the strip that is seen."""
    ticks = np.arange(-0.75, 0.76, 0.1)
    position = np.stack(np.meshgrid(ticks, [0.0], ticks), -1).reshape(-1, 3)
    scene = scene_of({"position": position, "radius": 0.2, "density": 1e-4, "albedo": 1.0})
    scene.add_light("AREA", matrix=at(0, 0, 10), size=2.0, size_y=1e-3, shape="RECTANGLE", power=100.0)
    wall = [(-9, -9, 5), (0, -9, 5), (0, 9, 5), (-9, 9, 5)]
    view = core.Camera(matrix=FRONT, type="ORTHOGRAPHIC", ortho_scale=1.0, width=16, height=2)
    open_sky = core.render_reference(scene, view)["Combined"][..., 0]
    scene.add_mesh(wall, [(0, 1, 2), (0, 2, 3)], visible_to_camera=False)
    shaded = core.render_reference(scene, view, tolerance=1e-3)["Combined"][..., 0]
    x = (np.arange(16) + 0.5) / 16 - 0.5
    z = np.array([-0.5, 0.5])[:, None] / 16
    edge = x + (0 - x) * (10 - z) / (5 - z)  # of the strip, seen from (x, z) past the wall's edge
    strip = np.linspace(-1, 1, 2001)[:, None, None]
    strength = (10 - z) / ((10 - z) ** 2 + (strip - x) ** 2) ** 1.5
    expected = np.where(strip > edge, strength, 0).sum(0) / strength.sum(0)
    assert shaded / open_sky == pytest.approx(expected, abs=0.003)


def test_errors_name_the_value() -> None:
    scene = scene_of(ball(5, 1), SIDE)
    for settings, message in (
        ({"tolerance": 1.0}, "tolerance 1 "),
        ({"tolerance": math.nan}, "tolerance nan"),
        ({"light_samples": 0}, "light_samples 0"),
        ({"light_samples": 1.5}, "light_samples is 1.5"),
        ({"passes": ("Mist",)}, "no pass 'Mist'"),
    ):
        with pytest.raises(core.FumaroleError, match=message):
            core.render_reference(scene, camera(), **settings)


def test_cancel() -> None:
    context = core.Context(progress=lambda stage, fraction, message: fraction > 0.01)
    scene = core.Scene(context)
    scene.add_particles(**ball(500, 5))
    scene.add_light(**SIDE)
    with pytest.raises(core.Cancelled):
        core.render_reference(scene, camera(64))
