# SPDX-License-Identifier: GPL-3.0-or-later
"""What the drawing of a picture must not change: its size in pixels, and the device."""

from __future__ import annotations

import numpy as np
import pytest

from clouds import cloud, plume, smoke
from fumarole import core

IN_FRONT = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 8.0], [0, 0, 0, 1]])


SOURCE = np.array([2.0, 1.0, 0.3])  # emission over density of all that glows here
FROM_THE_SIDE = np.array([[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1.0]])


def in_front(distance: float) -> np.ndarray:
    """A camera on the Z axis that looks at the origin."""
    matrix = IN_FRONT.copy()
    matrix[2, 3] = distance
    return matrix


def draw(
    particles: dict, width: int, height: int, device: str = "TILES", wall: tuple = (), sun: float = 0.0, **camera
) -> np.ndarray:
    scene = core.Scene(core.Context())
    scene.add_particles(**particles)
    if wall:
        scene.add_mesh(*wall)
    if sun > 0:
        scene.add_light("SUN", power=sun, matrix=FROM_THE_SIDE)
    view = core.Camera(**({"matrix": IN_FRONT, "lens": 50, "width": width, "height": height} | camera))
    result = core.render(scene, view, core.Settings(device=device), passes=("Combined",))
    return result["Combined"].astype(float)


@pytest.mark.parametrize("depth", [0.02, 0.5, 3.0])
def test_tiny_particles_are_as_opaque_at_any_width(depth: float) -> None:
    """From a tenth of a pixel to most of one; few enough that they hardly overlap, where the mean of alpha is the
    area that they cover."""
    particles = cloud(4_000, 6e-4, depth)
    means = [draw(particles, width, width // 32)[..., 3].mean() for width in (512, 1024, 2048, 4096)]
    assert means == pytest.approx([means[-1]] * 4, rel=1e-3)


def radii_1_to_30() -> dict:
    rng = np.random.default_rng(6)
    return smoke(rng.normal(0.0, 0.7, (300, 3)), 0.03 * 30 ** rng.uniform(size=300), 0.5)


def fog_around_a_cloud() -> dict:
    parts = [cloud(300, 0.15, 0.4), smoke(np.zeros((1, 3)), 4.0, 0.3)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


HALF_A_WALL = ([[-5, -5, 0.3], [0.13, -5, 0.1], [0.41, 5, 0.2], [-5, 5, 0.0]], [[0, 1, 2], [0, 2, 3]])
SLANTED_WALL = ([[-5, -5, 0.1], [5, -5, -0.5], [5, 5, 0.6], [-5, 5, 0.0]], [[0, 1, 2], [0, 2, 3]])

# Particles, and the camera and wall that they are seen with.
SCENES = {
    "plume": (plume(4_000, 0.15, 0.1), {}),
    "ball": (cloud(500, 0.4, 0.3), {}),
    "dense ball": (cloud(300, 0.4, 3.0), {}),
    "radii 1 to 30": (radii_1_to_30(), {}),
    "few, of depth 20": (cloud(6, 0.8, 20.0), {}),
    "particle cut by a wall": (smoke(np.zeros((1, 3)), 1.0, 2.0), {"wall": SLANTED_WALL}),
    "ball cut by a wall": (cloud(300, 0.4, 1.0), {"wall": SLANTED_WALL}),
    "ball behind half a wall": (cloud(300, 0.4, 1.0), {"wall": HALF_A_WALL}),
    "camera inside": (cloud(300, 0.5, 0.02), {"matrix": in_front(0.0), "lens": 20, "clip": (0.01, 100)}),
    "orthographic": (cloud(500, 0.4, 0.5), {"type": "ORTHOGRAPHIC", "ortho_scale": 3.0}),
    "wide lens": (cloud(500, 0.3, 1.0), {"lens": 15}),
    "finer than pixels": (cloud(4_000, 0.01, 0.5), {}),
    "finer than pixels and dense": (cloud(4_000, 0.01, 20.0), {}),
    "across the near plane": (cloud(300, 0.4, 0.05), {"matrix": in_front(1.0), "lens": 35, "clip": (0.9, 100)}),
    "across the far plane": (cloud(300, 0.4, 1.0), {"clip": (0.1, 8.1)}),
    "fog around a cloud": (fog_around_a_cloud(), {}),
}


def difference(particles: dict, width: int, **view) -> tuple[float, float]:
    """Between the devices, relative RMS: of colour and of alpha."""
    pictures = [draw(particles, width, width * 2 // 3, device, **view) for device in ("GL", "TILES")]
    parts = [[picture[..., :3] for picture in pictures], [picture[..., 3] for picture in pictures]]
    return tuple(np.sqrt(np.mean((gl - tiles) ** 2) / np.mean(tiles**2)) for gl, tiles in parts)


@pytest.mark.parametrize("width", [96, 480])
@pytest.mark.parametrize("name", SCENES)
def test_devices_agree(name: str, width: int) -> None:
    """In opacity, and in colour where everything glows alike: there the order of particles doesn't matter."""
    particles, view = SCENES[name]
    glow = particles["density"][:, None] * SOURCE
    assert max(difference(particles | {"emission": glow}, width, **view)) < 1e-3


@pytest.mark.parametrize("name", [name for name in SCENES if "wall" not in SCENES[name][1]])
def test_devices_agree_on_thin_smoke_in_the_sun(name: str) -> None:
    """Where smoke hardly shades itself, light at particles' centres is as good as light inside of them. A wall's shadow
    isn't."""
    particles, view = SCENES[name]
    depth = particles["density"] * particles["radius"] / 2 * np.sqrt(2 * np.pi)
    assert max(difference(particles | {"density": particles["density"] * 1e-4 / depth}, 96, sun=3.0, **view)) < 1e-3


def test_what_glows_without_absorbing_is_the_same() -> None:
    particles = cloud(300, 0.4, 0.0) | {"emission": SOURCE}
    assert max(difference(particles, 96)) < 1e-3
