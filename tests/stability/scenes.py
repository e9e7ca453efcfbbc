# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes that the stability cases share, and how far a picture is from the truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fumarole import core

SIDE = 16
LAMP = {"type": "POINT", "power": 1000.0}
WALL = [(0, 1, 2), (0, 2, 3)]


def at(*position: float) -> NDArray[np.float64]:
    """Matrix of something that stands at a position and looks along -Z."""
    matrix = np.eye(4)
    matrix[:3, 3] = position
    return matrix


def aimed(position: ArrayLike, target: ArrayLike = (0, 0, 0)) -> NDArray[np.float64]:
    """Matrix of something at a position that looks at a target."""
    position, target = np.asarray(position, float), np.asarray(target, float)
    back = (position - target) / np.linalg.norm(position - target)
    right = np.cross((0, 0, 1) if abs(back[2]) < 0.9 else (0, 1, 0), back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = right, np.cross(back, right), back, position
    return matrix


def camera(
    position: ArrayLike = (0, -5, 0), half: float = 0.3, width: int = SIDE, height: int = SIDE, target: ArrayLike = (0, 0, 0), **more
) -> core.Camera:
    """A camera whose picture reaches `half` to either side of its middle, at unit depth; its pixels are square."""
    up = half * height / width
    more = {"clip": (0.01, 1000.0)} | more
    return core.Camera.from_window(aimed(position, target), (-half, half, -up, up), width, height, **more)


def lamp(*position: float, **more: Any) -> dict[str, Any]:
    """A point light."""
    return LAMP | {"matrix": at(*position)} | more


def sun(towards: ArrayLike, **more: Any) -> dict[str, Any]:
    """A sun that shines towards a direction."""
    return {"type": "SUN", "power": 1.0, "matrix": aimed((0, 0, 0), towards)} | more


def single(sigma: float, depth: float, position: ArrayLike = (0, 0, 0)) -> dict[str, Any]:
    """One particle of an optical depth through its centre."""
    return {"position": np.array([position]), "radius": 2 * sigma, "density": depth / (sigma * math.sqrt(2 * math.pi))}


def ball(count: int, depth: float, seed: int = 1, radius: float = 1.0, overlap: float = 0.5) -> dict[str, Any]:
    """Random particles in a ball: n sigma^3 is `overlap`, the mean optical depth across the ball `depth`."""
    rng = np.random.default_rng(seed)
    way = rng.normal(size=(count, 3))
    way *= radius * rng.random((count, 1)) ** (1 / 3) / np.linalg.norm(way, axis=1, keepdims=True)
    volume = 4 / 3 * math.pi * radius**3
    sigma = (overlap * volume / count) ** (1 / 3)
    extinction = depth / (2 * radius)
    return {
        "position": way.astype(np.float32),
        "radius": 2 * sigma,
        "density": extinction * volume / (count * (2 * math.pi) ** 1.5 * sigma**3),
    }


def wall(x: float, low: float = -4, high: float = 4) -> dict[str, Any]:
    """A square across the X axis."""
    return {"vertices": [(x, low, low), (x, high, low), (x, high, high), (x, low, high)], "triangles": WALL}


def screen(y: float) -> dict[str, Any]:
    """A square across the Y axis, along which the camera looks."""
    return {"vertices": [(-4, y, -4), (4, y, -4), (4, y, 4), (-4, y, 4)], "triangles": WALL}


def cube(half: float) -> dict[str, Any]:
    corners = [(x, y, z) for x in (-half, half) for y in (-half, half) for z in (-half, half)]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return {"vertices": corners, "triangles": [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]}


def build(
    particles: dict[str, Any] | Sequence[dict[str, Any]], lights: Sequence[dict[str, Any]] = (), meshes: Sequence[dict[str, Any]] = ()
) -> core.Scene:
    """A scene in a context of its own."""
    scene = core.Scene(core.Context())
    for one in [particles] if isinstance(particles, dict) else particles:
        scene.add_particles(**one)
    for light in lights:
        scene.add_light(**light)
    for mesh in meshes:
        scene.add_mesh(**mesh)
    return scene


def picture(scene: core.Scene, view: core.Camera, **settings: Any) -> NDArray[np.float64]:
    """RGBA of a render. Raises FumaroleError, and ValueError when a pixel is not finite."""
    pixels = core.render(scene, view, core.Settings(**settings), passes=("Combined",))["Combined"].astype(float)
    if not np.isfinite(pixels).all():
        raise ValueError(f"{np.count_nonzero(~np.isfinite(pixels))} values of the picture are not finite")
    return pixels


def truth(scene: core.Scene, view: core.Camera, **more: Any) -> NDArray[np.float64]:
    """RGBA by brute force."""
    return core.render_reference(scene, view, **({"tolerance": 1e-3} | more))["Combined"]


def apart(found: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """RMS of the difference over the RMS of what is expected; the larger one of colour and opacity."""
    shares = []
    for channels in (slice(0, 3), slice(3, 4)):
        size = math.sqrt(np.mean(expected[..., channels] ** 2))
        error = math.sqrt(np.mean((found[..., channels] - expected[..., channels]) ** 2))
        shares.append(error / size if size > 0 else (math.inf if error > 0 else 0.0))
    return max(shares)


def error(
    particles: dict[str, Any] | Sequence[dict[str, Any]],
    lights: Sequence[dict[str, Any]] = (),
    view: core.Camera | None = None,
    meshes: Sequence[dict[str, Any]] = (),
    **settings: Any,
) -> float:
    """How far the picture is from the truth. A picture without smoke would say nothing, hence is refused."""
    view = view or camera()
    scene = build(particles, lights, meshes)
    expected = truth(scene, view)
    if not expected[..., 3].any() or (lights and not expected[..., :3].any()):
        raise ValueError("the true picture is empty")
    return apart(picture(scene, view, **settings), expected)
