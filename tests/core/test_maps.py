# SPDX-License-Identifier: GPL-3.0-or-later
"""Images on particles: they shape and colour them as the camera sees them, on both devices."""

from __future__ import annotations

import numpy as np
import pytest

from fumarole import core

DEVICES = ("TILES", "GL")
VIEWS = {"perspective": {"lens": 36.0}, "orthographic": {"type": "ORTHOGRAPHIC", "ortho_scale": 6.0}}
PASSES = ("Combined", "Depth", "Depth Front", "Opacity", "Albedo", "Vector")


def at(x: float, y: float, z: float) -> list[list[float]]:
    return [[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z], [0, 0, 0, 1]]


def camera(size: int = 96, **changes: object) -> core.Camera:
    return core.Camera(**{"matrix": at(0, 0, 6), "lens": 36.0, "width": size, "height": size} | changes)


def wisp(size: int, seed: int = 2, is_colored: bool = True) -> np.ndarray:
    """Ragged, with holes, transparent at its border; (size, size, 4)."""
    rng = np.random.default_rng(seed)
    opacity = np.zeros((size, size))
    for octave in range(1, 4):
        count = 2 ** (octave + 1)
        grid = rng.random((count + 2, count + 2))
        x = np.linspace(0, count, size, endpoint=False) + 0.25
        low, share = x.astype(int), x % 1
        rows = grid[low] * (1 - share[:, None]) + grid[low + 1] * share[:, None]
        opacity += (rows[:, low] * (1 - share) + rows[:, low + 1] * share) / 2**octave
    y, x = (np.mgrid[:size, :size] + 0.5) / size * 2 - 1
    result = np.ones((size, size, 4), np.float32)
    result[..., 3] = np.clip((opacity - 0.3) * 2.5, 0, 1) * np.clip(1.2 - 1.2 * (x * x + y * y), 0, 1)
    if is_colored:
        result[..., 0], result[..., 1] = 0.5 + 0.5 * x, 0.6 - 0.4 * y
    return result


def cloud(image: np.ndarray | None, count: int = 20, seed: int = 3, **changes: object) -> core.Scene:
    rng = np.random.default_rng(seed)
    scene = core.Scene()
    particles = {"radius": 0.8, "density": 1.5, "albedo": (0.8, 0.7, 0.6), "velocity": (0.1, 0, 0)} | changes
    scene.add_particles(
        rng.uniform(-1.5, 1.5, (count, 3)), ident=np.arange(100, 100 + count), map=image, **particles
    )
    scene.add_light("SUN", [[1, 0, 0, 0], [0, 0.6, 0.8, 0], [0, -0.8, 0.6, 0], [0, 0, 0, 1]], power=3.0)
    scene.add_light("POINT", at(2, 2, 2), power=400.0)
    return scene


def error(found: np.ndarray, expected: np.ndarray) -> float:
    """Root mean square of the difference over that of what is expected."""
    return float(np.sqrt(np.mean((found - expected) ** 2.0) / np.mean(expected**2.0)))


def depths(combined: np.ndarray) -> np.ndarray:
    return -np.log1p(-combined[..., 3].astype(np.float64))


@pytest.mark.parametrize("device", DEVICES)
def test_constant_map_changes_nothing(device: str) -> None:
    constant = np.broadcast_to(np.float32((1, 1, 1, 0.4)), (5, 7, 4))
    settings = core.Settings(device=device)
    plain, mapped = (core.render(cloud(image), camera(48), settings, PASSES) for image in (None, constant))
    for name in PASSES:
        assert np.abs(plain[name] - mapped[name]).max() < 1e-5, name


@pytest.mark.parametrize("view", VIEWS)
def test_picture_is_that_of_the_reference(view: str) -> None:
    """Where the map's pixels are larger than the picture's, both read the same level."""
    scene, seen = cloud(wisp(12)), camera(96, **VIEWS[view])
    expected = core.render_reference(scene, seen, passes=("Combined", "Depth"))
    for device in DEVICES:
        found = core.render(scene, seen, core.Settings(device=device), ("Combined", "Depth"))
        assert error(found["Combined"][..., 3], expected["Combined"][..., 3]) < 2e-4
        off = np.abs(found["Depth"] - expected["Depth"])
        assert np.percentile(off, 99) < 1e-4 and np.mean(off > 0.05) < 2e-3
        if device == "TILES":
            assert error(found["Combined"][..., :3], expected["Combined"][..., :3]) < 0.007


def test_glow_takes_shape_and_colour() -> None:
    scene = core.Scene()
    scene.add_particles([(0, 0, 0)], radius=1.5, density=0.5, emission=(1.0, 2.0, 3.0), map=wisp(12))
    expected = core.render_reference(scene, camera(64))["Combined"]
    for device in DEVICES:
        found = core.render(scene, camera(64), core.Settings(device=device))["Combined"]
        assert error(found[..., :3], expected[..., :3]) < (1e-3 if device == "TILES" else 0.1)


def test_camera_amid_mapped_smoke() -> None:
    scene, seen = cloud(wisp(12)), camera(64, matrix=at(0.1, 0, 0.4))
    expected = core.render_reference(scene, seen)["Combined"]
    for device in DEVICES:
        found = core.render(scene, seen, core.Settings(device=device))["Combined"]
        assert error(found[..., 3], expected[..., 3]) < 1e-3


def test_holes_in_thick_smoke_show_what_is_behind() -> None:
    """Where a map is transparent the camera sees past a particle that would hide everything without it."""
    half = np.ones((4, 4, 4), np.float32)
    half[:2, :, 3] = 0
    scene = core.Scene()
    scene.add_particles([(0, 0, 1)], radius=2.0, density=40.0, map=half)
    rng = np.random.default_rng(1)
    scene.add_particles(rng.normal(0, 0.4, (60, 3)) - (0, 0, 1.5), radius=0.4, density=4.0)
    scene.add_light("SUN", [[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]], power=3.0)
    seen = camera(64)
    found, expected = core.render(scene, seen)["Combined"], core.render_reference(scene, seen)["Combined"]
    assert error(found[..., 3], expected[..., 3]) < 1e-3
    assert error(found[..., :3], expected[..., :3]) < 0.01


def test_smoke_that_tints_light() -> None:
    scene, seen = cloud(wisp(6), extinction_color=(0.5, 1.0, 1.5)), camera(64)
    found, expected = core.render(scene, seen)["Combined"], core.render_reference(scene, seen)["Combined"]
    assert error(found[..., 3], expected[..., 3]) < 5e-4
    assert error(found[..., :3], expected[..., :3]) < 0.01


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("radius", [0.04, 0.3])
def test_optical_depth_is_that_without_a_map_at_any_size(radius: float, device: str) -> None:
    """From particles of half a pixel to ones of many: within a thousandth from 64 pixels to 2048."""
    rng = np.random.default_rng(1)
    spots = np.ones((64, 64, 4), np.float32)
    spots[..., 3] = rng.random((64, 64)) < 0.2
    place = rng.uniform(-0.3, 0.3, (300 if radius < 0.1 else 60, 3))
    sizes = (64, 128, 512, 2048) if device == "TILES" else (64, 256)  # larger ones take long without a graphics card
    for image in (wisp(256), spots):
        ratios = []
        for size in sizes:
            seen = camera(size, type="ORTHOGRAPHIC", ortho_scale=3.0)
            means = []
            for chosen in (None, image):
                scene = core.Scene()
                scene.add_particles(place, radius=radius, density=0.02, map=chosen)
                combined = core.render(scene, seen, core.Settings(device=device))["Combined"]
                means.append(depths(combined).mean())
            ratios.append(means[1] / means[0])
        assert np.abs(np.array(ratios) - 1).max() < 1e-3


@pytest.mark.parametrize("device", DEVICES)
def test_small_pictures_are_means_of_large_ones(device: str) -> None:
    """Maps are averaged over pixels, colours with their opacity."""
    scene = core.Scene()
    place = np.random.default_rng(4).uniform(-1, 1, (12, 3))
    scene.add_particles(place, radius=0.8, density=0.02, emission=(0.02, 0.01, 0.01), map=wisp(128))
    settings = core.Settings(device=device)
    small, large = (core.render(scene, camera(size, lens=60.0), settings)["Combined"] for size in (48, 384))
    mean = large.reshape(48, 8, 48, 8, 4).mean(axis=(1, 3))
    assert error(small, mean) < 0.07
    assert np.abs(small.mean(axis=(0, 1)) / mean.mean(axis=(0, 1)) - 1).max() < 2e-3


def test_maps_dont_shimmer() -> None:
    """A camera that moves by eighths of a pixel changes pixels about as evenly as without a map, and hardly their sum."""
    frames = {}
    for name, image in {"plain": None, "mapped": wisp(256)}.items():
        scene = cloud(image, count=40, radius=0.25, density=1.0)
        steps = np.arange(9) / 8 * 6 / 96
        frames[name] = np.array(
            [core.render(scene, camera(96, matrix=at(step, 0.4 * step, 6)))["Combined"][..., 3] for step in steps]
        )
    sums = -np.log1p(-frames["mapped"].astype(np.float64)).sum(axis=(1, 2))
    assert np.ptp(sums) < 2e-3 * sums.mean()
    change, bend = (
        {name: np.sqrt(np.mean(np.diff(frame, order, axis=0) ** 2)) for name, frame in frames.items()}
        for order in (1, 2)
    )
    assert change["mapped"] < 2.5 * change["plain"]
    assert bend["mapped"] < 0.3 * change["mapped"]


@pytest.mark.parametrize("device", DEVICES)
def test_turns_hang_on_ids_alone(device: str) -> None:
    rng = np.random.default_rng(5)
    place, ident = rng.uniform(-1, 1, (30, 3)), rng.integers(0, 2**40, 30)
    pictures = []
    for order in (np.arange(30), rng.permutation(30)):
        scene = core.Scene()
        scene.add_particles(place[order], radius=0.5, density=2.0, ident=ident[order], map=wisp(32))
        scene.add_light("SUN", power=2.0)
        pictures.append(core.render(scene, camera(48), core.Settings(device=device))["Combined"])
    assert np.array_equal(*pictures)
    scene = core.Scene()
    scene.add_particles(place, radius=0.5, density=2.0, ident=ident + 1, map=wisp(32))
    scene.add_light("SUN", power=2.0)
    assert error(core.render(scene, camera(48), core.Settings(device=device))["Combined"], pictures[0]) > 0.1


def test_sets_with_different_maps() -> None:
    """Each particle gets its own set's map, on both devices alike, though they are drawn through one another."""
    rng = np.random.default_rng(6)
    scene = core.Scene()
    for image, name in ((wisp(100, 1), "A"), (None, "B"), (wisp(37, 7)[:, :20], "C"), (wisp(100, 1), "D")):
        scene.add_particles(rng.uniform(-1.5, 1.5, (15, 3)), radius=0.6, density=2.0, name=name, map=image)
    passes = ("Combined", "Albedo")
    tiles, gl = (core.render(scene, camera(128), core.Settings(device=device), passes) for device in DEVICES)
    assert error(gl["Combined"][..., 3], tiles["Combined"][..., 3]) < 5e-4
    assert error(gl["Albedo"], tiles["Albedo"]) < 0.1  # here blended one after the other, there mixed


def test_albedo_has_the_maps_colours_and_vector_has_not() -> None:
    halves = np.ones((2, 2, 4), np.float32)
    halves[:, 0, :3], halves[:, 1, :3] = (1.0, 0.0, 0.0), (0.0, 0.5, 0.0)
    for device in DEVICES:
        scene = core.Scene()
        scene.add_particles([(0, 0, 0)], radius=2.0, density=1.0, albedo=0.8, velocity=(0.3, 0, 0), map=halves)
        result = core.render(scene, camera(64), core.Settings(device=device), ("Combined", "Albedo", "Vector"))
        albedo, alpha = result["Albedo"], result["Combined"][..., 3]
        assert np.allclose(albedo[..., 0] + 2 * albedo[..., 1], 0.8 * alpha, atol=2e-3)
        assert albedo[..., 0].max() > 0.3 and albedo[..., 1].max() > 0.15
        seen = alpha > 0.05
        assert np.ptp(result["Vector"][seen][:, 0]) < 0.05 * np.abs(result["Vector"][seen][:, 0]).mean()


def test_lights_dont_see_maps() -> None:
    points = np.random.default_rng(1).uniform(-2, 2, (50, 3))
    plain, mapped = (core.transmittance(cloud(image), points, light=1) for image in (None, wisp(32)))
    assert np.array_equal(plain, mapped)


def test_deep_samples_make_the_picture() -> None:
    result = core.render(cloud(wisp(64)), camera(48), deep=True)
    through, picture = np.ones(48 * 48), np.zeros((48 * 48, 4))
    counts = result.deep.counts.ravel().astype(int)
    first = np.cumsum(counts) - counts
    for rank in range(counts.max()):
        has = counts > rank
        sample = result.deep.samples[(first + rank)[has], :4]
        picture[has] += through[has, None] * sample
        through[has] *= 1 - sample[:, 3]
    assert np.abs(picture.reshape(48, 48, 4) - result["Combined"]).max() < 2e-4


def test_wrong_maps_are_refused() -> None:
    scene = core.Scene()
    wrong = {
        "map of 'Puff' has shape (4, 4), expected (height, width, 4)": np.zeros((4, 4)),
        "Puff: the map's pixel 2, 1 holds 1.5, not within 0..1": np.pad([[[1.5]]], ((1, 2), (2, 1), (0, 3))),
        "Puff: the map is transparent: its mean opacity is 0": np.zeros((4, 4, 4)),
        "Puff: a map of 0 x 4 pixels; each must be within 1..16384": np.zeros((4, 0, 4)),
    }
    for message, image in wrong.items():
        with pytest.raises(core.FumaroleError) as caught:
            scene.add_particles([(0, 0, 0)], name="Puff", map=image)
        assert str(caught.value) == message
