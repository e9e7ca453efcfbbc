# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion blur and depth of field by samples: the mean of renders of parts of the shutter, each through a part of the
aperture."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Hashable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from .camera import Aperture, Camera
from .errors import argument_error
from .render import Pixels, Result, Stats, Wanted, measure_blur, render
from .scene import Scene
from .settings import Settings

MOST_SAMPLES = 256

# Passes of which a mean says nothing: they are those of the picture's own time, without blur.
_STEADY = {"Depth", "Depth Front", "Depth Back", "Position", "Vector"}

# Pixels a side of the pictures that tell whether smears are lit well.
_SMALL = 64

# Samples where smears are not, and nothing says how far things move.
_SHARP_SAMPLES = 32

_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


@dataclasses.dataclass(frozen=True)
class BlurSample:
    """A render to be averaged: number `index` of `count`, `time` frames from the picture's own.

    1 of 1 is all of the shutter, as far as it is within a frame from now, and of the aperture, which the library draws
    in one pass. count 0: no blur. is_sharp: of several, the instant and the point of the lens alone, without smears.
    """

    time: float = 0.0
    index: int = 0
    count: int = 1
    is_sharp: bool = False

    def camera(self, camera: Camera) -> Camera:
        """Of the camera at `time`, which has the picture's shutter and aperture, the sample's share of both."""
        if self.count == 0:
            return camera.blurred()
        if self.count == 1:
            open, close = (min(max(time, -1.0), 1.0) for time in camera.shutter)
            return camera.blurred((open, close), camera.aperture)
        half = (camera.shutter[1] - camera.shutter[0]) / (2 * self.count)
        aperture = camera.aperture
        if aperture.radius == 0.0:
            return camera.blurred() if self.is_sharp else camera.blurred((-half, half), aperture)
        offset = aperture_cells(aperture, self.count)[self.index]
        if self.is_sharp:
            # Points must spread as far as cells do with what each spreads by itself.
            return _through(camera, offset / math.sqrt(1.0 - 1.0 / self.count), aperture.focus).blurred()
        radius = 2.0 * math.sqrt(_spread(aperture.blades) / self.count) * aperture.radius
        cell = Aperture(radius, aperture.focus, ratio=aperture.ratio)
        return _through(camera, offset, aperture.focus).blurred((-half, half), cell)


def blur_samples(shutter: tuple[float, float], count: int, are_sharp: bool = False) -> list[BlurSample]:
    """`count` samples, each in the middle of its part of the shutter; shutter in frames from now."""
    step = (shutter[1] - shutter[0]) / count
    return [BlurSample(shutter[0] + step * (index + 0.5), index, count, are_sharp) for index in range(count)]


def aperture_cells(aperture: Aperture, count: int) -> NDArray[np.float64]:
    """Middles of cells of equal area that make up the aperture, (count, 2), m, in the camera's x and y.

    Sunflower seeds, bent to a polygon where there are blades. Their mean is the middle of the aperture and, from three
    cells on, their spread is the aperture's less that of a cell. Where they lie has as little to do with when they come
    as there is an order for; it is the same in every picture.
    """
    radius, turns = _seeds(count)
    points = _in_polygon(radius, turns, aperture.blades) if aperture.blades else _polar(radius, turns)
    points -= points.mean(0)
    wanted = _spread(aperture.blades) * (1.0 - 1.0 / count)
    if count >= 3:
        # The linear change nearest to none that makes the spread even in all directions.
        values, vectors = np.linalg.eigh(points.T @ points / count)
        points = points @ (vectors * np.sqrt(wanted / values)) @ vectors.T
    elif count == 2:
        points *= math.sqrt(2.0 * wanted / (points**2).sum(1).mean())
    cosine, sine = math.cos(aperture.rotation), math.sin(aperture.rotation)
    points = aperture.radius * points @ np.array(((cosine, sine), (-sine, cosine)))
    points[:, 0] /= aperture.ratio
    return points[_order(count)]


def _seeds(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sunflower seeds in the unit disc: distance from its middle and turns about it (Vogel 1979). They lie closer
    together than the middles of `count` cells would by what each cell spreads itself."""
    seeds = np.arange(count)
    return np.sqrt((seeds + 0.5) / count * (1.0 - 1.0 / count)), seeds * _GOLDEN


@functools.cache
def _order(count: int) -> NDArray[np.int64]:
    """Which seed comes when: the step through them that leaves least correlation of place and time."""
    time = np.arange(count) - (count - 1) / 2
    radius, turns = _seeds(count)
    points = _polar(radius, turns)
    values = np.column_stack((points, radius**2))
    values = (values - values.mean(0)) / np.maximum(values.std(0), 1e-9)
    steps = [step for step in range(1, count) if math.gcd(step, count) == 1] or [1]
    starts = range(count if count <= 32 else 1)
    orders = np.array([(start + step * np.arange(count)) % count for step in steps for start in starts])
    left = (np.einsum("oik,i->ok", values[orders], time) ** 2).sum(1)
    return orders[left.argmin()]


def _polar(radius: NDArray[np.float64], turns: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack((radius * np.cos(2.0 * np.pi * turns), radius * np.sin(2.0 * np.pi * turns)), -1)


def _in_polygon(radius: NDArray[np.float64], turns: NDArray[np.float64], blades: int) -> NDArray[np.float64]:
    """Points of the unit disc, moved to a regular polygon with its first corner along x; equal areas stay equal."""
    sector, along = np.divmod(turns % 1.0 * blades, 1.0)
    half = np.pi / blades
    x, y = radius * math.cos(half), radius * (2.0 * along - 1.0) * math.sin(half)
    angle = (2.0 * sector + 1.0) * half
    return np.stack((x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)), -1)


def _spread(blades: int) -> float:
    """Variance along each axis of an aperture whose corners, or edge, are 1 from its middle."""
    return 0.25 if blades == 0 else (2.0 + math.cos(2.0 * math.pi / blades)) / 12.0


def _through(camera: Camera, offset: NDArray[np.float64], focus: float) -> Camera:
    """The camera as seen through a point of its lens, (2,), m: what is at `focus` stays where it was in the picture.

    An orthographic camera is turned, since it can't be sheared: what is beside its middle is off by a quarter of the
    squared slope at most.
    """
    left, right, bottom, top = camera.window
    matrix = camera.matrix.copy()
    matrix[:3, :3] /= np.linalg.norm(matrix[:3, :3], axis=0)
    x, y = offset / focus
    if camera.type == "PERSPECTIVE":
        window = (left - x, right - x, bottom - y, top - y)
    else:
        forward = np.array((-x, -y, 1.0)) / math.sqrt(1.0 + x * x + y * y)
        a, b, c = forward
        # The shortest turn that takes (0, 0, -1) to the new direction, in the camera's axes.
        turn = np.array(
            (
                (1.0 - a * a / (1.0 + c), -a * b / (1.0 + c), -a),
                (-a * b / (1.0 + c), 1.0 - b * b / (1.0 + c), -b),
                (a, b, c),
            )
        )
        matrix[:3, :3] = matrix[:3, :3] @ turn
        window = (left * turn[0, 0], right * turn[0, 0], bottom * turn[1, 1], top * turn[1, 1])
    matrix[:3, 3] += camera.matrix[:3, :2] @ offset / np.linalg.norm(camera.matrix[:3, 0])
    moved = Camera.from_window(matrix, window, camera.width, camera.height, camera.type, camera.clip)
    if camera.motion is None:
        return moved
    return moved.moving(*(_through(other, offset, focus) for other in camera.motion))


Draw = Callable[[BlurSample, Sequence[Hashable]], Result]
"""Renders a sample: the passes of those keys."""


def average(
    draw: Draw, passes: Mapping[Hashable, str], shutter: tuple[float, float], count: int, are_sharp: bool = False
) -> Result:
    """The mean of blur samples, sharp ones or such as join; result.samples says of how many.

    passes: the name in core.PASSES of each key. shutter: frames from now. count: 1..256; 1 is one pass. A shutter that
    reaches beyond a frame from now takes at least as many as make its parts short enough.

    Depth, Position and Vector are those of the picture's own time, without blur unless there is one pass. Cryptomatte's
    coverages are averaged for each object, and ranked anew.
    """
    if not 1 <= count <= MOST_SAMPLES:
        raise argument_error(f"blur: {count} samples, expected 1..{MOST_SAMPLES}")
    if not (math.isfinite(shutter[0]) and math.isfinite(shutter[1]) and shutter[0] <= shutter[1]):
        raise argument_error(f"blur: a shutter from {shutter[0]:g} to {shutter[1]:g} frames")
    if max(-shutter[0], shutter[1]) > 1.0:
        count = max(count, 2, math.ceil((shutter[1] - shutter[0]) / 2.0))
    if count > MOST_SAMPLES:
        raise argument_error(
            f"blur: a shutter from {shutter[0]:g} to {shutter[1]:g} frames takes {count} samples, more than {MOST_SAMPLES}"
        )
    if count == 1:
        return draw(BlurSample(), list(passes))
    steady = [key for key, name in passes.items() if name in _STEADY]
    first = draw(BlurSample(count=0), steady) if steady else None
    blurred = [key for key, name in passes.items() if name not in _STEADY]
    mean = _Mean(passes)
    for sample in blur_samples(shutter, count, are_sharp):
        mean.add(draw(sample, blurred))
    return mean.result(first)


def needed_samples(scene: Scene, camera: Camera, settings: Settings | None = None) -> int:
    """How many samples the tolerance asks for, 1..256. The camera knows how it moves."""
    whole = BlurSample().camera(camera)
    samples = measure_blur(scene, whole, settings).samples
    # Of a shutter that is too long for one pass, as many times more.
    length, measured = (close - open for open, close in (camera.shutter, whole.shutter))
    return min(math.ceil(samples * length / measured) if measured > 0.0 else samples, MOST_SAMPLES)


def smears_are_lit(scene: Scene, camera: Camera, settings: Settings | None = None) -> bool:
    """Whether smeared smoke is as bright as sharp smoke within the tolerance. The camera knows how it moves.

    Where it is smeared, each particle is lit at its centre, which makes few or dense ones too dark. Both are drawn
    small; light that reaches the camera is compared with the opacity that it comes from.
    """
    settings = settings or Settings()
    share = min(1.0, _SMALL / max(camera.width, camera.height))
    size = (max(1, round(camera.width * share)), max(1, round(camera.height * share)))
    small = BlurSample().camera(camera).resized(*size)
    plain = dataclasses.replace(settings, solids="HOLDOUT")
    smeared, sharp = (
        render(scene, view, plain, ["Combined"])["Combined"].sum((0, 1), dtype=np.float64)
        for view in (small, small.blurred())
    )
    if not (sharp[3] > 0.0 and smeared[3] > 0.0):
        return True
    off = np.abs(smeared[:3] / smeared[3] - sharp[:3] / sharp[3]).max()
    return bool(off <= settings.tolerance * (sharp[:3] / sharp[3]).max())


def render_blurred(
    at: Callable[[float], tuple[Scene, Camera]],
    settings: Settings | None = None,
    passes: Sequence[Wanted] = ("Combined", "Depth"),
    samples: int = 0,
) -> Result:
    """The mean of renders over the shutter and the aperture of a camera, as average() says.

    at(time): the scene and the camera `time` frames from now, for the next render; camera.blurred(shutter, aperture)
    says what is to be averaged over, the shutter as it is now. What moves moves by what `at` gives, and within each
    sample by the particles' velocities and camera.moving().
    samples: 1..256; 0: as many as the tolerance asks for by those velocities, or 32 sharp ones where smears would be
    lit wrongly.
    """
    found = {0.0: at(0.0)}
    shutter = found[0.0][1].shutter

    def draw(sample: BlurSample, wanted: Sequence[Wanted]) -> Result:
        if sample.time not in found:
            found.clear()
            found[sample.time] = at(sample.time)
        scene, camera = found[sample.time]
        camera = camera.blurred(shutter, camera.aperture)
        return render(scene, sample.camera(camera), settings, wanted)

    names = {wanted: wanted if isinstance(wanted, str) else wanted[0] for wanted in passes}
    are_sharp = samples == 0 and not smears_are_lit(*found[0.0], settings)
    count = samples or (_SHARP_SAMPLES if are_sharp else needed_samples(*found[0.0], settings))
    return average(draw, names, shutter, count, are_sharp)


class _Mean:
    """Adds up renders of the same passes."""

    def __init__(self, passes: Mapping[Hashable, str]) -> None:
        self._keys = list(passes)
        self._ranked = [key for key, name in passes.items() if name == "CryptoObject"]
        self._sums: dict[Hashable, NDArray[np.float64]] = {}
        self._mattes = _Mattes()
        self._stats: list[Stats] = []
        self._warnings: list[str] = []

    def add(self, result: Result) -> None:
        for key in result:
            if key in self._ranked:
                continue
            if key in self._sums:
                self._sums[key] += result[key]
            else:
                self._sums[key] = result[key].astype(np.float64)
        if self._ranked:
            self._mattes.add([result[key] for key in self._ranked])
        self._stats.append(result.stats)
        self._warnings += [text for text in result.warnings if text not in self._warnings]

    def result(self, first: Result | None) -> Result:
        """The means, with what else there is from `first`; its seconds count too."""
        count = len(self._stats)
        pixels = {key: (values / count).astype(np.float32) for key, values in self._sums.items()}
        pixels.update(zip(self._ranked, self._mattes.ranked(count)))
        warnings = [*first.warnings] if first is not None else []
        warnings += [text for text in self._warnings if text not in warnings]
        if first is not None:
            pixels = {**dict(first), **pixels}
        stats = _joined(self._stats, first.stats if first is not None else None)
        return Result({key: pixels[key] for key in self._keys}, stats, warnings, samples=count)


class _Mattes:
    """Sums Cryptomatte's coverages by pixel and object."""

    def __init__(self) -> None:
        self._shape = (0, 0, 0)
        # Pixel and id of each sum, ascending: pixel << 32 | id.
        self._places = np.empty(0, np.uint64)
        self._sums = np.empty(0, np.float64)

    def add(self, passes: Sequence[Pixels]) -> None:
        """Passes (height, width, 4) of two ranks each, (id, coverage, id, coverage)."""
        height, width, _ = passes[0].shape
        self._shape = (height, width, 2 * len(passes))
        ranks = np.ascontiguousarray(np.concatenate(passes, -1)).reshape(height * width, -1, 2)
        coverage = ranks[..., 1]
        pixel, rank = np.nonzero(coverage > 0)
        ids = ranks[..., 0].view(np.uint32)[pixel, rank]
        places = pixel.astype(np.uint64) << np.uint64(32) | ids
        all_sums = np.concatenate((self._sums, coverage[pixel, rank]))
        self._places, where = np.unique(np.concatenate((self._places, places)), return_inverse=True)
        self._sums = np.bincount(where, all_sums, len(self._places))

    def ranked(self, count: int) -> list[Pixels]:
        """The same passes of the means over `count` renders."""
        height, width, ranks = self._shape
        pixel, ids = (self._places >> np.uint64(32)).astype(np.int64), self._places.astype(np.uint32)
        order = np.lexsort((ids, -self._sums, pixel))
        pixel, ids, sums = pixel[order], ids[order], self._sums[order]
        rank = np.arange(len(pixel)) - np.searchsorted(pixel, pixel)
        kept = rank < ranks
        result = np.zeros((height * width, ranks, 2), np.float32)
        result.view(np.uint32)[pixel[kept], rank[kept], 0] = ids[kept]
        result[pixel[kept], rank[kept], 1] = sums[kept] / count
        pairs = result.reshape(height, width, ranks // 2, 4)
        return [np.ascontiguousarray(pairs[:, :, pair]) for pair in range(ranks // 2)]


def _joined(parts: list[Stats], first: Stats | None) -> Stats:
    """What several renders did: times and points are added, accuracy is that of the worst, the rest of the last."""
    every = parts if first is None else [first, *parts]
    worst = max(every, key=lambda stats: (stats.accuracy_count > 0, stats.accuracy_rms))
    sums = [field.name for field in dataclasses.fields(Stats) if field.name.endswith("_s")]
    sums += ["light_points", "slab_count", "refinement_count"]
    values = {name: sum(getattr(stats, name) for stats in every) for name in sums}
    accuracy = ("accuracy_count", "accuracy_rms", "accuracy_p95", "accuracy_worst", "accuracy_bias")
    values |= {name: getattr(worst, name) for name in accuracy}
    values["memory_bytes"] = max(stats.memory_bytes for stats in every)
    return dataclasses.replace(parts[-1], **values)
