# SPDX-License-Identifier: GPL-3.0-or-later
"""What moves while the shutter is open, and how many samples show it; knows no bpy."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from .. import core
from .meshes import Mesh
from .particles import Particles
from .scene import Scene, fingerprint

# Solids aren't smeared: their edges come in steps of so many pixels, unless that takes too many samples.
_STEP_PX = 4.0
_MOST_SAMPLES = 64

# How far smeared smoke may be from where it is: pixels, or the share of a particle's radius if that is more...
_OFF_PX = 0.5
_OFF_RADIUS = 0.1
# ...for so many of the particles.
_SHARE = 0.95

# Vertices of a mesh that are looked at.
_MOST_VERTICES = 10_000

Item = TypeVar("Item", Mesh, Particles)

Chords = dict[tuple[str, int], tuple[np.ndarray, np.ndarray]]
"""Ids (n,) and velocities (n, 3), m a frame, of sets of particles by name and how many of that name came before."""


@dataclass
class Moment:
    """The scene and the camera `time` frames from now."""

    time: float
    scene: Scene
    camera: core.Camera


def camera_moves(moments: Sequence[Moment]) -> bool:
    """Whether the camera does, or what it looks through."""
    places = [(item.camera.matrix.tobytes(), item.camera.window, item.camera.aperture) for item in moments]
    return len(set(places)) > 1


def is_still(moments: Sequence[Moment]) -> bool:
    """Whether nothing that is drawn moves; lights don't count, as in Cycles."""
    if camera_moves(moments):
        return False
    particles = itertools.chain.from_iterable(moment.scene.particles for moment in moments)
    if any(item.velocities is not None and item.velocities.any() for item in particles):
        return False
    return len({fingerprint(moment.scene) for moment in moments}) == 1


def chords(shutter: Sequence[Moment]) -> Chords:
    """Mean velocities from its start to its end of particles that come without, as those of an object that is moved."""
    found: Chords = {}
    if not shutter:
        return found
    opens, closes = shutter[0], shutter[-1]
    for key, (first, last) in _matched(opens.scene.particles, closes.scene.particles):
        if (first.velocities is None or last.velocities is None) and np.array_equal(first.ids, last.ids):
            found[key] = (first.ids, (last.positions - first.positions) / np.float32(closes.time - opens.time))
    return found


def fill_velocities(scene: Scene, found: Chords) -> None:
    """Gives particles without velocities those found for them."""
    for key, (item,) in _matched(scene.particles):
        ids, velocities = found.get(key, (None, None))
        if item.velocities is None and ids is not None and np.array_equal(item.ids, ids):
            item.velocities = velocities


def least_samples(now: Moment, shutter: Sequence[Moment]) -> int:
    """How many samples what the library can't smear in one pass needs: solids that move or aren't in focus, and smoke
    whose way is bent. `now` has the camera's aperture, and velocities; `shutter`: moments from its start to its end."""
    steps = max(_solids_px(now, shutter), default=0.0) / _STEP_PX
    return min(max(math.ceil(steps), _bends(now, shutter), 1), _MOST_SAMPLES)


def sharp_samples(now: Moment, shutter: Sequence[Moment]) -> int:
    """How many samples without smears show the blur of smoke: so many that particles go on by a sigma, or by a pixel if
    that is more, from one to the next. Steps of a sigma leave errors below a hundredth."""
    needed = 1.0
    for item in now.scene.particles:
        if not item.visible_to_camera:
            continue
        px, depth = now.camera.project(item.positions)
        is_seen = ((px > 0) & (px < (now.camera.width, now.camera.height))).all(-1) & (depth > now.camera.clip[0])
        if not is_seen.any():
            continue
        pixel = (now.camera.window[1] - now.camera.window[0]) / now.camera.width
        scale = depth if now.camera.type == "PERSPECTIVE" else 1.0
        step = np.maximum(np.broadcast_to(item.radii, depth.shape) / 2.0 / (scale * pixel), 1.0)
        places = [_place_at(item, moment) for moment in shutter]
        way = sum((np.hypot(*(b - a).T) for a, b in itertools.pairwise(places)), np.zeros(len(depth)))
        cells = (_confusion_px(now.camera, depth) / step) ** 2
        needed = max(needed, float(np.quantile(np.nan_to_num(way / step + cells)[is_seen], _SHARE)))
    return min(math.ceil(needed), _MOST_SAMPLES)


def _place_at(item: Particles, moment: Moment) -> np.ndarray:
    """Pixels (n, 2) of particles at a moment by their velocities; nan behind the camera."""
    positions = item.positions.astype(np.float64)
    if item.velocities is not None:
        positions = positions + moment.time * item.velocities
    return moment.camera.project(positions)[0]


def _matched(*lists: list[Item]) -> Iterator[tuple[tuple[str, int], tuple[Item, ...]]]:
    """What has the same name in all lists, of several of a name in their order."""
    tables = []
    for items in lists:
        numbers: dict[str, itertools.count] = {}
        tables.append({(item.name, next(numbers.setdefault(item.name, itertools.count()))): item for item in items})
    for key, item in tables[0].items():
        if all(key in table for table in tables):
            yield key, tuple(table[key] for table in tables)


def _solids_px(now: Moment, shutter: Sequence[Moment]) -> Iterator[float]:
    """For each solid that the camera sees, how far its vertices in view go at most, the circle of confusion included."""
    for _, items in _matched(*(moment.scene.meshes for moment in (now, *shutter))):
        if not items[0].visible_to_camera or len({len(item.vertices) for item in items}) > 1:
            continue
        step = len(items[0].vertices) // _MOST_VERTICES + 1
        places, depth = zip(
            *(
                moment.camera.project(item.vertices[::step] @ item.matrix[:3, :3].T + item.matrix[:3, 3])
                for moment, item in zip((now, *shutter), items)
            )
        )
        way = sum(np.hypot(*(after - before).T) for before, after in itertools.pairwise(places[1:]))
        size = np.array((now.camera.width, now.camera.height))
        # Beyond the frame by half of it at most: the edges between vertices there may be in view.
        is_seen = (np.abs(np.stack(places) / size - 0.5) < 1.0).all(-1).any(0) & (depth[0] > now.camera.clip[0])
        blurred = np.where(is_seen, way + _confusion_px(now.camera, depth[0]), 0.0)
        yield float(np.nanmax(blurred, initial=0.0))


def _same(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray | slice, np.ndarray | slice]:
    """Where ids are that both have."""
    if np.array_equal(a, b):
        return slice(None), slice(None)
    return np.intersect1d(a, b, return_indices=True)[1:]


def _confusion_px(camera: core.Camera, depth: np.ndarray) -> np.ndarray:
    """Diameter of the circle of confusion at depths (n,), pixels."""
    pixel = (camera.window[1] - camera.window[0]) / camera.width
    scale = np.abs(depth) if camera.type == "PERSPECTIVE" else 1.0
    off = np.abs(depth - camera.aperture.focus) / camera.aperture.focus
    with np.errstate(divide="ignore", invalid="ignore"):
        return 2.0 * camera.aperture.radius * off / scale / pixel


def _bends(now: Moment, shutter: Sequence[Moment]) -> int:
    """How many samples particles need whose way isn't what their velocities say: being off falls with their square."""
    needed = 1
    for other in shutter:
        for _, (middle, moved) in _matched(now.scene.particles, other.scene.particles):
            if not middle.visible_to_camera:
                continue
            of_middle, of_moved = _same(middle.ids, moved.ids)
            expected = middle.positions[of_middle].astype(np.float64)
            if middle.velocities is not None:
                expected += other.time * middle.velocities[of_middle]
            found = moved.positions[of_moved]
            (px, depth), (expected_px, _) = other.camera.project(found), other.camera.project(expected)
            size = np.array((now.camera.width, now.camera.height))
            is_seen = ((px > 0) & (px < size)).all(-1) & (depth > other.camera.clip[0])
            radius = np.maximum(middle.radii[of_middle], 1e-9)
            off = np.linalg.norm(found - expected, axis=-1) / (_OFF_RADIUS * radius)
            off = np.minimum(off, np.hypot(*(px - expected_px).T) / _OFF_PX)
            off = np.where(np.isnan(off), 0.0, off)[is_seen]
            if len(off):
                needed = max(needed, math.ceil(math.sqrt(np.quantile(off, _SHARE))))
    return needed
