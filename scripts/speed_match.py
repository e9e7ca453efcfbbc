# SPDX-License-Identifier: GPL-3.0-or-later
"""Smoke for comparing speeds: a plume of Gaussians, and the spheres of Points to Volume that come closest to it.

Points to Volume makes the union of spheres of one density: where spheres overlap nothing is added, and at the rim the
density falls to zero within a voxel. A sum of Gaussians is matched in its total; the rest is what is left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

HEIGHT, LOW, HIGH = 3.0, 0.15, 0.9  # of the plume and its radii, m
CHUNK = 256  # places that are measured at once


@dataclass(frozen=True)
class Smoke:
    """Particles of one size. sigma: m; density: extinction at a particle's centre, 1/m."""

    positions: NDArray[np.float64]
    sigma: float
    density: float


@dataclass(frozen=True)
class Spheres:
    """What Points to Volume is asked for. left: RMS of the difference of densities over the RMS of the Gaussians'."""

    radius: float
    voxel: float
    density: float
    left: float


def plume(count: int, depth: float = 8.0, overlap: float = 2.0) -> Smoke:
    """The benchmark's plume with other random numbers. depth: optical, half way up; overlap: n sigma^3."""
    random = np.random.default_rng(1)
    low, high = LOW**3, HIGH**3
    z = (np.cbrt(low + random.random(count) * (high - low)) - LOW) * HEIGHT / (HIGH - LOW)
    angle = 2.0 * math.pi * random.random(count)
    r = (LOW + (HIGH - LOW) * z / HEIGHT) * np.sqrt(random.random(count))
    p = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    wavelength, amplitude = 1.3, 0.16
    for octave in range(5):
        k, turn = 2.0 * math.pi / wavelength, 1.7 * octave
        p[:, 0] += amplitude * np.sin(k * p[:, 2] + turn) * np.cos(0.8 * k * p[:, 1] + 2.0 * turn)
        p[:, 1] += amplitude * np.sin(k * p[:, 0] + 0.5 + turn) * np.cos(0.7 * k * p[:, 2] + turn)
        p[:, 2] += 0.7 * amplitude * np.sin(k * p[:, 1] + 1.1 + turn) * np.cos(0.9 * k * p[:, 0] + 3.0 * turn)
        wavelength, amplitude = 0.5 * wavelength, 0.55 * amplitude
    volume = math.pi * HEIGHT / 3.0 * (high - low) / (HIGH - LOW)
    sigma = float(np.cbrt(overlap * volume / count))
    return Smoke(p, sigma, depth / (LOW + HIGH) / (overlap * (2.0 * math.pi) ** 1.5))


def measure(smoke: Smoke, places: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Extinction of the Gaussians at places (n, 3), and how far the nearest particle is."""
    densities, nearest = np.empty(len(places)), np.empty(len(places))
    for start in range(0, len(places), CHUNK):
        part = places[start : start + CHUNK]
        squares = np.square(part[:, None] - smoke.positions).sum(axis=2)
        densities[start : start + CHUNK] = smoke.density * np.exp(squares / (-2.0 * smoke.sigma**2)).sum(axis=1)
        nearest[start : start + CHUNK] = np.sqrt(squares.min(axis=1))
    return densities, nearest


def fit(smoke: Smoke, samples: int = 3000) -> Spheres:
    """The spheres with the smoke's total that differ least from it at random places of its box."""
    random = np.random.default_rng(2)
    margin = 3.0 * smoke.sigma
    low, high = smoke.positions.min(axis=0) - margin, smoke.positions.max(axis=0) + margin
    densities, nearest = measure(smoke, low + random.random((samples, 3)) * (high - low))
    best = Spheres(0.0, 0.0, 0.0, math.inf)
    for voxel in smoke.sigma * np.array([0.25, 0.5, 1.0]):
        for radius in smoke.sigma * np.arange(0.6, 3.0, 0.05):
            shape = np.clip((radius - nearest) / voxel, 0.0, 1.0)
            density = densities.sum() / max(shape.sum(), 1e-9)
            left = float(np.sqrt(np.square(density * shape - densities).sum() / np.square(densities).sum()))
            if left < best.left:
                best = Spheres(float(radius), float(voxel), float(density), left)
    return best
