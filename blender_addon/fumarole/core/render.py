# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering passes, and asking for the light at single points."""

from __future__ import annotations

import ctypes
import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _abi, _arrays
from ._library import library
from .camera import Camera
from .deep import Deep
from .errors import argument_error, text_of
from .passes import Pass, passes as pass_table
from .scene import Scene
from .settings import SOLVERS, Settings

Pixels = NDArray[np.float32]

Wanted = str | tuple[str, int]
"""A pass by its name; with a number, where there is one for every light or for every two ranks of Cryptomatte."""


@dataclasses.dataclass(frozen=True)
class Stats:
    """What a render did. Times in seconds."""

    light_count: int
    light_sample_count: int
    """sample points over all lights"""
    solver: str
    """the one that ran"""
    particle_count: int
    """in the scene"""
    drawn_count: int
    """in front of the camera and within its frame"""
    triangle_count: int
    memory_bytes: int
    """largest amount the scene and the render held at once, drawing device not counted"""
    build_s: float
    """octree and mesh hierarchy; 0 when kept from an earlier call"""
    light_s: float
    sort_s: float
    draw_s: float
    passes_s: float
    """passes other than Combined"""
    total_s: float
    device: str
    """name of what drew, "" when nothing was"""
    light_points: int
    """points at which light was found: particles, or samples between which it is interpolated"""
    slab_count: int
    """slabs that the smoke in view was cut into; 0 with GL"""
    refinement_count: int
    """times that light was found anew in smaller steps, because it missed the tolerance"""
    accuracy_count: int
    """points in the smoke at which light was found again, exactly, and compared; 0: none"""
    accuracy_rms: float
    """errors there of the transmittance through smoke to a light, 0..1: root mean square..."""
    accuracy_p95: float
    """...95 of 100 are smaller than this..."""
    accuracy_worst: float
    """...largest..."""
    accuracy_bias: float
    """...mean; above 0: too bright"""
    meter_s: float
    """what finding them took; not in light_s"""

    @classmethod
    def from_struct(cls, struct: _abi.fum_render_stats) -> Stats:
        values = {field.name: getattr(struct, field.name) for field in dataclasses.fields(cls)}
        values["solver"] = next(name for name, value in SOLVERS.items() if value == struct.solver)
        values["device"] = text_of(struct.device)
        return cls(**values)


class Result(Mapping[Wanted, Pixels]):
    """The rendered passes as they were asked for: result["Combined"], result["Light", 0] are float32 (height, width,
    channels), first row at the bottom.

    stats: a Stats. warnings: those of the scene's context until the end of this render. deep: a Deep, if it was asked
    for. samples: how many renders it is the mean of.
    """

    def __init__(
        self,
        pixels: dict[Wanted, Pixels],
        stats: Stats,
        warnings: list[str],
        deep: Deep | None = None,
        samples: int = 1,
    ) -> None:
        self._pixels = pixels
        self.deep = deep
        self.samples = samples
        self.stats = stats
        self.warnings = warnings

    def __getitem__(self, name: Wanted) -> Pixels:
        return self._pixels[name]

    def __iter__(self) -> Iterator[Wanted]:
        return iter(self._pixels)

    def __len__(self) -> int:
        return len(self._pixels)


def render(
    scene: Scene,
    camera: Camera,
    settings: Settings | None = None,
    passes: Sequence[Wanted] = ("Combined", "Depth"),
    deep: bool = False,
) -> Result:
    """Lights and draws `scene` for `camera`. Only the passes asked for are computed; core.PASSES lists them. Those that
    are one of several are asked for with its number: ("Light", 2).

    Combined is premultiplied RGBA radiance. Depth is the distance along the camera's axis at which the transmittance
    passes one half, else that of the solid there, else the clip end.
    deep: the smoke in depth as well, for result.deep.write(path). Its samples are as long as the tolerance allows.
    Raises FumaroleError, Cancelled, and whatever the progress callback raised.
    """
    wanted = [(name, *_find_pass(name)) for name in dict.fromkeys(passes)]
    view = camera.struct()
    if not (0 < camera.width <= 65536 and 0 < camera.height <= 65536):
        raise argument_error(f"camera: the picture is {camera.width} x {camera.height} pixels, expected 1..65536")
    pixels = {
        name: np.empty((camera.height, camera.width, len(item.channels)), np.float32) for name, item, _ in wanted
    }
    buffers = (_abi.fum_pass_buffer * max(1, len(wanted)))()
    for buffer, (name, item, number) in zip(buffers, wanted):
        setattr(buffer, "pass", item.number)
        buffer.number = number
        buffer.pixels = _arrays.pointer(pixels[name])
        buffer.pixels_size = pixels[name].size
    stats = _abi.fum_render_stats()
    library().fum_render_stats_init(ctypes.byref(stats))
    handle = ctypes.POINTER(_abi.fum_deep)()
    scene.context.call(
        "fum_render_deep",
        scene.handle,
        ctypes.byref(view),
        _settings(settings),
        len(wanted),
        buffers,
        ctypes.byref(handle) if deep else None,
        ctypes.byref(stats),
    )
    samples = Deep(handle, camera.height, camera.width, scene.context) if deep else None
    return Result(pixels, Stats.from_struct(stats), scene.context.warnings, samples)


@dataclasses.dataclass(frozen=True)
class Blur:
    """How well one picture shows the blur of a camera's shutter and aperture."""

    error: float
    """of its opacity, relative to that (root mean squares)"""
    samples: int
    """pictures, 1..64, with a part of the shutter and of the aperture each, whose mean is within the tolerance"""


def measure_blur(scene: Scene, camera: Camera, settings: Settings | None = None) -> Blur:
    """What comes of drawing each particle with the mean of its optical depth on its way and over the aperture.

    Solids stand still. Raises FumaroleError, Cancelled, and whatever the progress callback raised.
    """
    view, error, samples = camera.struct(), ctypes.c_double(), ctypes.c_int32()
    scene.context.call(
        "fum_blur_measure",
        scene.handle,
        ctypes.byref(view),
        _settings(settings),
        ctypes.byref(error),
        ctypes.byref(samples),
    )
    return Blur(error.value, samples.value)


def transmittance(
    scene: Scene, points: ArrayLike, light: int = 0, settings: Settings | None = None
) -> NDArray[np.float32]:
    """Share of light number `light` that reaches `points` (n, 3) through smoke and past solids: (n,), 0..1.

    A soft light's sample points are averaged. Raises FumaroleError.
    """
    positions = _arrays.rows(points, 3, "points")
    shares = np.empty(len(positions), np.float32)
    scene.context.call(
        "fum_scene_transmittance",
        scene.handle,
        _settings(settings),
        _arrays.whole(light, "light"),
        len(positions),
        _arrays.pointer(positions),
        _arrays.pointer(shares),
    )
    return shares


def irradiance(
    scene: Scene,
    points: ArrayLike,
    light: int = 0,
    normals: ArrayLike | None = None,
    settings: Settings | None = None,
) -> NDArray[np.float32]:
    """Light of number `light` that arrives at `points` (n, 3) through smoke and past solids: (n, 3) RGB, W/m^2.

    normals: (n, 3) or (3,), of length 1: the irradiance of a surface. None: without the cosine, what a small puff of
    smoke receives. Raises FumaroleError.
    """
    positions = _arrays.rows(points, 3, "points")
    directions = None
    if normals is not None:
        directions = _arrays.floats(normals, "normals")
        if directions.shape == (3,):
            directions = np.tile(directions, (len(positions), 1))
        directions = _arrays.rows(directions, 3, "normals", len(positions))
    colors = np.empty((len(positions), 3), np.float32)
    scene.context.call(
        "fum_scene_irradiance",
        scene.handle,
        _settings(settings),
        _arrays.whole(light, "light"),
        len(positions),
        _arrays.pointer(positions),
        None if directions is None else _arrays.pointer(directions),
        _arrays.pointer(colors),
    )
    return colors


def _settings(settings: Settings | None) -> Any:
    """Pointer to the C settings, or None for the defaults."""
    return None if settings is None else ctypes.byref(settings.struct())


def _find_pass(wanted: Wanted) -> tuple[Pass, int]:
    """The pass and its number, 0 where there is none."""
    name, number = (wanted, None) if isinstance(wanted, str) else wanted
    table = pass_table()
    if name not in table:
        raise argument_error(f"there is no pass {name!r}; passes are {', '.join(table)}")
    if table[name].per != "PICTURE" and number is None:
        raise argument_error(f"there are several passes {name!r}: ask for one as ({name!r}, number)")
    if table[name].per == "PICTURE" and number is not None:
        raise argument_error(f"there is one pass {name!r}: ask for it by its name alone")
    return table[name], 0 if number is None else _arrays.whole(number, "number")
