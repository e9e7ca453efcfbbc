# SPDX-License-Identifier: GPL-3.0-or-later
"""Short animations, and how steady their pictures are.

Every case of the table renders an animation twice: as a user would, and the truth. Of the error, picture less truth,
three figures are taken, each as a share of what it is compared with, so that motion itself counts for nothing:

grain: RMS of what changes from frame to frame, from the second differences in time, over the RMS of the truth.
jump: the largest RMS change from a frame to the next, over the RMS of the truth.
brightness: the largest change of a frame's mean from a frame to the next, over the mean of the truth.

Each is that of colour or of opacity, whichever is larger.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scenes import ball, build, camera, lamp, picture, single, truth

from fumarole import core

Frames = list[tuple[core.Scene, core.Camera]]
Pixels = NDArray[np.float64]

SIDE_LIGHT = [lamp(4, -1, 1)]


@dataclass(frozen=True)
class Steadiness:
    """The figures of an animation."""

    grain: float
    jump: float
    brightness: float


def steadiness(found: Pixels, expected: Pixels) -> Steadiness:
    """Of pictures (frames, height, width, 4)."""
    figures = []
    for channels in (slice(0, 3), slice(3, 4)):
        error, level = found[..., channels] - expected[..., channels], expected[..., channels]
        rms, mean = math.sqrt(np.mean(level**2)), float(np.mean(level))
        second = error[2:] - 2 * error[1:-1] + error[:-2]
        # Of errors that have nothing to do with each other, second differences have six times the variance.
        grain = math.sqrt(np.mean(second**2) / 6) / rms
        jump = math.sqrt(np.mean(np.diff(error, axis=0) ** 2, axis=(1, 2, 3)).max()) / rms
        brightness = float(np.abs(np.diff(error.mean(axis=(1, 2, 3)))).max()) / mean
        figures.append((grain, jump, brightness))
    return Steadiness(*(max(pair) for pair in zip(*figures)))


def pictures(frames: Frames, **settings: Any) -> Pixels:
    return np.array([picture(scene, view, **settings) for scene, view in frames])


def fine(frames: Frames, **settings: Any) -> Pixels:
    """The truth where brute force would take long: solved exactly and ten times as fine."""
    return pictures(frames, **{"tolerance": 1e-3, "solver": "EXACT", "device": "TILES"} | settings)


def brute(frames: Frames, **_settings: Any) -> Pixels:
    return np.array([truth(scene, view) for scene, view in frames])


def at_rest(frames: Frames, **settings: Any) -> Pixels:
    """Where nothing that shows changes, the truth is that no frame differs from the first."""
    return np.repeat(pictures(frames[:1], **settings), len(frames), axis=0)


# ---- Animations


def view(**more: Any) -> core.Camera:
    return camera(**{"width": 32, "height": 32} | more)


def moving_camera(particles: dict[str, Any], lights: Sequence = SIDE_LIGHT, meshes: Sequence = (), count: int = 8, **more: Any) -> Frames:
    """A degree a frame around smoke that rests."""
    scene = build(particles, lights, meshes)
    angles = [0.02 * frame for frame in range(count)]
    return [(scene, view(position=(5 * math.sin(a), -5 * math.cos(a), 1.5 * a), **more)) for a in angles]


def moving_smoke(particles: dict[str, Any], lights: Sequence = SIDE_LIGHT, count: int = 8, speed: float = 0.05) -> Frames:
    """Each particle has a velocity of its own, m a frame."""
    velocity = np.random.default_rng(9).normal(0, speed / 2, particles["position"].shape) + (0, 0, speed)
    moved = [particles | {"position": particles["position"] + velocity * frame} for frame in range(count)]
    return [(build(one, lights), view()) for one in moved]


def born_and_dying(count: int, depth: float, frames: int = 8, shuffled: bool = False) -> Frames:
    """Particles rise for 50 frames; one in 50 is born and one dies in each. Shuffled: they come in another order each
    time."""
    particles, random, life = ball(count, 2 * depth), np.random.default_rng(11), 50
    birth = random.uniform(-life, frames, count)
    result = []
    for frame in range(frames):
        alive = np.flatnonzero((birth <= frame) & (birth + life > frame))
        if shuffled:
            alive = random.permutation(alive)
        risen = particles["position"][alive] + (frame - birth[alive])[:, None] * (0, 0, 0.02)
        smoke = particles | {"position": risen, "ident": alive.astype(np.uint64), "name": "smoke"}
        result.append((build(smoke, SIDE_LIGHT), view(target=(0, 0, 0.5))))
    return result


def born(count: int, alive: Sequence[int], depth: float) -> Frames:
    """As many are alive as is said for each frame."""
    particles = ball(count, depth)
    some = [particles | {"position": particles["position"][:number]} for number in alive]
    return [(build(one, SIDE_LIGHT), view()) for one in some]


def thickening(particles: dict[str, Any], lights: Sequence, factor: float, count: int = 10) -> Frames:
    """Density grows by a factor from frame to frame."""
    grown = [particles | {"density": particles["density"] * factor**frame} for frame in range(count)]
    return [(build(one, lights), view()) for one in grown]


def flying_in(count: int = 10) -> Frames:
    """The camera flies into a cloud."""
    scene = build(ball(300, 5), SIDE_LIGHT)
    return [(scene, view(position=(0.05, -1.9 + 0.08 * frame, 0.1), half=0.6, target=(0.05, 5, 0.1))) for frame in range(count)]


def through_the_frame(count: int = 12) -> Frames:
    """The camera pans, so that a cloud comes into the frame on one side and begins to leave it on the other."""
    scene = build(ball(300, 5), SIDE_LIGHT)
    places = [2.2 - 0.25 * frame for frame in range(count)]
    return [(scene, view(position=(x, -5, 0), target=(x, 0, 0))) for x in places]


def stray(particles: dict[str, Any], axis: int) -> Frames:
    """A speck flies off, so that the box around everything grows, behind the cloud (1) or out of the frame (0)."""
    result = []
    for distance in (2, 3, 4.5, 7, 11, 20, 40, 90):
        place = np.array((0.0, 3.0, 0.0)) if axis == 0 else np.zeros(3)
        place[axis] = distance
        result.append((build([particles | {"name": "cloud"}, single(0.02, 4, place) | {"name": "speck"}], SIDE_LIGHT), view()))
    return result


def rising(particles: dict[str, Any], lights: Sequence, step: float, world: float = 0.0, count: int = 8) -> Frames:
    """The cloud rises, the camera with it."""
    result = []
    for up in (step * frame for frame in range(count)):
        scene = build(particles | {"position": particles["position"] + (0, 0, up)}, lights)
        if world > 0:
            scene.add_world(world)
        result.append((scene, view(position=(0, -5, up), target=(0, 0, up))))
    return result


def coming_and_going(count: int = 6) -> Frames:
    """Other smoke, out of sight, is there in every second frame."""
    other = ball(300, 2, seed=2) | {"name": "other", "position": ball(300, 2, seed=2)["position"] + (0, 0, 90)}
    smoke = ball(2000, 5) | {"name": "smoke"}
    return [(build([other] * (frame % 2) + [smoke], SIDE_LIGHT), view()) for frame in range(count)]


def changing_places(depth: float, count: int = 12) -> Frames:
    """A red and a blue particle pass each other along the view, beside each other."""
    result = []
    for y in (0.1 * (frame - (count - 1) / 2) for frame in range(count)):
        pair = single(0.35, depth) | {"position": np.array([(0, y, 0), (0.1, -y, 0)]), "albedo": np.array([(1, 0.1, 0.1), (0.1, 0.1, 1)])}
        result.append((build(pair, SIDE_LIGHT), view()))
    return result


def across_a_pixel(depth: float, steps: int = 9, **settings: Any) -> float:
    """A particle of a tenth of a pixel crosses one: how much the sum over the picture changes."""
    pixel = 5 * 0.6 / 16
    sums = []
    for share in np.linspace(0, 1, steps):
        place: ArrayLike = (share * pixel, 0, 0.3 * share * pixel)
        scene = build(single(pixel / 20, depth, place), [{"type": "SUN", "power": 1.0, "matrix": np.eye(4)}])
        sums.append(picture(scene, camera(), **settings).sum((0, 1)))
    found = np.array(sums)
    return float((found.max(0) / found.min(0) - 1).max())


def around_dust(count: int = 8) -> float:
    """The camera moves by parts of a pixel around dense specks: the largest second difference, from frame to frame, of
    the sum over the picture, as a share of it."""
    places = np.random.default_rng(10).uniform(-0.5, 0.5, (2000, 3))
    scene = build({"position": places, "radius": 0.008, "density": 3 / (0.004 * math.sqrt(2 * math.pi))}, SIDE_LIGHT)
    shown = [(scene, camera(position=(x, -5, 0.7 * x))) for x in (0.03 * frame for frame in range(count))]
    sums = pictures(shown).sum((1, 2))
    return float(np.abs(np.diff(sums, 2, axis=0) / sums[1:-1]).max())


Truth = Callable[..., Pixels]
