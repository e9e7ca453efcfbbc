# SPDX-License-Identifier: GPL-3.0-or-later
"""Particles that pictures are drawn of, and scenes of them."""

from __future__ import annotations

import numpy as np

from fumarole import core

FRONT = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 8.0], [0, 0, 0, 1]])
SIDE = {"type": "POINT", "matrix": [[1, 0, 0, 4], [0, 1, 0, 3], [0, 0, 1, 3], [0, 0, 0, 1]], "power": 1000.0}
WALL = ([[-5, -5, 0.1], [-0.4, -5, -0.5], [-0.3, 5, 0.6], [-5, 5, 0.0]], [[0, 1, 2], [0, 2, 3]])


def smoke(position: np.ndarray, radius: np.ndarray | float, depth: float, **look) -> dict:
    """Particles, each `depth` thick through its centre."""
    radius = np.broadcast_to(np.asarray(radius, np.float32), len(position))
    density = depth / (radius / 2 * np.sqrt(2 * np.pi))
    return {"position": np.asarray(position, np.float32), "radius": radius, "density": density} | look


def cloud(count: int, radius: float, depth: float, seed: int = 3, **look) -> dict:
    """Particles in a ball of radius 1, each `depth` thick through its centre."""
    rng = np.random.default_rng(seed)
    position = rng.normal(size=(count, 3))
    position *= rng.uniform(size=(count, 1)) ** (1 / 3) / np.linalg.norm(position, axis=1, keepdims=True)
    return smoke(position, radius, depth, **look)


def plume(count: int, growth: float, depth: float) -> dict:
    """It widens upwards, and its particles grow by `growth` to the top."""
    rng = np.random.default_rng(5)
    age = rng.uniform(size=count)
    across = (0.08 + 0.25 * age)[:, None] * rng.normal(size=(count, 2))
    position = np.stack([across[:, 0] + 0.2 * np.sin(6 * age), 3 * age - 1.5, across[:, 1]], 1)
    return smoke(position, 0.08 + growth * age, depth)


def lit(particles: dict, lights: tuple = (), wall: tuple = (), threads: int = 0) -> core.Scene:
    """The particles in a scene of their own. wall: vertices and triangles of a mesh."""
    scene = core.Scene(core.Context(threads=threads))
    scene.add_particles(**particles)
    for light in lights:
        scene.add_light(**light)
    if wall:
        scene.add_mesh(*wall)
    return scene
