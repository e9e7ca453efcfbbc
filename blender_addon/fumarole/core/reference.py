# SPDX-License-Identifier: GPL-3.0-or-later
"""The reference: the same picture by brute force in double precision, to judge the fast one by."""

from __future__ import annotations

import ctypes
import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from . import _abi, _arrays
from ._library import library
from .camera import Camera
from .errors import argument_error
from .scene import Scene
from .settings import SOLIDS

PASSES = ("Combined", "Depth")


@dataclasses.dataclass(frozen=True)
class ReferenceStats:
    """What a reference render did."""

    light_sample_count: int
    """sample points over all lights"""
    particle_count: int
    """in the scene"""
    step_count: int
    """points of the pixels' rays at which radiance was found"""
    unconverged_count: int
    """pixels that missed the tolerance"""
    error: float
    """estimated: RMS of the pixels' errors over the RMS of their brightest channels"""
    total_s: float


class ReferenceResult(dict[str, NDArray[np.float64]]):
    """The passes by name: float64 (height, width, channels), first row at the bottom. stats: a ReferenceStats."""

    stats: ReferenceStats


def render_reference(
    scene: Scene,
    camera: Camera,
    tolerance: float | None = None,
    light_samples: int | None = None,
    passes: Sequence[str] = ("Combined",),
    solids: str = "HOLDOUT",
) -> ReferenceResult:
    """What render() aims at: single scattering through untruncated Gaussians, every step of every pixel's ray lit exactly.

    Slow: it is meant for small pictures. It knows no artistic settings.
    tolerance: error allowed in a pixel's RGB, as a share of its brightest channel, 1e-10..0.1; default 1e-4.
    light_samples: sample points of every light that has a size, 1..65536, rounded up to a square; default 256.
    passes: "Combined", and "Depth" where wanted, as those of render().
    solids: "HOLDOUT" or "SHADED", as in Settings.
    Raises FumaroleError, Cancelled, and whatever the progress callback raised.
    """
    for name in passes:
        if name not in PASSES:
            raise argument_error(f"the reference has no pass {name!r}; it has {', '.join(PASSES)}")
    settings, stats = _abi.fum_reference_settings(), _abi.fum_reference_stats()
    library().fum_reference_settings_init(ctypes.byref(settings))
    library().fum_reference_stats_init(ctypes.byref(stats))
    if tolerance is not None:
        settings.tolerance = _arrays.number(tolerance, "tolerance")
    if light_samples is not None:
        settings.light_samples = _arrays.whole(light_samples, "light_samples")
    if solids not in SOLIDS:
        raise argument_error(f"solids is {solids!r}, expected one of {', '.join(SOLIDS)}")
    settings.solids = SOLIDS[solids]
    view = camera.struct()
    if not (0 < camera.width <= 65536 and 0 < camera.height <= 65536):
        raise argument_error(f"camera: the picture is {camera.width} x {camera.height} pixels, expected 1..65536")
    combined = np.empty((camera.height, camera.width, 4))
    depth = np.empty((camera.height, camera.width, 1)) if "Depth" in passes else None
    scene.context.call(
        "fum_reference_render",
        scene.handle,
        ctypes.byref(view),
        ctypes.byref(settings),
        _arrays.pointer(combined),
        combined.size,
        None if depth is None else _arrays.pointer(depth),
        0 if depth is None else depth.size,
        ctypes.byref(stats),
    )
    pixels = {"Combined": combined, "Depth": depth}
    result = ReferenceResult((name, pixels[name]) for name in dict.fromkeys(passes))
    result.stats = ReferenceStats(**{field.name: getattr(stats, field.name) for field in dataclasses.fields(ReferenceStats)})
    return result
