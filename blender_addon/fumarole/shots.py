# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene that is rendered at times around its frame, and the core scenes made of it."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from types import TracebackType

import bpy
import numpy as np

from . import core
from .export.camera import export_camera
from .export.motion import Chords, Moment, camera_moves, chords, fill_velocities, is_still, least_samples, sharp_samples
from .export.scene import Scene, build, export_scene
from .kept import Keeper


@dataclass
class Exposure:
    """What is blurred in a picture.

    shutter: as of core.Camera, (0, 0) also if nothing moves meanwhile. least_samples: that it takes to show what can't
    be blurred in one pass. sharp_samples: that it takes to show smoke without smears.
    """

    shutter: tuple[float, float]
    has_aperture: bool
    camera_moves: bool = False
    least_samples: int = 1
    sharp_samples: int = 1

    @property
    def has_shutter(self) -> bool:
        return self.shutter != (0.0, 0.0)

    @property
    def is_blurred(self) -> bool:
        return self.has_shutter or self.has_aperture


class Timeline:
    """What a depsgraph holds at times around its frame. Leaving its `with` block goes back there."""

    def __init__(self, engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, scene: Scene) -> None:
        """`scene` is what was exported at the frame."""
        self._engine, self._depsgraph = engine, depsgraph
        self._frame, self._subframe = depsgraph.scene.frame_current, depsgraph.scene.frame_subframe
        self._time = 0.0
        self._scenes = {0.0: scene}
        self._chords: Chords = {}

    def __enter__(self) -> Timeline:
        return self

    def __exit__(self, *_exception: object) -> None:
        self._go(0.0)

    def scene(self, time: float) -> Scene:
        """Of `time` frames from now. That of the frame and the last other one are kept."""
        if time not in self._scenes:
            self._go(time)
            found = export_scene(self._depsgraph)
            fill_velocities(found, self._chords)
            self._scenes = {0.0: self._scenes[0.0], time: found}
        return self._scenes[time]

    def camera(self, time: float = 0.0) -> core.Camera:
        """Of the view that the engine has set, `time` frames from now."""
        self._go(time)
        bpy_scene = self._depsgraph.scene
        owner = self._engine.camera_override or bpy_scene.camera
        if owner is None:
            raise core.FumaroleError(core.ErrorCode.ARGUMENT, f"Scene '{bpy_scene.name}' has no camera")
        owner = owner.evaluated_get(self._depsgraph)
        matrix = np.array(self._engine.camera_model_matrix(owner), dtype=np.float64)
        shift_x = self._engine.camera_shift_x(owner)
        layer, warn = self._depsgraph.view_layer_eval, self._scenes[0.0].warn
        return export_camera(owner, bpy_scene, layer, matrix, shift_x, warn)

    def moving_camera(self, time: float) -> core.Camera:
        """The same, and where it is a frame before and after that."""
        camera = self.camera(time)
        return camera.moving(self.camera(time - 1.0), self.camera(time + 1.0))

    def exposure(self) -> Exposure:
        """What is blurred in a picture of the frame. Gives particles without velocities those that they move by."""
        now = Moment(0.0, self.scene(0.0), self.camera())
        exposure = Exposure(now.camera.shutter, now.camera.aperture.radius > 0.0)
        shutter: list[Moment] = []
        if exposure.has_shutter:
            opens, closes = exposure.shutter
            times = (opens, (opens + closes) / 2, closes)
            shutter = [now if time == 0.0 else Moment(time, self.scene(time), self.camera(time)) for time in times]
            if is_still([now, *shutter]):
                exposure.shutter, shutter = (0.0, 0.0), []
            self._chords = chords(shutter)
            fill_velocities(now.scene, self._chords)
            exposure.camera_moves = camera_moves([now, *shutter])
        if exposure.is_blurred:
            exposure.least_samples = least_samples(now, shutter)
            exposure.sharp_samples = sharp_samples(now, shutter)
        return exposure

    def _go(self, time: float) -> None:
        if time == self._time:
            return
        if time == 0.0:
            self._engine.frame_set(self._frame, subframe=self._subframe)
        else:
            frame = self._frame + self._subframe + time
            self._engine.frame_set(math.floor(frame), subframe=frame - math.floor(frame))
        self._time = time


class CoreScenes:
    """Core scenes of exported ones: one at a time, in a `with` block.

    keeper: of what is the same in the next one; None: nothing is kept. After a failure nothing is kept.
    """

    def __init__(self, threads: int, keeper: Keeper | None) -> None:
        self._threads, self._keeper = threads, keeper
        self._scene: Scene | None = None
        self._made: tuple[core.Scene, list[str]] | None = None
        self._stack = contextlib.ExitStack()

    def __enter__(self) -> CoreScenes:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    def of(self, scene: Scene) -> tuple[core.Scene, list[str]]:
        """The core scene and the warnings of making it, if those are not its context's. Raises FumaroleError."""
        if self._scene is not scene:
            self._scene = None
            self._stack.close()
            self._made = self._stack.enter_context(_core_scene(scene, self._threads, self._keeper))
            self._scene = scene
        return self._made


@contextlib.contextmanager
def _core_scene(scene: Scene, threads: int, keeper: Keeper | None) -> Iterator[tuple[core.Scene, list[str]]]:
    if keeper is None:
        with core.Context(threads) as context:
            yield build(scene, context), []
        return
    kept = keeper.take(scene, threads)
    try:
        yield kept.core_scene, kept.warnings
    except BaseException:
        kept.close()
        raise
    keeper.keep(kept)
