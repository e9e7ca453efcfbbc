# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors of the mean transmittance to an even sky by the number of directions: the table of docs/ACCURACY.md."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "blender_addon"))

from fumarole import core  # noqa: E402

SMOKE = ((200, 10.0), (5_000, 10.0), (20_000, 20.0))  # particles, optical depth across the ball
SAMPLES = (5, 11, 16, 21, 43)  # Light Samples; three times as many directions
TRUTH = 341


def ball(count: int, depth: float) -> core.Scene:
    """Random particles in a ball of radius 1 (n sigma^3 = 0.5) under an even sky."""
    random = np.random.default_rng(1)
    ways = random.normal(size=(count, 3))
    position = ways * (random.random((count, 1)) ** (1 / 3) / np.linalg.norm(ways, axis=1, keepdims=True))
    scene = core.Scene()
    sigma = (0.5 * 4 / 3 * math.pi / count) ** (1 / 3)
    scene.add_particles(position, radius=2 * sigma, density=depth / (2 * math.pi) ** 1.5)
    scene.add_world(1.0)
    return scene


def points() -> np.ndarray:
    """300 in the outer half of the ball."""
    random = np.random.default_rng(2)
    ways = random.normal(size=(300, 3))
    return ways * (random.uniform(0.5, 1.0, (300, 1)) ** (1 / 3) / np.linalg.norm(ways, axis=1, keepdims=True))


def main() -> None:
    scenes = [ball(*smoke) for smoke in SMOKE]
    found = {}
    for samples in (*SAMPLES, TRUTH):
        settings = core.Settings(light_samples=samples)
        found[samples] = [core.transmittance(scene, points(), settings=settings) for scene in scenes]
    print("| directions | " + " | ".join(f"{count:,} particles, depth {depth:g}" for count, depth in SMOKE) + " |")
    print("| --- " * (1 + len(SMOKE)) + "|")
    for samples in SAMPLES:
        errors = [np.sqrt(((a - b) ** 2).mean() / (b**2).mean()) for a, b in zip(found[samples], found[TRUTH])]
        print(f"| {3 * samples} | " + " | ".join(f"{100 * error:.2g} %" for error in errors) + " |")


main()
