# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion blur and depth of field by the shape of the billboard, against the mean of many sharp pictures."""

from __future__ import annotations

import dataclasses
import numpy as np
import pytest
from numpy.typing import NDArray

from fumarole import core

Picture = NDArray[np.float64]
SIZE = 64
#: Tolerances of the renders: what is compared are footprints, not how coarsely light is found.
FINE = core.Settings(device="TILES", tolerance=1e-3)


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> NDArray[np.float64]:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def turned(angle: float, z: float = 6.0) -> NDArray[np.float64]:
    """A camera on the z axis that looks a little aside."""
    matrix = at(0, 0, z)
    matrix[0, 0] = matrix[2, 2] = np.cos(angle)
    matrix[0, 2], matrix[2, 0] = np.sin(angle), -np.sin(angle)
    return matrix


def camera(**changes: object) -> core.Camera:
    return core.Camera(**{"matrix": at(z=6), "lens": 50.0, "width": SIZE, "height": SIZE} | changes)


def cloud(count: int = 40, depth: float = 0.1, seed: int = 1, size: float = 1.0) -> dict[str, object]:
    """Particles in the frame; `depth` is the optical depth through the middle of all, about."""
    rng = np.random.default_rng(seed)
    radii = rng.uniform(0.2, 0.4, count) * size
    sigma = radii / 2
    area = np.pi * 1.0**2
    density = np.full(count, depth * area / np.sum(sigma**3 * (2 * np.pi) ** 1.5))
    return {
        "positions": rng.uniform(-1, 1, (count, 3)),
        "radius": radii,
        "density": density,
        "emission": rng.uniform(0.1, 1.0, (count, 3)) * density[:, None],
        "albedo": 0.0,
    }


def scene_of(particles: dict[str, object], shift: float = 0.0) -> core.Scene:
    """Particles where they are `shift` frames later."""
    described = dict(particles)
    velocity = described.pop("velocity", 0.0)
    position = np.asarray(described.pop("positions"), float)
    described["velocity"] = np.broadcast_to(velocity, position.shape)
    scene = core.Scene(core.Context())
    scene.add_particles(position + shift * described["velocity"], **described)
    return scene


def draw(scene: core.Scene, view: core.Camera, settings: core.Settings = FINE) -> Picture:
    return core.render(scene, view, settings)["Combined"].astype(float)


def sharp(view: core.Camera) -> core.Camera:
    return view.blurred()


def instants(shutter: tuple[float, float], count: int) -> NDArray[np.float64]:
    return shutter[0] + (np.arange(count) + 0.5) / count * (shutter[1] - shutter[0])


def mean_over_shutter(particles: dict[str, object], view: core.Camera, count: int = 48) -> Picture:
    """Particles moved, the camera still."""
    times = instants(view.shutter, count)
    return sum(draw(scene_of(particles, t), sharp(view)) for t in times) / count


def lens_points(aperture: core.Aperture, count: int) -> NDArray[np.float64]:
    """[count, 2] points spread evenly over the aperture, m (Roberts' R2 sequence)."""
    index = np.arange(count)[:, None]
    a, b = ((0.5 + index * np.array([0.7548776662466927, 0.5698402909980532])) % 1).T
    if aperture.blades == 0:
        radius, angle = np.sqrt(a), 2 * np.pi * b
        points = np.stack((radius * np.cos(angle), radius * np.sin(angle)), 1)
    else:
        # Triangles between the centre and two corners each, each a part of the sequence.
        corner = np.floor(a * aperture.blades)
        a = np.sqrt(a * aperture.blades - corner)
        angles = aperture.rotation + 2 * np.pi / aperture.blades * np.stack((corner, corner + 1))
        first, second = np.stack((np.cos(angles), np.sin(angles)), -1)
        points = a[:, None] * (first + b[:, None] * (second - first))
    return points * aperture.radius * (1 / aperture.ratio, 1)


def seen_from(view: core.Camera, x: float, y: float) -> core.Camera:
    """The camera from a point of its lens: what lies in the plane of focus stays where it is in the picture."""
    matrix = view.matrix.copy()
    matrix[:3, 3] += matrix[:3, 0] * x + matrix[:3, 1] * y
    left, right, bottom, top = view.window
    if view.type == "PERSPECTIVE":
        x, y = x / view.aperture.focus, y / view.aperture.focus
    window = (left - x, right - x, bottom - y, top - y)
    return core.Camera.from_window(matrix, window, view.width, view.height, view.type, view.clip)


def mean_over_lens(particles: dict[str, object], view: core.Camera, count: int = 800) -> Picture:
    scene = scene_of(particles)
    pictures = [draw(scene, seen_from(view, x, y)) for x, y in lens_points(view.aperture, count)]
    return sum(pictures) / len(pictures)


def depth_of(picture: Picture) -> Picture:
    """Optical depth."""
    return -np.log1p(-picture[..., 3])


def differ(found: Picture, expected: Picture) -> float:
    """Largest difference over the largest value."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


MOTIONS = {
    "across": (0.8, 0.3, 0.0),
    "short": (0.1, -0.05, 0.0),
    "along the view": (0.0, 0.0, 2.0),
    "aslant": (0.7, -0.4, 1.5),
    "long": (5.0, 1.0, 0.0),
}


@pytest.mark.parametrize("type", ["PERSPECTIVE", "ORTHOGRAPHIC"])
@pytest.mark.parametrize("motion", MOTIONS)
def test_motion_is_the_mean_over_the_shutter(motion: str, type: str) -> None:
    particles = cloud(depth=0.05) | {"velocity": MOTIONS[motion]}
    view = camera(type=type, ortho_scale=4.0).blurred((-0.25, 0.25))
    assert differ(draw(scene_of(particles), view), mean_over_shutter(particles, view)) < 5e-3
