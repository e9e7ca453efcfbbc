# SPDX-License-Identifier: GPL-3.0-or-later
"""The picture of one view: its passes drawn, once or as many times as its blur needs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from . import core
from .passes import LayerPass
from .shots import CoreScenes, Exposure, Timeline

# Share of the progress bar that goes to finding how many blur samples there will be.
_LOOK = 0.1


# Passes that can't be drawn with smears.
_WITHOUT_SMEARS = {"Error", "Solid Shadow", "Light Solid Shadow"}


class Progress:
    """What core calls during long work; part of a larger whole. tell(fraction, text) returns True to cancel."""

    # Where each stage of a render begins and how much of it it is.
    _STAGES = {
        "octree": (0.0, 0.05),
        "lighting": (0.05, 0.7),
        "sorting": (0.75, 0.05),
        "drawing": (0.8, 0.15),
        "passes": (0.95, 0.05),
    }

    def __init__(self, tell: Callable[[float, str], bool]) -> None:
        self._tell = tell
        self._start, self._share, self._label = 0.0, 1.0, ""

    def part(self, start: float, share: float, label: str = "") -> None:
        """What follows is from `start` on a `share` of the whole, and is called `label` if it is one of many."""
        self._start, self._share, self._label = start, share, label

    def hold(self) -> None:
        """What follows counts nothing."""
        self._start, self._share = self._start + self._share, 0.0

    def check(self) -> None:
        """Raises core.Cancelled if the user has cancelled."""
        if self._tell(self._start, self._label):
            raise core.Cancelled("cancelled")

    def __call__(self, stage: str, fraction: float, message: str) -> bool:
        start, share = self._STAGES[stage]
        # In the background each text is a line of its own: ten a stage are enough, and one for each of many parts.
        text = self._label or f"{message}, {int(10 * fraction) * 10} %"
        return self._tell(self._start + self._share * (start + share * fraction), text)


@dataclass
class Picture:
    """What is to be drawn, and how. blur_samples: 0 as many as it takes. is_opaque: the world is put behind it."""

    timeline: Timeline
    core_scenes: CoreScenes
    passes: list[LayerPass]
    settings: core.Settings
    blur_samples: int
    is_opaque: bool
    has_deep: bool
    progress: Progress

    def draw(self) -> tuple[core.Result, Exposure]:
        """The passes by their names in Blender. Raises core.FumaroleError."""
        self._exposure = exposure = self.timeline.exposure()
        if not exposure.is_blurred:
            whole = core.BlurSample()
            return self._draw(whole, [item.name for item in self.passes], self.has_deep), exposure
        self.progress.part(0.0, 0.0)
        names = {item.name: item.item.name for item in self.passes}
        count, are_sharp = self._plan_samples()
        result = core.average(self._draw, names, exposure.shutter, count, are_sharp)
        if self.has_deep:
            result.deep = self._draw(core.BlurSample(count=0), [], True).deep
        return result, exposure

    def _plan_samples(self) -> tuple[int, bool]:
        """How many blur samples, and whether they are sharp."""
        exposure = self._exposure
        if self.blur_samples:
            return self.blur_samples, self.blur_samples >= max(2, exposure.sharp_samples)
        self.progress.part(0.0, _LOOK)
        self.progress.check()
        core_scene, _warnings = self._core_scene(0.0)
        camera = self._camera(core.BlurSample(), False)
        if self._needs_sharp() or not core.smears_are_lit(core_scene, camera, self.settings):
            return max(2, exposure.sharp_samples, exposure.least_samples), True
        return max(core.needed_samples(core_scene, camera, self.settings), exposure.least_samples), False

    def _needs_sharp(self) -> bool:
        """Whether something is to be drawn that smears don't have: maps, and light at each pixel by itself."""
        has_maps = any(item.volume.map is not None for item in self.timeline.scene(0.0).particles)
        return has_maps or any(item.item.name in _WITHOUT_SMEARS for item in self.passes)

    def _core_scene(self, time: float) -> tuple[core.Scene, list[str]]:
        core_scene, warnings = self.core_scenes.of(self.timeline.scene(time))
        core_scene.context.progress = self.progress
        return core_scene, warnings

    def _draw(self, sample: core.BlurSample, names: Sequence[str], has_deep: bool = False) -> core.Result:
        self._begin(sample)
        scene = self.timeline.scene(sample.time)
        core_scene, warnings = self._core_scene(sample.time)
        passes = [item for item in self.passes if item.name in names]
        wanted = [name for item in passes for name in item.wanted(scene.lights)]
        is_over = self.is_opaque and "Combined" in names
        has_holdouts = is_over and scene.has_holdouts
        camera = sample.camera(self._camera(sample, "Vector" in wanted))
        result = core.render(
            core_scene, camera, self.settings, [*wanted, "Holdout"] if has_holdouts else wanted, deep=has_deep
        )
        pixels = {item.name: item.pixels(result, scene.lights) for item in passes}
        if is_over:
            behind = scene.world.seen_by(camera) if scene.world else np.zeros(3)
            _put_over(pixels["Combined"], behind, result["Holdout"] if has_holdouts else None)
        return core.Result(pixels, result.stats, [*warnings, *result.warnings], result.deep)

    def _camera(self, sample: core.BlurSample, has_vector: bool) -> core.Camera:
        """That of the sample's time, with all of the shutter and of its aperture."""
        exposure = self._exposure
        is_moving = has_vector or (exposure.camera_moves and sample.count > 0)
        camera = self.timeline.moving_camera(sample.time) if is_moving else self.timeline.camera(sample.time)
        return camera.blurred(exposure.shutter, camera.aperture)

    def _begin(self, sample: core.BlurSample) -> None:
        """Tells which sample comes. Raises core.Cancelled."""
        if sample.count == 0:
            self.progress.hold()
        else:
            look = _LOOK if self._exposure.is_blurred and self.blur_samples == 0 else 0.0
            share = (1.0 - look) / sample.count
            label = f"Blur sample {sample.index + 1} of {sample.count}" if sample.count > 1 else ""
            self.progress.part(look + share * sample.index, share, label)
        self.progress.check()


def _put_over(combined: np.ndarray, background: np.ndarray, holdout: np.ndarray | None) -> None:
    """Puts premultiplied pixels (height, width, 4) over opaque colours, (3,) or (height, width, 3), in place.

    `holdout` (height, width, 3): share of it that holdouts keep out, and leave transparent, as Cycles does.
    """
    left = 1 - combined[..., 3:] if holdout is None else 1 - combined[..., 3:] - holdout
    combined[..., :3] += np.maximum(left, 0) * background.astype(np.float32)
    combined[..., 3] = 1 if holdout is None else 1 - holdout.mean(-1)
