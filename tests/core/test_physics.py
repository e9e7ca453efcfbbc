# SPDX-License-Identifier: GPL-3.0-or-later
"""Physics of whole clouds: laws that hold for any number of particles (DESIGN.md, section 1)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fumarole import core

ABOVE = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 20.0], [0, 0, 0, 1]])
UPSIDE_DOWN = np.diag([1.0, -1.0, -1.0, 1.0])
FRAME = {"matrix": ABOVE, "type": "ORTHOGRAPHIC", "ortho_scale": 1.0, "width": 16, "height": 16}


def slab(count: int, depth: float, radius: float, seed: int = 1, half: float = 1.0) -> dict[str, np.ndarray | float]:
    """Uniform random particles within half a metre of z = 0 that are `depth` thick on average along z."""
    position = np.random.default_rng(seed).uniform((-half, -half, -0.5), (half, half, 0.5), (count, 3))
    weight = count / (2 * half) ** 2 * (2 * math.pi) ** 1.5 * (radius / 2) ** 3
    return {"position": position.astype(np.float32), "radius": radius, "density": depth / weight}


def picture(particles: dict, lights: list[dict], camera: dict = FRAME, threads: int = 0, **settings) -> np.ndarray:
    scene = core.Scene(core.Context(threads=threads))
    scene.add_particles(**particles)
    for light in lights:
        scene.add_light(**light)
    return core.render(scene, core.Camera(**camera), core.Settings(**settings), passes=("Combined",))["Combined"]


@pytest.mark.parametrize("depth", [0.01, 0.5, 2.0, 6.0])
def test_slab_obeys_beer_lambert(depth: float) -> None:
    """Towards the camera and towards a light: T = exp(-tau); the random density is averaged as optical depth."""
    particles = slab(60_000, depth, radius=0.12)
    alpha = picture(particles, [])[..., 3]
    # 1 - alpha keeps a thin slab's optical depth to the rounding of alpha
    assert -np.log1p(-alpha.astype(float)).mean() == pytest.approx(depth, rel=0.01)
    scene = core.Scene(core.Context())
    scene.add_particles(**particles)
    scene.add_light("SUN")
    grid = np.stack(np.meshgrid(*[np.linspace(-0.45, 0.45, 16)] * 2, [-2.0]), -1).reshape(-1, 3)
    light = core.transmittance(scene, grid)
    assert -np.log(light.astype(float)).mean() == pytest.approx(depth, rel=0.01)


def test_sun_behind_and_before_the_camera() -> None:
    """Light along the view: a p E (1 - exp(-2 tau)) / 2 from behind the camera, a p E tau exp(-tau) towards it, tau
    being the pixel's own optical depth. Both are limits of many thin particles."""
    albedo, strength, depth = 0.7, 3.0, 1.5
    particles = slab(400_000, depth, radius=0.06) | {"albedo": albedo}
    source = albedo * strength / (4 * math.pi)
    behind = picture(particles, [{"type": "SUN", "power": strength}])
    towards = picture(particles, [{"type": "SUN", "power": strength, "matrix": UPSIDE_DOWN}])
    tau = -np.log1p(-behind[..., 3].astype(float))
    for found, expected in (
        (behind[..., 0], source * (1 - np.exp(-2 * tau)) / 2),
        (towards[..., 0], source * tau * np.exp(-tau)),
    ):
        assert found.mean() == pytest.approx(expected.mean(), rel=0.005)
        assert found == pytest.approx(expected, rel=0.03)
    assert behind[..., :3] == pytest.approx(np.repeat(behind[..., :1], 3, -1))


@pytest.mark.parametrize("anisotropy", [-0.7, 0.4, 0.9])
def test_phase_function_is_that_of_the_angle(anisotropy: float) -> None:
    """Thin smoke is a p(cos) E tau bright; p by Henyey and Greenstein."""
    particles = slab(20_000, 1e-3, radius=0.12) | {"albedo": 1.0, "anisotropy": anisotropy}
    for degrees in (0, 30, 90, 150, 180):  # of the sun's way from straight down, which is away from the camera
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        matrix = np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])
        combined = picture(particles, [{"type": "SUN", "power": 1.0, "matrix": matrix}])
        cosine = -c
        phase = (1 - anisotropy**2) / (1 + anisotropy**2 - 2 * anisotropy * cosine) ** 1.5 / (4 * math.pi)
        assert combined[..., 0].sum() / combined[..., 3].sum() == pytest.approx(phase, rel=0.01)


def test_lights_add_up() -> None:
    particles = slab(5_000, 2.0, radius=0.2)
    lamp = np.eye(4)
    lamp[:3, 3] = (2, 1, 1)
    point = {"type": "POINT", "power": 100.0, "matrix": lamp, "color": (1.0, 0.5, 0.0)}
    sun = {"type": "SUN", "power": 2.0, "color": (0.0, 0.5, 1.0)}
    # a tolerance that is met at once, or each picture would take the steps that its own lights need
    both, one, other = (picture(particles, lights, tolerance=0.3) for lights in ([point, sun], [point], [sun]))
    assert both[..., :3] == pytest.approx(one[..., :3] + other[..., :3], rel=1e-4, abs=1e-6)


def test_emission_shines_without_light_and_without_density() -> None:
    """Radiance of thin glowing smoke: the emission integrated along the ray, whether or not it also absorbs."""
    count, radius = 60_000, 0.12
    glow = 1e-3 / (count / 4 * (2 * math.pi) ** 1.5 * (radius / 2) ** 3)  # per metre at the centre: 1e-3 along z
    particles = slab(count, 0.0, radius)
    combined = picture(particles | {"density": 0.0, "emission": (glow, 2 * glow, 0.0)}, [])
    assert combined.mean((0, 1))[:3] == pytest.approx((1e-3, 2e-3, 0.0), rel=0.01)
    assert combined[..., 3].max() < 1e-2
    absorbing = picture(slab(count, 5.0, radius) | {"emission": (glow, 2 * glow, 0.0)}, [])
    tau = -np.log1p(-absorbing[..., 3].astype(float))
    ratio = glow / slab(count, 5.0, radius)["density"]  # source function e / k of a homogeneous medium
    assert absorbing[..., 0] == pytest.approx(ratio * (1 - np.exp(-tau)), rel=1e-3)


def test_splitting_particles_changes_no_pixel() -> None:
    """Every particle in two of half the density; the sun's light per particle is the same, half at the centre."""
    particles = slab(3_000, 2.0, radius=0.3)
    split = {
        "position": np.repeat(particles["position"], 2, 0),
        "radius": particles["radius"],
        "density": particles["density"] / 2,
    }
    whole = picture(particles, [{"type": "SUN"}])
    assert picture(split, [{"type": "SUN"}]) == pytest.approx(whole, rel=2e-3, abs=1e-5)


def test_order_and_threads_change_no_bit() -> None:
    rng = np.random.default_rng(5)
    particles = slab(4_000, 3.0, radius=0.2) | {
        "albedo": rng.random((4_000, 3)).astype(np.float32),
        "ident": np.arange(4_000, dtype=np.uint64) * 3,
    }
    lamp = np.eye(4)
    lamp[:3, 3] = (2, 1, 1)
    lights = [{"type": "POINT", "power": 100.0, "matrix": lamp, "radius": 0.5}, {"type": "SUN"}]
    first = picture(particles, lights, threads=1)
    shuffle = rng.permutation(4_000)
    shuffled = particles | {name: particles[name][shuffle] for name in ("position", "albedo", "ident")}
    assert first.max() > 0
    for other, threads in ((particles, 2), (particles, 3), (shuffled, 2)):
        assert np.array_equal(picture(other, lights, threads=threads), first)


@pytest.mark.parametrize(("scale", "shift"), [(1.0, 4096.0), (1024.0, 0.0), (2.0**-10, 0.0)])
def test_moving_and_scaling_the_scene_changes_nothing(scale: float, shift: float) -> None:
    """Lengths grow, extinction shrinks; a point light's power grows with the square of the lengths."""
    rng = np.random.default_rng(6)
    position = np.round(rng.uniform(-1, 1, (2_000, 3)) * 1024) / 1024
    pictures = []
    for s, t in ((1.0, 0.0), (scale, shift)):
        lamp, camera = np.eye(4), np.eye(4)
        lamp[:3, 3] = np.array((3.0, 2.0, 2.0)) * s + t
        camera[:3, 3] = np.array((0.0, 0.0, 4.0)) * s + t
        pictures.append(
            picture(
                {"position": (position * s + t).astype(np.float32), "radius": 0.3 * s, "density": 1.0 / s},
                [{"type": "POINT", "power": 100.0 * s * s, "matrix": lamp}],
                {"matrix": camera, "width": 24, "height": 24, "clip": (0.01 * s, 100.0 * s)},
            )
        )
    assert pictures[1] == pytest.approx(pictures[0], rel=2e-3, abs=1e-6)


def depth_by_marching(particles: dict, x: float, y: float, start: float) -> float:
    """Depth below z = 20 at which the optical depth along -z reaches ln 2, in double precision."""
    position, sigma = particles["position"].astype(float), particles["radius"] / 2
    gauss = np.exp(-((position[:, 0] - x) ** 2 + (position[:, 1] - y) ** 2) / (2 * sigma**2))
    peak = particles["density"] * sigma * math.sqrt(2 * math.pi)
    erf = np.vectorize(math.erf)
    low, high = start, start + 6.0
    for _ in range(40):
        depth = (low + high) / 2
        z = 20.0 - depth
        tau = (peak * gauss * 0.5 * (1 - erf((z - position[:, 2]) / sigma / math.sqrt(2)))).sum()
        low, high = (depth, high) if tau < math.log(2) else (low, depth)
    return low


@pytest.mark.parametrize(("count", "radius", "optical_depth"), [(1, 1.0, None), (40, 0.8, 6.0), (5_000, 0.2, 3.0)])
def test_depth_is_where_half_gets_through(count: int, radius: float, optical_depth: float | None) -> None:
    particles = slab(count, optical_depth or 1.0, radius)
    if count == 1:
        particles["position"], particles["density"] = np.zeros((1, 3), np.float32), 8.0
    scene = core.Scene(core.Context())
    scene.add_particles(**particles)
    depth = core.render(scene, core.Camera(**FRAME), passes=("Depth",))["Depth"][..., 0]
    assert depth.shape == (16, 16)
    for row, column in ((8, 8), (3, 12), (0, 0), (15, 2)):
        x, y = (column + 0.5) / 16 - 0.5, (row + 0.5) / 16 - 0.5
        expected = depth_by_marching(particles, x, y, 17.0)
        if expected < 22.9:
            assert depth[row, column] == pytest.approx(expected, abs=0.01 * radius)
        else:
            assert depth[row, column] == 1000.0


def test_depth_in_perspective_is_along_the_axis_and_stops_at_solids() -> None:
    """A dense wall of smoke at z = 0 and one of triangles at z = 5 over the right half, seen from z = 20."""
    scene = core.Scene(core.Context())
    grid = np.stack(np.meshgrid(*[np.linspace(-20, 20, 81)] * 2, [0.0]), -1).reshape(-1, 3)
    scene.add_particles(grid, radius=1.0, density=1e4)
    scene.add_mesh([(0, -30, 5), (30, -30, 5), (30, 30, 5), (0, 30, 5)], [(0, 1, 2), (0, 2, 3)])
    result = core.render(scene, core.Camera(matrix=ABOVE, lens=20, width=32, height=32))
    depth = result["Depth"][..., 0]
    assert depth[:, 16:] == pytest.approx(15.0, abs=1e-4)
    # sigma 0.5, so dense that half is passed four sigmas before the centres
    assert depth[:, :16] == pytest.approx(20.0 - 4 * 0.5, abs=0.2)
    assert np.ptp(depth[8:24, 4:15]) < 0.05
    assert result["Combined"][:, 17:, 3].max() < 1e-6 and result["Combined"][:, :15, 3].min() > 0.999


def test_solid_cuts_smoke_smoothly() -> None:
    """A wall through the middle of a slab leaves half of its optical depth."""
    particles = slab(60_000, 2.0, radius=0.2)
    whole = -np.log1p(-picture(particles, [])[..., 3].astype(float)).mean()
    scene = core.Scene(core.Context())
    scene.add_particles(**particles)
    scene.add_mesh([(-5, -5, 0), (5, -5, 0), (5, 5, 0), (-5, 5, 0)], [(0, 1, 2), (0, 2, 3)])
    half = core.render(scene, core.Camera(**FRAME), passes=("Combined",))["Combined"][..., 3]
    assert -np.log1p(-half.astype(float)).mean() == pytest.approx(whole / 2, rel=0.02)


def test_nothing_to_light_and_nothing_to_see() -> None:
    empty = {"position": np.zeros((0, 3), np.float32)}
    assert not picture(empty, [{"type": "SUN"}]).any()
    dark = picture(slab(100, 1.0, radius=0.2), [])
    assert not dark[..., :3].any() and dark[..., 3].max() > 0
    scene = core.Scene(core.Context())
    assert core.render(scene, core.Camera(**FRAME), passes=("Depth",))["Depth"].min() == 1000.0
    assert picture({"position": [(0, 0, 0)], "radius": 0.0}, [{"type": "SUN"}]).max() == 0.0
