# SPDX-License-Identifier: GPL-3.0-or-later
"""Smoke that weakens red, green and blue light by different shares, and tints what passes it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fumarole import core

WIDTH = 4.0  # of the picture, m


def camera(width: int = 40, height: int = 32) -> core.Camera:
    above = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 6.0], [0, 0, 0, 1]]
    return core.Camera(matrix=above, type="ORTHOGRAPHIC", ortho_scale=WIDTH, width=width, height=height)


CAMERA = camera()
# Their mean and their shares of it are floats, so that a grey scene can be as dense as a channel, bit for bit.
TINT = np.array([0.5, 1.0, 1.5])
LAMP = [[1, 0, 0, 1.5], [0, 1, 0, -1.0], [0, 0, 1, 2.5], [0, 0, 0, 1]]
LIGHT = {"type": "POINT", "power": 100.0, "color": (1.0, 0.8, 0.6), "matrix": LAMP}
SUN = {"type": "SUN", "power": 1.0, "matrix": [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]}
PUFF = {"position": [(0.0, 0.0, 0.0)], "radius": 1.2, "density": 2.0, "albedo": (0.9, 0.6, 0.3)}


def cloud(count: int, seed: int = 1, density: float = 2.0) -> dict:
    rng = np.random.default_rng(seed)
    return {
        "position": rng.normal(0, 0.4, (count, 3)).astype(np.float32),
        "radius": rng.uniform(0.3, 0.7, count).astype(np.float32),
        "density": density,
        "albedo": (0.9, 0.6, 0.3),
        "anisotropy": 0.3,
    }


def make(*sets: dict, lights: tuple = (LIGHT,), floor: float | None = None, threads: int = 0) -> core.Scene:
    scene = core.Scene(core.Context(threads=threads))
    for particles in sets:
        scene.add_particles(**particles)
    for light in lights:
        scene.add_light(**light)
    if floor is not None:
        corners = [(-9, -9, floor), (9, -9, floor), (9, 9, floor), (-9, 9, floor)]
        scene.add_mesh(corners, [(0, 1, 2), (0, 2, 3)])
    return scene


def depth_along(points: np.ndarray, end: np.ndarray, particles: dict) -> np.ndarray:
    """Optical depth (n, 3) of red, green and blue on the segments from points (n, 3), in closed form."""
    line = end - points
    length = np.linalg.norm(line, axis=-1)
    direction = line / length[:, None]
    phi = np.vectorize(lambda z: 0.5 * math.erfc(-z / math.sqrt(2)))
    centers = np.asarray(particles["position"], float)
    count = len(centers)
    radii = np.broadcast_to(particles["radius"], count)
    colors = np.broadcast_to(particles.get("extinction_color", 1.0), (count, 3))
    total = np.zeros((len(points), 3))
    for center, radius, color in zip(centers, radii, colors):
        sigma, offset = float(radius) / 2, center - points
        along = (offset * direction).sum(-1)
        squared = (offset**2).sum(-1) - along**2
        share = phi((length - along) / sigma) - phi(-along / sigma)
        depth = particles["density"] * sigma * math.sqrt(2 * math.pi) * np.exp(-squared / (2 * sigma**2)) * share
        total += depth[:, None] * np.asarray(color, float)
    return total


def pixel_places(frame: core.Camera, z: float) -> np.ndarray:
    """Points (height width, 3) behind the centres of the pixels."""
    x = (np.arange(frame.width) + 0.5 - frame.width / 2) * WIDTH / frame.width
    y = (np.arange(frame.height) + 0.5 - frame.height / 2) * WIDTH / frame.width
    across, up = np.meshgrid(x, y)
    return np.stack([across, up, np.full_like(across, z)], -1).reshape(-1, 3)


RANDOM_COLORS = np.random.default_rng(3).uniform(0, 2, (30, 3))
SMOKES = {
    "one": [PUFF | {"extinction_color": (0.2, 1.0, 2.5)}],
    "a channel isn't weakened": [PUFF | {"extinction_color": (0.0, 0.7, 0.7)}],
    "sets of two colours": [
        PUFF | {"extinction_color": (0.2, 1.0, 2.5)},
        PUFF | {"position": [(0.3, 0.1, 0.2)], "extinction_color": (3.0, 0.5, 0.0)},
    ],
    "a colour a particle": [cloud(30) | {"extinction_color": RANDOM_COLORS}],
    "coloured and grey": [cloud(30), PUFF | {"extinction_color": (2.0, 0.0, 0.0)}],
}


@pytest.mark.parametrize("kind", SMOKES)
def test_light_past_smoke_is_tinted(kind: str) -> None:
    points = np.random.default_rng(4).uniform(-1, 1, (50, 3))
    depth = sum(depth_along(points, np.array(LAMP)[:3, 3], particles) for particles in SMOKES[kind])
    share = np.exp(-depth)
    assert (share.max(1) - share.min(1)).max() > 0.2
    scene, clear = make(*SMOKES[kind]), make()
    found = core.irradiance(scene, points) / core.irradiance(clear, points)
    assert np.abs(found - share).max() < 1e-3
    assert np.abs(core.transmittance(scene, points) - share.mean(1)).max() < 1e-3, "the mean of the three"


@pytest.mark.parametrize("kind", SMOKES)
def test_picture_is_the_references(kind: str) -> None:
    scene = make(*SMOKES[kind], lights=(LIGHT, SUN))
    result = core.render(scene, CAMERA, passes=["Combined", "Depth", "Opacity"])
    truth = core.render_reference(scene, CAMERA, passes=("Combined", "Depth"))
    for channel in range(4):
        expected, error = truth["Combined"][..., channel], (result["Combined"] - truth["Combined"])[..., channel]
        assert np.sqrt((error**2).mean()) <= 0.01 * np.sqrt((expected**2).mean())
    assert (result["Opacity"][..., 0] == result["Combined"][..., 3]).all()
    assert np.abs(result["Depth"] - truth["Depth"]).max() < 0.01


def test_reference_in_closed_form() -> None:
    """Alpha is the mean of what each channel loses; with a sun behind the camera a channel scatters
    a E (1 - exp(-2 tau)) / (8 pi), with its own tau and albedo."""
    overhead = {"type": "SUN", "power": 3.0}
    particles = cloud(12) | {"extinction_color": RANDOM_COLORS[:12], "anisotropy": 0.0}
    truth = core.render_reference(make(particles, lights=(overhead,)), CAMERA, tolerance=1e-6)["Combined"]
    points = pixel_places(CAMERA, -50.0)
    depth = depth_along(points, points + (0, 0, 100.0), particles).reshape(32, 40, 3)
    assert np.abs(truth[..., 3] - (1 - np.exp(-depth)).mean(-1)).max() < 1e-5
    scattered = np.array(PUFF["albedo"]) * 3.0 / (8 * math.pi) * (1 - np.exp(-2 * depth))
    assert np.abs(truth[..., :3] - scattered).max() < 1e-5 * scattered.max()


@pytest.mark.parametrize("device", ["TILES", "GL"])
def test_each_channel_is_a_grey_picture(device: str) -> None:
    """To the bit: of smoke as dense as the channel finds it."""
    settings = core.Settings(device=device)
    smoke = cloud(200) | {"emission": (0.1, 0.2, 0.4)}
    tinted = core.render(make(smoke | {"extinction_color": TINT}, lights=(LIGHT, SUN)), CAMERA, settings)["Combined"]
    alphas = []
    for channel in range(3):
        grey = smoke | {"density": smoke["density"] * TINT[channel]}
        alone = core.render(make(grey, lights=(LIGHT, SUN)), CAMERA, settings)["Combined"]
        assert np.array_equal(tinted[..., channel], alone[..., channel])
        alphas.append(alone[..., 3])
    assert np.abs(tinted[..., 3] - np.mean(alphas, 0)).max() < 1e-6
    assert np.ptp(alphas, 0).max() > 0.1


def test_equal_factors_are_a_density() -> None:
    expected = core.render(make(cloud(200)), CAMERA)["Combined"]
    for color in (0.5, np.full((200, 3), 0.5)):
        twice = cloud(200, density=4.0) | {"extinction_color": color}
        result = core.render(make(twice), CAMERA)
        assert np.array_equal(result["Combined"], expected)


def test_nothing_is_left_of_smoke_whose_factors_are_0() -> None:
    empty = core.render(make(PUFF | {"extinction_color": 0.0}), CAMERA)["Combined"]
    assert (empty == 0).all()


@pytest.mark.parametrize("kind", SMOKES)
def test_shadow_on_a_floor_is_tinted(kind: str) -> None:
    lights = (LIGHT, SUN | {"matrix": None})
    wanted = ["Shadow", ("Light Shadow", 0), ("Light Shadow", 1)]
    frame = camera(120, 96)  # pixels that are small against the shadows
    result = core.render(make(*SMOKES[kind], lights=lights, floor=-1.0), frame, passes=wanted)
    points = pixel_places(frame, -1.0)
    ends = (np.array(LAMP)[:3, 3], points + (0, 0, 1e3))
    shares = [np.exp(-sum(depth_along(points, end, particles) for particles in SMOKES[kind])) for end in ends]
    normals = np.tile((0.0, 0.0, 1.0), (len(points), 1))
    clear = make(lights=lights)
    sent = [core.irradiance(clear, points, light, normals) for light in range(2)]
    total = (sent[0] * shares[0] + sent[1] * shares[1]) / (sent[0] + sent[1])
    assert np.ptp(total, 1).max() > 0.2
    for name, expected in zip(wanted, (total, *shares)):
        assert np.abs(result[name].reshape(-1, 3) - expected).max() < 2e-3, name


def test_linked_lights_are_tinted_by_what_blocks_them() -> None:
    """Of two tinted sets one isn't lit by the first light and doesn't block the second."""
    tinted = cloud(30) | {"extinction_color": RANDOM_COLORS}
    other = PUFF | {"extinction_color": (3.0, 0.5, 0.0), "light_set": 1, "shadow_set": 1}
    lights = (LIGHT | {"light_sets": [0]}, SUN | {"shadow_sets": [0]})
    scene = make(tinted, other, lights=lights)
    truth = core.render_reference(scene, CAMERA)["Combined"][..., :3]
    level = np.sqrt((truth**2).mean((0, 1)))
    both = (scene, make(tinted, other, lights=(LIGHT, SUN)))
    linked, unlinked = (core.render(each, CAMERA)["Combined"][..., :3] for each in both)
    assert (np.sqrt(((linked - truth) ** 2).mean((0, 1))) < 0.01 * level).all()
    assert (np.sqrt(((unlinked - truth) ** 2).mean((0, 1))) > 0.05 * level).any()


def test_parts_add_up_and_threads_change_no_bit() -> None:
    smoke = cloud(300) | {
        "emission": (0.1, 0.2, 0.4),
        "extinction_color": np.random.default_rng(5).uniform(0, 2, (300, 3)),
        "ident": np.arange(300, dtype=np.uint64),
    }
    wanted = ["Combined", "Emit", ("Light", 0), ("Light", 1), "Shadow", "Depth Front", "Position"]
    first = core.render(make(smoke, lights=(LIGHT, SUN), floor=-0.5, threads=1), CAMERA, passes=wanted)
    total = first["Emit"] + first["Light", 0] + first["Light", 1]
    assert np.abs(total - first["Combined"][..., :3]).max() <= 1e-6 * first["Combined"].max()
    assert all(first[name].max() > 1e-3 for name in ("Emit", ("Light", 0), ("Light", 1)))
    shuffle = np.random.default_rng(6).permutation(300)
    arrays = ("position", "radius", "extinction_color", "ident")
    shuffled = smoke | {name: smoke[name][shuffle] for name in arrays}
    for other, threads in ((smoke, 2), (smoke, 3), (shuffled, 2)):
        again = core.render(make(other, lights=(LIGHT, SUN), floor=-0.5, threads=threads), CAMERA, passes=wanted)
        assert all(np.array_equal(again[name], first[name]) for name in wanted)


def test_a_kept_scene_follows_lights_settings_and_particles() -> None:
    smoke = cloud(200) | {"extinction_color": (0.5, 1.0, 1.5)}
    kept = make(smoke, floor=-1.0)
    core.render(kept, CAMERA)
    assert core.render(kept, CAMERA).stats.build_s == 0.0
    kept.clear_lights()
    kept.add_light(**SUN)
    for settings in (core.Settings(), core.Settings(leaf_size=8, subsampling=0.5)):
        fresh = core.render(make(smoke, lights=(SUN,), floor=-1.0), CAMERA, settings)["Combined"]
        assert np.array_equal(core.render(kept, CAMERA, settings)["Combined"], fresh)
    more = PUFF | {"position": [(0.5, 0.0, 0.0)], "extinction_color": (2.0, 0.0, 0.0)}
    kept.add_particles(**more)
    fresh = core.render(make(smoke, more, lights=(SUN,), floor=-1.0), CAMERA)["Combined"]
    assert np.array_equal(core.render(kept, CAMERA)["Combined"], fresh)


def test_stats_are_of_all_channels() -> None:
    grey = core.render(make(cloud(200)), CAMERA).stats
    tinted = core.render(make(cloud(200) | {"extinction_color": TINT}), CAMERA).stats
    assert tinted.device == grey.device and tinted.solver == grey.solver
    assert tinted.drawn_count == grey.drawn_count and tinted.light_sample_count == grey.light_sample_count
    assert tinted.light_points > 2 * grey.light_points
    assert 0 < tinted.accuracy_rms < 0.01 and tinted.accuracy_count > 0


@pytest.mark.parametrize("color", [(1.0, -0.1, 1.0), (1.0, 1.0, math.nan), (math.inf, 1.0, 1.0)])
def test_a_wrong_colour_is_named(color: tuple) -> None:
    with pytest.raises(core.FumaroleError, match="'?plume'?: extinction colour .* is negative or not finite"):
        core.Scene(core.Context()).add_particles(**PUFF | {"name": "plume", "extinction_color": color})
    scene = core.Scene(core.Context())
    colors = np.ones((30, 3))
    colors[7] = color
    scene.add_particles(**cloud(30) | {"name": "plume", "extinction_color": colors})
    (warning,) = scene.context.warnings
    assert "plume: 1 of 30 particles were dropped; the first, number 7, has an invalid extinction colour" in warning
    with pytest.raises(core.FumaroleError, match=r"extinction_color of 'plume' has shape \(2, 3\)"):
        scene.add_particles(**cloud(30) | {"name": "plume", "extinction_color": np.ones((2, 3))})
