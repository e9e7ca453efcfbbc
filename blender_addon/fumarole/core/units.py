# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's light units as Cycles understands them, converted to the library's physical ones.

Checked against Cycles of Blender 3.4, 4.2, 4.5 and 5.0. The rules of 3.4 are used before 4.0, those of 4.2 from there.
`cycles` is that Blender's version, e.g. (4, 5). All results are RGB triples, like `power`, which is Blender's power
times its colour.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Rgb = NDArray[np.float64]
Version = tuple[int, ...]


def is_old(cycles: Version) -> bool:
    """True where the rules of Blender 3.4 hold."""
    return tuple(cycles) < (4, 0)


def point_intensity(power: Rgb, radius: float = 0.0, normalize: bool = True) -> Rgb:
    """Radiant intensity (W/sr) of a point or spot light of `power` (W).

    Without `normalize` the light's disc of `radius` (m) has the radiance power / pi; one of radius 0 counts as 1 m^2.
    """
    if normalize:
        return power / (4.0 * math.pi)
    return power * (radius**2 if radius > 0.0 else 1.0 / math.pi)


def sun_irradiance(power: Rgb, angle: float = 0.0, normalize: bool = True, cycles: Version = (5, 0)) -> Rgb:
    """Irradiance (W/m^2) on a plane facing a sun of strength `power` and full `angle` (radians, 0..pi).

    Without `normalize` the strength is the radiance of the sun's disc, unless its angle is 0.
    """
    half = 0.5 * angle
    if not normalize and angle > 0.0:
        return power * math.pi * math.sin(half) ** 2
    if is_old(cycles):
        # 2 (sec(h) - 1) / tan(h)^2, without the division of zero by zero
        return power * math.cos(half) / math.cos(0.5 * half) ** 2
    return power


def area_radiance(power: Rgb, area: float, normalize: bool = True, cycles: Version = (5, 0)) -> Rgb:
    """Radiance (W/(m^2 sr)) of an area light of `power` (W) and `area` (m^2, above 0, scale included)."""
    if not normalize:
        return power / math.pi
    if is_old(cycles):
        return power / (4.0 * area)
    return power / (math.pi * area)


def spot_has_cosine(cycles: Version) -> bool:
    """True where a spot light also falls off with the cosine to its axis."""
    return is_old(cycles)


def spot_uses_scale(cycles: Version) -> bool:
    """True where the scale of a spot light's object shapes its cone."""
    return not is_old(cycles)
