# SPDX-License-Identifier: GPL-3.0-or-later
"""Smooth smoke is drawn on a coarser grid and interpolated. The same pictures pixel by pixel: the pass Albedo draws the
particles once more, for which all pixels are needed."""

from __future__ import annotations

import numpy as np
import pytest

from clouds import FRONT, SIDE, WALL, cloud, lit, plume
from fumarole import core

SUN = {"type": "SUN", "power": 2.0, "color": (1.0, 0.5, 0.2)}
BACKDROP = ([[-1.5, -5, -3], [5, -5, -4], [5, 5, -4], [-1, 5, -3]], [[0, 1, 2], [0, 2, 3]])


def mixed() -> dict:
    """Wide particles, and twenty that are narrower than pixels among them."""
    few = cloud(20, 4e-3, 2.0, seed=8)
    parts = [cloud(2000, 0.25, 0.01), few]
    return {name: np.concatenate([part[name] for part in parts]) for name in ("position", "radius", "density")}


def render(
    particles: dict, is_full: bool, lights: tuple = (SIDE, SUN), wall: tuple = (), passes: tuple = ("Combined",), **how
) -> dict[str, np.ndarray]:
    threads, solids = how.pop("threads", 0), how.pop("solids", "HOLDOUT")
    scene = lit(particles, lights, wall, threads)
    camera = core.Camera(**({"matrix": FRONT, "lens": 60, "width": 600, "height": 450} | how))
    result = core.render(
        scene,
        camera,
        core.Settings(device="TILES", solids=solids),
        passes=passes + (("Albedo",) if is_full else ()),
    )
    return {name: np.asarray(result[name], float) for name in result if name != "Albedo"}


# Particles, how they are seen, and the share of the smoke's pixels that is drawn as if there were no grid, at most.
SCENES = {
    "plume": (plume(9000, 0.1, 0.05), {}, 0.5),
    "ball": (cloud(3000, 0.25, 0.1), {}, 0.1),
    "ball of depth 20": (cloud(3000, 0.2, 0.5), {}, 0.2),
    "single particles": (cloud(30, 0.5, 0.5), {}, 0.1),
    "dense single particles": (cloud(12, 0.4, 20.0), {}, 0.2),
    "mixed radii": (mixed(), {}, 0.9),
    "wall in front": (cloud(3000, 0.25, 0.1), {"wall": WALL}, 0.9),
    "in front of a wall": (cloud(3000, 0.25, 0.1), {"wall": BACKDROP}, 0.1),
    "in front of a wall in the light": (cloud(3000, 0.25, 0.1), {"wall": BACKDROP, "solids": "SHADED"}, 0.6),
    "all of the frame": (cloud(3000, 0.3, 0.02), {"lens": 200}, 0.1),
    "orthographic": (cloud(3000, 0.25, 0.1), {"type": "ORTHOGRAPHIC", "ortho_scale": 3.0}, 0.1),
    "camera inside": (cloud(3000, 0.3, 0.01), {"matrix": np.eye(4), "lens": 20, "clip": (0.01, 100)}, 0.1),
    "odd sizes": (cloud(3000, 0.25, 0.1), {"width": 611, "height": 397}, 0.1),
    "glow": (cloud(3000, 0.25, 0.1, emission=(2.0, 1.0, 0.3)), {}, 0.1),
}


def differences(found: np.ndarray, full: np.ndarray) -> tuple[float, float]:
    """Relative RMS, and the largest difference over the pixel's own value and the mean where there is something."""
    there = full[full > 1e-3 * full.max()].mean()
    worst = (np.abs(found - full) / (np.abs(full) + there)).max()
    return float(np.sqrt(((found - full) ** 2).mean() / (full**2).mean())), float(worst)


def check(found: np.ndarray, full: np.ndarray, most: float, light_most: float) -> None:
    """Opacity within 2e-4, at most 0.15 % off in a pixel. Light within 5e-4, and at most `light_most` off: pixel by
    pixel it isn't smooth either, but bends between the lattice's samples."""
    same = (found == full).all(-1)[full[..., 3] > 0.01].mean()
    rms, worst = differences(found[..., 3], full[..., 3])
    light_rms, light_worst = differences(found[..., :3], full[..., :3])
    assert same < most, "the grid wasn't used"
    assert rms < 2e-4 and worst < 1.5e-3
    assert light_rms < 5e-4 and light_worst < light_most
    assert found.min() >= 0 and found[..., 3].max() <= 1


@pytest.mark.parametrize("name", SCENES)
def test_same_as_pixel_by_pixel(name: str) -> None:
    """A wall's shadow in smoke has steps, each slab's edge of its own."""
    particles, view, most = SCENES[name]
    found, full = (render(particles, is_full, **view)["Combined"] for is_full in (False, True))
    check(found, full, most, 0.015 if "wall" in view else 0.006)


def test_narrow_particles_are_drawn_pixel_by_pixel() -> None:
    """Bit by bit as without a grid, the wide ones around them included."""
    found, full = (render(mixed(), is_full)["Combined"] for is_full in (False, True))
    without = render({name: values[:2000] for name, values in mixed().items()}, True)["Combined"]
    dust = np.abs(full[..., 3] - without[..., 3]) > 1e-2
    assert dust.sum() > 20 and (found == full)[dust].all()


def test_narrow_and_grainy_pictures_are_as_without_a_grid() -> None:
    """Narrower than pixels; and wide enough, but so dense that splines follow hardly any of the picture."""
    for particles in (cloud(4000, 4e-3, 0.5), cloud(20_000, 0.03, 1.0)):
        found, full = (render(particles, is_full)["Combined"] for is_full in (False, True))
        assert np.array_equal(found, full)


def test_small_pictures_are_as_without_a_grid() -> None:
    found, full = (render(SCENES["ball"][0], is_full, width=160, height=120)["Combined"] for is_full in (False, True))
    assert np.array_equal(found, full)


def test_parts_of_the_light() -> None:
    """Passes of single lights and of what smoke emits are the same as pixel by pixel, and add up to Combined."""
    particles = cloud(3000, 0.25, 0.1, emission=(0.2, 0.1, 0.3))
    parts = (("Light", 0), ("Light", 1), "Emit")
    found, full = (render(particles, is_full, passes=("Combined", "Opacity", *parts)) for is_full in (False, True))
    for name in (*parts, "Opacity"):
        rms, worst = differences(found[name], full[name])
        assert rms < 5e-4 and worst < 1e-2, name
        assert not np.array_equal(found[name], full[name])
    total = sum(found[part] for part in parts)
    assert found["Combined"][..., :3] == pytest.approx(total, rel=1e-4, abs=1e-5)


def test_as_close_to_the_reference() -> None:
    """What splines lose is little against what pixels are off by anyway."""
    scene = core.Scene(core.Context())
    scene.add_particles(**cloud(1000, 0.3, 0.15))
    for light in (SIDE, SUN):
        scene.add_light(**light)
    camera = core.Camera(matrix=FRONT, lens=60, width=600, height=450)
    window = (380, 230, 408, 258)
    expected = core.render_reference(scene, camera.crop(*window), tolerance=1e-4, passes=("Combined",))["Combined"]
    left, bottom, right, top = window
    settings = core.Settings(device="TILES")
    errors = []
    for passes in (("Combined",), ("Combined", "Albedo")):
        found = core.render(scene, camera, settings, passes)["Combined"][bottom:top, left:right]
        errors.append(differences(found[..., :3], expected[..., :3]))
    assert errors[0] != errors[1]
    assert errors[0][0] < 1.1 * errors[1][0] + 2e-4 and errors[0][0] < 5e-3


def test_threads_change_no_bit() -> None:
    one, four = (render(SCENES["plume"][0], False, threads=threads)["Combined"] for threads in (1, 4))
    assert np.array_equal(one, four)


def test_crops_are_the_same() -> None:
    """The grid begins elsewhere then."""
    scene = core.Scene(core.Context())
    scene.add_particles(**SCENES["ball"][0])
    scene.add_light(**SUN)
    camera = core.Camera(matrix=FRONT, lens=60, width=600, height=450)
    settings = core.Settings(device="TILES")
    whole = core.render(scene, camera, settings)["Combined"]
    part = core.render(scene, camera.crop(101, 53, 501, 353), settings)["Combined"]
    rms, worst = differences(part.astype(float), whole[53:353, 101:501].astype(float))
    assert rms < 5e-4 and worst < 1e-2
