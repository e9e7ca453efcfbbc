# SPDX-License-Identifier: GPL-3.0-or-later
"""Where methods fail: each case returns a figure, to be at most its bound.

Most figures are the relative RMS error of a picture against brute force (scenes.apart). The default tolerance promises
1 %; the bound is 2 % where edges are sharp or light is singular, and what it says elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scenes import aimed, apart, at, ball, build, camera, cube, error, lamp, picture, screen, single, sun, truth, wall

from fumarole import core


@dataclass(frozen=True)
class Case:
    """A case of the table."""

    name: str
    bound: float
    measure: Callable[[], float]


CASES: list[Case] = []


def case(name: str, bound: float = 0.01, **arguments) -> Callable:
    """Adds a function to the table, as many times as it is decorated, with these arguments."""

    def add(function: Callable[..., float]) -> Callable[..., float]:
        CASES.append(Case(name, bound, lambda: function(**arguments)))
        return function

    return add


SIDE_LIGHT = [lamp(4, -1, 1)]


# ---- Particles


@case("few huge dense particles")
def few_huge() -> float:
    rng = np.random.default_rng(3)
    return error({"position": rng.uniform(-0.5, 0.5, (6, 3)), "radius": 1.0, "density": 8.0}, SIDE_LIGHT)


@case("one particle, optical depth 1e-4", depth=1e-4)
@case("one particle, optical depth 1", depth=1.0)
@case("one particle, optical depth 10", depth=10.0)
@case("one particle, optical depth 100", 0.02, depth=100.0)
@case("one particle, optical depth 1000", 0.02, depth=1000.0)
def one(depth: float) -> float:
    return error(single(0.35, depth), SIDE_LIGHT)


@case("one particle, light from behind, optical depth 10", depth=10.0)
def one_from_behind(depth: float) -> float:
    return error(single(0.35, depth), [lamp(0.3, 4, 0.2)])


@case("one particle, orthographic camera")
def orthographic() -> float:
    view = core.Camera.from_window(aimed((0, -5, 0)), (-1.5, 1.5, -1.5, 1.5), 16, 16, "ORTHOGRAPHIC")
    return error(single(0.35, 5), SIDE_LIGHT, view)


@case("10,000 particles at one point, optical depth 5", depth=5.0)
@case("10,000 particles at one point, optical depth 500", 0.02, depth=500.0)
def coincident(depth: float) -> float:
    """As one particle of their density."""
    one = single(0.35, depth)
    many = {"position": np.zeros((10_000, 3)), "radius": one["radius"], "density": one["density"] / 10_000}
    return apart(picture(build(many, SIDE_LIGHT), camera()), truth(build(one, SIDE_LIGHT), camera()))


@case("particles on a line across the view", axis=0)
@case("particles on a line along the view", axis=1)
def line(axis: int) -> float:
    position = np.zeros((60, 3))
    position[:, axis] = np.linspace(-1, 1, 60)
    return error({"position": position, "radius": 0.2, "density": 3.0}, SIDE_LIGHT, camera(width=64, height=16))


@case("particles on a line to the light, far apart and dense")
def line_to_light() -> float:
    position = np.linspace(-1, 1, 5)[:, None] * np.array((1, 0, 0))
    return error({"position": position, "radius": 0.2, "density": 20.0}, [lamp(5, 0, 0)], camera(width=64, height=16))


@case("particles on a plane seen from its edge")
def plane() -> float:
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 15), np.linspace(-1, 1, 15), [0.0]), -1).reshape(-1, 3)
    return error({"position": grid, "radius": 0.25, "density": 3.0}, [lamp(1, -1, 3)])


@case("two clusters a kilometre apart along the view", distance=990.0, sigma=0.1)
@case("two specks a kilometre apart along the view", distance=990.0, sigma=0.01)
@case("two clusters 100 m apart along the view", distance=100.0, sigma=0.1)
def two_clusters(distance: float, sigma: float) -> float:
    """The near one fills the picture; the far one is as large in it."""
    rng = np.random.default_rng(4)
    near = rng.normal(0, 3 * sigma, (40, 3))
    far = near * (distance / (50 * sigma)) + (0, distance, 0)
    k = 2 / (sigma * math.sqrt(2 * math.pi))
    sets = [
        {"position": near, "radius": 2 * sigma, "density": k},
        {"position": far, "radius": 2 * sigma * distance / (50 * sigma), "density": k * 50 * sigma / distance},
    ]
    return error(sets, [sun((-1, 0.3, -0.3))], camera((0, -50 * sigma, 0), 0.2, 32, 32))


@case("two particles 900 m apart along the view")
def two_particles() -> float:
    return error([single(0.02, 4), single(4.0, 4, (5, 900, 0))], [sun((-1, 0.3, -0.3))], camera((0, -0.5, 0), 0.15))


@case("a stray particle far behind the clip end")
def stray() -> float:
    return error([single(0.02, 4), single(1.0, 1, (0, 7000, 0))], [sun((-1, 0.3, -0.3))], camera((0, -0.5, 0), 0.15))


@case("radii 1e6 to 1, the large one a thin fog")
def fog() -> float:
    ratio = 1e6
    return error([ball(100, 5), single(0.3 * ratio, 0.5 * ratio / 1e3)], [lamp(4, -1, 1)])


@case("radii 1e6 to 1, the small ones 1e-6 of the large one", 0.02)
def specks() -> float:
    """Specks too small to be seen must do no harm to what can be seen."""
    rng = np.random.default_rng(6)
    return error([single(0.35, 5), {"position": rng.normal(0, 0.4, (200, 3)), "radius": 7e-7, "density": 1e3}], SIDE_LIGHT)


@case("radii 30 to 1, both dense", 0.02)
def mixed() -> float:
    rng = np.random.default_rng(7)
    small = {"position": rng.normal(0, 0.4, (300, 3)), "radius": 0.06, "density": 30.0}
    return error([single(0.45, 4, (0.3, 0.2, 0)), single(0.4, 3, (-0.4, 0, 0.2)), small], SIDE_LIGHT, camera(width=96, height=96))


@case("a small dense particle in front of a large one", 0.02)
def small_on_large() -> float:
    return error([single(0.5, 4), single(0.08, 20, (0.3, -0.6, 0.2))], SIDE_LIGHT, camera(width=40, height=40))


@case("particles of radius 0 change nothing", 0.0)
def radius_zero() -> float:
    particles = ball(50, 4)
    holes = {"position": np.random.default_rng(1).normal(0, 1, (50, 3)), "radius": 0.0, "density": 1e6}
    return apart(picture(build([particles, holes], SIDE_LIGHT), camera()), picture(build(particles, SIDE_LIGHT), camera()))


@case("particles of density 0 are not seen")
def density_zero() -> float:
    particles = ball(50, 4)
    clear = {"position": np.random.default_rng(1).normal(0, 1, (50, 3)), "radius": 0.05, "density": 0.0}
    return apart(picture(build([particles, clear], SIDE_LIGHT), camera()), truth(build(particles, SIDE_LIGHT), camera()))


@case("density 1e-6: brightness per opacity")
def density_tiny() -> float:
    return error(ball(50, 1) | {"density": 1e-6}, SIDE_LIGHT)


@case("density 1e6", 0.02)
def density_huge() -> float:
    return error(ball(30, 1) | {"density": 1e6}, SIDE_LIGHT)


@case("ball of 100 particles, optical depth 5", count=100, depth=5)
@case("ball of 100 particles, optical depth 100", 0.02, count=100, depth=100)
@case("ball of 500 particles, optical depth 20", count=500, depth=20)
@case("ball of 100 particles, optical depth 1e-4", count=100, depth=1e-4)
@case("ball of 100 particles, optical depth 1000", 0.02, count=100, depth=1000)
def balls(count: int, depth: float) -> float:
    return error(ball(count, depth), SIDE_LIGHT)


def samples(particles: dict[str, Any], lights: list[dict[str, Any]]) -> float:
    """Samples of light for each particle."""
    return core.render(build(particles, lights), camera(width=96, height=96)).stats.light_points / len(particles["position"])


@case("20,000 particles that overlap, n sigma^3 = 5: samples of light for each", 1.0)
def overlapping() -> float:
    return samples(ball(20_000, 5, overlap=5), SIDE_LIGHT)


@case("2,000 thin particles under a sun: samples of light for each", 1.0, particles=ball(2000, 0.05))
@case("thin spray, far apart under a sun: samples of light for each", 1.0, particles=ball(1000, 0.005, overlap=0.001))
def thin_samples(particles: dict[str, Any]) -> float:
    return samples(particles, [sun((1, 1, -1))])


@case("thin smoke under a sun", lights=[sun((1, 1, -1))])
@case("thin smoke, light 100 sigmas away", lights=[lamp(8, -4, 9)])
@case("thin smoke under two suns, glowing, g = 0.1, a colour a particle", lights=[sun((1, 1, -1)), sun((-1, 2, 0))], looks=True)
def thin(lights: list[dict[str, Any]], looks: bool = False) -> float:
    particles = ball(2000, 0.05)
    if looks:
        rng = np.random.default_rng(2)
        particles |= {"anisotropy": 0.1, "albedo": rng.random((2000, 3)), "emission": 0.02 * rng.random((2000, 3))}
    return error(particles, lights, camera((0, -200, 0), 0.007, 32, 32) if looks else camera(width=32, height=32))


@case("thin spray, far apart, light 100 sigmas away")
def spray() -> float:
    return error(ball(300, 0.002, overlap=0.001), [lamp(4, -2, 3)], camera(width=96, height=96))


@case("sparse particles, far apart and dense")
def sparse() -> float:
    return error(ball(40, 3, overlap=0.01), SIDE_LIGHT, camera(width=64, height=64))


@case("emitter scaled 10 x 1 x 0.1")
def anisotropic_scale() -> float:
    particles = ball(200, 3)
    particles["position"] = particles["position"] * (10, 1, 0.1)
    return error(particles, [lamp(4, -6, 3)], camera((0, -20, 3), 0.5, 128, 32))


@case("albedo 0 is black", 0.0)
def albedo_zero() -> float:
    return float(picture(build(ball(50, 4) | {"albedo": 0.0}, SIDE_LIGHT), camera())[..., :3].max())


@case("albedo 1, a colour a particle")
def albedo_one() -> float:
    albedo = np.random.default_rng(8).integers(0, 2, (50, 3)).astype(float)
    return error(ball(50, 4) | {"albedo": albedo}, SIDE_LIGHT)


@case("g = 0.99, light from behind", g=0.99, y=4)
@case("g = -0.99, light from the front", g=-0.99, y=-7)
@case("g = 0.99, light from the front", g=0.99, y=-7)
@case("g = -0.99, light from behind", g=-0.99, y=4)
def anisotropy(g: float, y: float) -> float:
    return error(ball(100, 4) | {"anisotropy": g}, [lamp(0.1, y, 0.2)])


@case("g = 0.99, light inside", 0.02)
def anisotropy_inside() -> float:
    return error(ball(100, 4) | {"anisotropy": 0.99}, [lamp(0.13, 0.2, 0.12)])


@case("glowing smoke without light, optical depth 20")
def glow() -> float:
    return error(ball(100, 20) | {"emission": (2.0, 1.0, 0.1)})


@case("16 kinds of smoke in one place", 0.01)
def many_classes() -> float:
    sets = [ball(20, 0.3, seed) | {"anisotropy": -0.8 + 0.1 * seed, "albedo": seed / 15} for seed in range(16)]
    return error(sets, SIDE_LIGHT)


# ---- Lights


@case("light inside a particle", 0.02, position=(0.12, -0.08, 0.1), depth=3)
@case("light at a particle's centre", 0.02, position=(0, 0, 0), depth=3)
@case("light at a dense particle's centre", 0.02, position=(0, 0, 0), depth=6)
@case("light touching a particle", 0.02, position=(0.7, 0, 0), depth=3)
@case("light in front of the smoke, in view", 0.02, position=(0.3, -1.2, 0.2), depth=3)
def light_near(position: tuple, depth: float) -> float:
    return error(single(0.35, depth), [lamp(*position)])


@case("light inside a cloud", 0.02)
def light_inside() -> float:
    return error(ball(300, 5), [lamp(0.2, 0.1, -0.1)], camera(width=32, height=32))


@case("large light inside a cloud", 0.07)
def large_light_inside() -> float:
    """The lamp's points fill a ball that looks like a disc from afar; the truth is a disc that faces each point. Amid
    smoke the two differ within the lamp and close to it."""
    return error(ball(100, 5), [lamp(0.2, 0.1, -0.1, radius=0.3)], light_samples=64)


@case("light 1e6 m away")
def light_far() -> float:
    return error(ball(100, 5), [lamp(6e5, -6e5, 5e5, power=1e15)])


@case("light behind the camera")
def light_behind_camera() -> float:
    return error(ball(100, 5), [lamp(0.2, -9, 0.3)])


@case("light at the camera")
def light_at_camera() -> float:
    return error(ball(100, 5), [lamp(0, -5, 0)])


@case("sun along +X", towards=(1, 0, 0))
@case("sun along -Z", towards=(0, 0, -1))
@case("sun along the view", towards=(0, 1, 0))
@case("sun towards the camera", towards=(0, -1, 0))
def sun_on_axis(towards: tuple) -> float:
    return error(ball(100, 5), [sun(towards)])


@case("edge of a spot's cone through the smoke", 0.02, blend=0.0, width=16)
@case("soft edge of a spot's cone through the smoke", 0.02, blend=0.5, width=16)
def spot_edge(blend: float, width: int) -> float:
    spot = lamp(0, 0, 0) | {"type": "SPOT", "matrix": aimed((4, 0, 0)), "spot_angle": 0.25, "spot_blend": blend}
    return error(ball(100, 3), [spot], camera(width=width, height=width))


@case("area light beside the smoke", 0.02)
def area_light() -> float:
    area = {"type": "AREA", "matrix": aimed((2.5, -1, 0.5)), "power": 500.0, "size": 2.0}
    return error(ball(100, 4), [area], light_samples=64)


@case("area light through the smoke", 0.02, depth=4)
@case("area light through thin smoke", 0.02, depth=0.01)
@case("area light through thin smoke, little spread", 0.02, depth=0.01, spread=1.0)
@case("area light through the smoke, an ellipse of little spread", 0.02, depth=4, shape="ELLIPSE", size=1.2, size_y=0.6, spread=1.0)
def area_inside(depth: float, **more) -> float:
    area = {"type": "AREA", "matrix": aimed((0, 0, 0.2), (0, 0, 0)), "power": 500.0, "size": 1.0} | more
    return error(ball(100, depth), [area], light_samples=256)


@case("wide sun, half a radian")
def wide_sun() -> float:
    return error(ball(100, 5), [sun((-1, 0.3, -0.3), angle=0.5)], light_samples=64)


@case("light inside a closed mesh lights nothing", 0.0)
def light_in_mesh() -> float:
    box = cube(0.5) | {"matrix": at(3, 0, 0)}
    return float(picture(build(ball(50, 4), [lamp(3, 0, 0)], [box]), camera())[..., :3].max())


@case("no light is black, and as opaque as the truth")
def no_lights() -> float:
    return error(ball(100, 5))


@case("64 lights")
def many_lights() -> float:
    ways = np.random.default_rng(9).normal(size=(64, 3))
    ways *= 4 / np.linalg.norm(ways, axis=1, keepdims=True)
    return error(ball(50, 5), [lamp(*way, power=20.0) for way in ways])


# ---- Camera


@case("camera inside the cloud", 0.01)
def camera_inside() -> float:
    return error(ball(200, 5), SIDE_LIGHT, camera((0, 0.1, 0), 0.8, 32, 32, target=(0, 1, 0)))


@case("camera inside one particle", 0.01, position=(0.1, -0.1, 0.05))
@case("camera exactly at a particle's centre", 0.01, position=(0, 0, 0))
def camera_in_particle(position: tuple) -> float:
    return error(single(0.5, 4), SIDE_LIGHT, camera(position, 0.8, target=(0, 3, 0)))


@case("camera at the centre of a dense particle, wide lens", 0.02)
def camera_in_dense() -> float:
    return error(single(0.5, 10), SIDE_LIGHT, camera((0, 0, 0), 2.0, target=(0, 3, 0)))


@case("particle across the near plane", start=0.6)
@case("particle across a near plane far from the camera", start=5.0)
def near_plane(start: float) -> float:
    return error(single(0.5, 4, (0, start - 5, 0)), SIDE_LIGHT, camera(half=0.8, clip=(start, 1000.0)))


@case("particle across the clip end")
def far_plane() -> float:
    return error(single(0.5, 4), SIDE_LIGHT, camera(clip=(0.01, 5.0)))


@case("particles behind the camera are not drawn, and cast shadows")
def behind_camera() -> float:
    return error([ball(50, 3), single(0.5, 4, (0, -7, 0)), single(0.5, 4, (0.2, -5.3, 0))], [lamp(0, -9, 0)])


@case("particle across the frame's corner")
def frame_edge() -> float:
    return error(single(0.5, 4, (1.5, 0, 1.5)), SIDE_LIGHT)


@case("a dense particle out of the frame, its shadow within", 0.02)
def out_of_frame() -> float:
    return error([single(0.4, 4), single(0.3, 6, (2.5, -0.6, 0.6))], SIDE_LIGHT)


@case("wide lens, 152 degrees")
def wide_lens() -> float:
    return error(ball(200, 5), SIDE_LIGHT, camera((0, -1.6, 0), 4.0, 64, 64))


@case("camera 1e4 m away, long lens")
def long_lens() -> float:
    return error(ball(200, 5), SIDE_LIGHT, camera((0, -1e4, 0), 1.5e-4, clip=(1.0, 1e5)))


@case("1 x 1 pixel", width=1, height=1)
@case("64 x 2 pixels over several tiles", width=64, height=2)
@case("33 x 33 pixels, a tile and one more", width=33, height=33)
def odd_frames(width: int, height: int) -> float:
    return error(ball(100, 5), SIDE_LIGHT, camera(half=0.3 * width / max(width, 16), width=width, height=height))


@case("8192 x 2 pixels")
def long_picture() -> float:
    """Every 512th column against the truth."""
    scene, view = build(ball(100, 5), SIDE_LIGHT), camera(width=8192, height=2)
    columns = range(256, 8192, 512)
    expected = np.concatenate([truth(scene, view.crop(x, 0, x + 1, 2)) for x in columns], axis=1)
    return apart(picture(scene, view)[:, list(columns)], expected)


@case("pixels 1000 times smaller than a particle")
def small_pixels() -> float:
    return error(single(0.35, 4), SIDE_LIGHT, camera(half=0.35e-3 / 5 * 8, target=(0.2, 0, 0.1)))


@case("pixels 1000 times larger than a particle, thin", 0.02, depth=0.05)
@case("pixels 1000 times larger than a particle, dense", 0.02, depth=3.0)
def large_pixels(depth: float) -> float:
    """Sum over the picture, against the truth of a picture of the particle alone."""
    sigma = 0.6 / 16 / 1000
    scene = build(single(sigma, depth, (0.013, 0, 0.021)), [sun((-1, 0.3, -0.3))])
    half = 6 * sigma / 5
    close = truth(scene, camera(half=half, target=(0.013, 0, 0.021), width=32, height=32)).sum((0, 1)) * (half / 16) ** 2
    wide = picture(scene, camera(half=0.06)).sum((0, 1)) * (0.06 / 8) ** 2
    return float(np.abs(wide / close - 1).max())


@case("many thin particles smaller than a pixel", 0.02, depth=0.02)
@case("many dense particles smaller than a pixel", 0.02, depth=0.5)
def dust(depth: float) -> float:
    """Thin together: brightness and opacity of each add up."""
    rng = np.random.default_rng(10)
    sigma, count = 0.002, 4000
    scene = build({"position": rng.uniform(-0.5, 0.5, (count, 3)), "radius": 2 * sigma, "density": depth / sigma / 2.5066}, [sun((-1, 0, 0))])
    fine = picture(scene, camera(width=1024, height=1024))
    return float(np.abs(picture(scene, camera()).mean((0, 1)) / fine.mean((0, 1)) - 1).max())


# ---- Solids


@case("smoke cut by a plane", 0.02)
def cut() -> float:
    return error(ball(100, 5), SIDE_LIGHT, meshes=[screen(0.1)])


@case("smoke cut by a plane, soft light", 0.02)
def cut_soft() -> float:
    return error(ball(100, 5), [lamp(2, -3, 1, radius=0.5)], meshes=[screen(0.1)], light_samples=64)


@case("one particle cut by a slanted plane, grazing light", 0.02)
def cut_from_behind() -> float:
    slanted = {"vertices": [(-4, -2, -4), (4, 2, -4), (4, 2, 4), (-4, -2, 4)], "triangles": [(0, 1, 2), (0, 2, 3)]}
    return error(single(0.5, 4), [lamp(2, 0.8, 0)], meshes=[slanted])


@case("thin wall between light and half of the smoke", 0.02)
def wall_shadow() -> float:
    return error(ball(100, 5), [lamp(5, 0, 0)], meshes=[wall(2, 0)])


@case("a post narrower than a particle between light and smoke", 0.02)
def post_shadow() -> float:
    post = {"vertices": [(2, -4, -0.05), (2, 4, -0.05), (2, 4, 0.05), (2, -4, 0.05)], "triangles": [(0, 1, 2), (0, 2, 3)]}
    return error(ball(100, 5), [lamp(5, 0, 0)], meshes=[post], view=camera(width=32, height=32))


@case("wall between soft light and smoke", 0.02)
def wall_penumbra() -> float:
    return error(ball(100, 5), [lamp(5, 0, 0, radius=0.4)], meshes=[wall(2, 0)], light_samples=64)


@case("particles exactly on a triangle", 0.02)
def on_triangle() -> float:
    rng = np.random.default_rng(11)
    position = np.column_stack((rng.uniform(-1, 1, 40), rng.uniform(-1, 1, 40), np.zeros(40)))
    floor = {"vertices": [(-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0)], "triangles": [(0, 1, 2), (0, 2, 3)]}
    return error({"position": position, "radius": 0.6, "density": 3.0}, [lamp(1, -1, 4)], camera((0, -4, 2), 0.4), [floor])


@case("smoke inside a closed mesh is not seen", 1e-4)
def in_mesh() -> float:
    """But for tails that reach out of it: they are seen beside its edges."""
    return float(picture(build(ball(50, 5, radius=0.3) | {"radius": 0.05}, SIDE_LIGHT, [cube(0.6)]), camera()).max())


@case("smoke inside a closed mesh that the camera doesn't see is dark", 0.0)
def in_hidden_mesh() -> float:
    hidden = cube(1.5) | {"visible_to_camera": False}
    pixels = picture(build(ball(50, 5, radius=0.3) | {"radius": 0.2, "density": 10.0}, SIDE_LIGHT, [hidden]), camera())
    return float(pixels[..., :3].max()) if pixels[..., 3].max() > 0.5 else math.inf


@case("degenerate triangles change nothing", 1e-4)
def degenerate() -> float:
    flat = {"vertices": [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, -1, 1)], "triangles": [(0, 0, 0), (0, 1, 2), (3, 3, 1)]}
    scene = build(ball(50, 5), SIDE_LIGHT)
    return apart(picture(build(ball(50, 5), SIDE_LIGHT, [flat]), camera()), picture(scene, camera()))


# ---- Where and how large the scene is


@case("scene 1e5 m from the origin", shift=1e5)
@case("scene 1e7 m from the origin", shift=1e7)
def far_away(shift: float) -> float:
    """Whole metres, which single precision still tells apart there."""
    rng = np.random.default_rng(12)
    position = rng.integers(-8, 9, (60, 3)).astype(float)
    moved = np.full(3, shift)
    view = core.Camera.from_window(aimed(moved + (0, -50, 0), moved), (-0.25, 0.25, -0.25, 0.25), 16, 16)
    return error({"position": position + moved, "radius": 7.0, "density": 0.15}, [lamp(*(moved + (40, -10, 10)))], view)


@case("scene 1e4 times larger", scale=1e4)
@case("scene 1e4 times smaller", scale=1e-4)
def scaled(scale: float) -> float:
    particles = ball(100, 5)
    particles = {"position": particles["position"] * scale, "radius": particles["radius"] * scale, "density": particles["density"] / scale}
    light = lamp(4 * scale, -scale, scale, power=1000 * scale**2)
    return error(particles, [light], camera((0, -5 * scale, 0), clip=(0.01 * scale, 1000 * scale)))


# ---- Bad input


@case("not finite or out of range: dropped, counted and named; the rest as without", 0.0)
def not_finite() -> float:
    """Number of arrays whose bad values aren't dropped as they should be."""
    good = ball(20, 4)
    count, wrong = 20, 0
    base = {
        "position": np.asarray(good["position"], float),
        "radius": np.full(count, good["radius"]),
        "density": np.full(count, good["density"]),
        "albedo": np.full((count, 3), 0.5),
        "emission": np.full((count, 3), 0.1),
    }
    keep = np.arange(count) != 7
    expected = picture(build({name: array[keep] for name, array in base.items()} | {"ident": np.arange(count)[keep]}, SIDE_LIGHT), camera())
    for name, array in base.items():
        bad_values = (math.nan, math.inf, -math.inf) + (() if name == "position" else (-1.0,))
        for bad in bad_values + ((1.5,) if name == "albedo" else ()):
            broken = array.copy()
            broken[7] = bad
            scene = core.Scene(core.Context())
            scene.add_particles(**(base | {name: broken}), ident=np.arange(count), name="puff")
            warned = [w for w in scene.context.warnings if "puff" in w and "1" in w]
            wrong += not warned
            scene.add_light(**SIDE_LIGHT[0])
            wrong += apart(picture(scene, camera()), expected) > 0.0
    return float(wrong)


@case("not finite: numbers, matrices, meshes, lights and cameras are refused and named", 0.0)
def refused() -> float:
    """Number of bad inputs that were not refused with a message that names the object."""
    wrong = 0
    for bad in (math.nan, math.inf, -math.inf):
        matrix = np.eye(4)
        matrix[0, 3] = bad
        vertices = [(0, 0, 0), (1, 0, 0), (0, 1, bad)]
        attempts = [
            lambda scene: scene.add_particles([(0, 0, 0)], radius=bad, name="thing"),
            lambda scene: scene.add_particles([(0, 0, 0)], density=bad, name="thing"),
            lambda scene: scene.add_particles([(0, 0, 0)], albedo=(bad, 0, 0), name="thing"),
            lambda scene: scene.add_particles([(0, 0, 0)], emission=(0, bad, 0), name="thing"),
            lambda scene: scene.add_particles([(0, 0, 0)], anisotropy=bad, name="thing"),
            lambda scene: scene.add_mesh(vertices, [(0, 1, 2)], name="thing"),
            lambda scene: scene.add_mesh([(0, 0, 0)] * 3, [(0, 1, 2)], matrix, name="thing"),
            lambda scene: scene.add_light("POINT", matrix, name="thing"),
            lambda scene: scene.add_light("POINT", power=bad, name="thing"),
            lambda scene: scene.add_light("POINT", radius=bad, name="thing"),
            lambda scene: scene.add_light("SUN", angle=bad, name="thing"),
            lambda scene: scene.add_light("SPOT", spot_angle=bad, name="thing"),
            lambda scene: scene.add_light("SPOT", spot_blend=bad, name="thing"),
            lambda scene: scene.add_light("AREA", size=bad, name="thing"),
            lambda scene: scene.add_light("AREA", spread=bad, name="thing"),
            lambda scene: core.render(scene, core.Camera(matrix)),
            lambda scene: core.render(scene, core.Camera.from_window(None, (-1, bad, -1, 1), 4, 4)),
            lambda scene: core.render(scene, core.Camera(clip=(0.1, bad))),
            lambda scene: core.render(scene, core.Camera(), core.Settings(tolerance=bad)),
            lambda scene: core.render(scene, core.Camera(), core.Settings(shadowing_density=bad)),
            lambda scene: core.transmittance(build(single(1, 1), SIDE_LIGHT), [(bad, 0, 0)]),
        ]
        for attempt in attempts:
            try:
                attempt(core.Scene(core.Context()))
                wrong += 1
            except core.FumaroleError as refusal:
                wrong += not any(name in str(refusal) for name in ("thing", "camera", "settings", "points"))
    return float(wrong)


# ---- Settings, motion


@case("subsampling 100 % changes nothing", 0.0, share=1.0)
@case("subsampling 50 %: standard errors of the mean", 3.0, share=0.5)
@case("subsampling 10 %: standard errors of the mean", 3.0, share=0.1)
@case("subsampling 1 %: standard errors of the mean", 3.0, share=0.01)
def subsampling(share: float) -> float:
    """Mean optical depth through a slab, over its standard error for the number of particles that were kept."""
    rng = np.random.default_rng(13)
    count, sigma = 20_000, 0.05
    scene = build({"position": rng.uniform(-1, 1, (count, 3)), "radius": 2 * sigma, "density": 0.5}, [sun((0, 0, -1))])
    points = np.column_stack((rng.uniform(-0.8, 0.8, (400, 2)), np.full(400, -2.0)))
    whole = -np.log(core.transmittance(scene, points).astype(float)).mean()
    part = -np.log(core.transmittance(scene, points, settings=core.Settings(subsampling=share)).astype(float)).mean()
    if share == 1.0:
        return abs(part - whole)
    return abs(part / whole - 1) / math.sqrt((1 / share - 1) / (count * 0.64))


def largest_step(frames: list) -> float:
    """Largest second difference from frame to frame, over the RMS of the pictures: what a smooth motion hasn't."""
    stack = np.array(frames)[..., :3]
    return float(np.sqrt((np.diff(stack, 2, axis=0) ** 2).mean((1, 2, 3))).max() / math.sqrt((stack**2).mean()))


@case("moving light: the largest jump")
def moving_light() -> float:
    scene = build(ball(100, 8))
    frames = []
    for x in np.linspace(-0.05, 0.05, 11):
        scene.clear_lights()
        scene.add_light(**lamp(4 + x, -1, 1 + x))
        frames.append(picture(scene, camera(width=32, height=32)))
    return largest_step(frames)


@case("light moving through the smoke: the largest jump", 0.02)
def light_through() -> float:
    scene = build(ball(100, 8))
    frames = []
    for x in np.linspace(-0.01, 0.01, 11):
        scene.clear_lights()
        scene.add_light(**lamp(x, -1.05, x))
        frames.append(picture(scene, camera(width=32, height=32)))
    return largest_step(frames)


@case("moving camera: the largest jump", start=(0, -5, 0))
@case("camera moving through the smoke: the largest jump", start=(0, -0.5, 0))
def moving_camera(start: tuple) -> float:
    scene = build(ball(100, 8), SIDE_LIGHT)
    steps = np.linspace(-0.01, 0.01, 11)
    return largest_step([picture(scene, camera(np.add(start, (y, y, 0)), 0.3, 32, 32, np.add(start, (y, 1, 0)))) for y in steps])


@case("order flips: two particles pass each other in depth")
def order_flip() -> float:
    frames = []
    for y in np.linspace(-0.01, 0.01, 11):
        red = single(0.3, 5, (0.1, y, 0)) | {"albedo": (1, 0, 0)}
        blue = single(0.3, 5, (-0.1, -y, 0)) | {"albedo": (0, 0, 1)}
        frames.append(picture(build([red, blue], SIDE_LIGHT), camera()))
    return largest_step(frames)


@case("device GL on many thin small particles", 0.02)
def gl_agrees() -> float:
    rng = np.random.default_rng(14)
    scene = build({"position": rng.uniform(-0.7, 0.7, (60_000, 3)), "radius": 0.06, "density": 0.05}, SIDE_LIGHT)
    view = camera(width=64, height=64)
    return apart(picture(scene, view, device="GL"), picture(scene, view))
