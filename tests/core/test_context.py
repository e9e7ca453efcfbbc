# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress, cancelling, interrupts, warnings, and the end of contexts and scenes."""

from __future__ import annotations

import gc
import math
import os
import signal
import subprocess
import sys
import threading
import weakref
from pathlib import Path

import numpy as np
import pytest

from fumarole import core

ADDON = Path(__file__).resolve().parent.parent.parent / "blender_addon"
PASSED_ON = ("FUMAROLE_LIBRARY", "LD_PRELOAD", "ASAN_OPTIONS")


def puff(context: core.Context | None = None, count: int = 2000) -> core.Scene:
    scene = core.Scene(context)
    position = np.random.default_rng(5).normal(0, 0.5, (count, 3)) - (0, 0, 5)
    scene.add_particles(position, radius=0.2, density=1.0, name="puff")
    scene.add_light("POINT", power=100.0)
    return scene


CAMERA = core.Camera(width=32, height=32)


def test_progress_names_stages_in_order_with_fractions() -> None:
    calls: list[tuple[str, float, str]] = []
    with core.Context(progress=lambda *call: calls.append(call)) as context:
        core.render(puff(context), CAMERA)
    stages = list(dict.fromkeys(stage for stage, _, _ in calls))
    known = ["octree", "lighting", "sorting", "drawing", "passes"]
    assert stages == sorted(stages, key=known.index)
    assert {"octree", "lighting", "drawing"} <= set(stages)
    assert all(0 <= fraction <= 1 and isinstance(message, str) for _, fraction, message in calls)


def test_progress_tells_every_step_of_a_fast_render() -> None:
    """The steps of one stage follow each other faster than progress is repeated within a step."""
    messages = []
    with core.Context(progress=lambda _stage, _fraction, message: messages.append(message)) as context:
        core.render(puff(context, 10), CAMERA)
    assert messages[:3] == ["Collecting particles", "Sorting particles in space", "Subdividing cells"]


@pytest.mark.parametrize("stage", ["octree", "lighting", "drawing"])
def test_cancelling_at_a_stage_then_rendering_again(stage: str) -> None:
    with core.Context(progress=lambda name, *_: name == stage) as context:
        scene = puff(context)
        with pytest.raises(core.Cancelled) as caught:
            core.render(scene, CAMERA)
        assert caught.value.code == core.ErrorCode.CANCELLED
        context.progress = None
        again = core.render(scene, CAMERA)["Combined"]
    np.testing.assert_array_equal(again, core.render(puff(), CAMERA)["Combined"])


@pytest.mark.parametrize("kind", [ZeroDivisionError, KeyboardInterrupt, SystemExit])
def test_exception_in_progress_cancels_and_arrives_at_the_caller(kind: type[BaseException]) -> None:
    calls = []

    def progress(*_call: object) -> None:
        calls.append(1)
        raise kind("from progress")

    with core.Context(progress=progress) as context:
        scene = puff(context)
        with pytest.raises(kind, match="from progress"):
            core.render(scene, CAMERA)
        assert len(calls) == 1


@pytest.mark.parametrize("progress", ["None", "lambda *call: None"])
def test_interrupt_during_the_c_call_arrives_as_keyboard_interrupt(progress: str) -> None:
    """SIGINT comes while the library works; Python raises it at the callback's first instruction."""
    program = f"""
import os, signal, threading, time
import numpy as np
from fumarole import core
signal.signal(signal.SIGINT, signal.default_int_handler)
random = np.random.default_rng(5)
scene = core.Scene(core.Context(progress={progress}))
scene.add_particles(random.normal(0, 1, (300_000, 3)), radius=0.3)
scene.add_light("POINT", power=100.0)
points = random.normal(0, 3, (10_000_000, 3)).astype(np.float32)
def interrupt():
    time.sleep(0.3)
    os.kill(os.getpid(), signal.SIGINT)
try:
    threading.Thread(target=interrupt).start()
    core.transmittance(scene, points, settings=core.Settings(tolerance=1e-4))
    print("not interrupted")
except KeyboardInterrupt:
    print("interrupted")
"""
    environment = {"PYTHONPATH": str(ADDON), "PATH": "/usr/bin:/bin"}
    environment |= {name: os.environ[name] for name in PASSED_ON if name in os.environ}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=120
    )
    assert (done.stdout, done.stderr, done.returncode) == ("interrupted\n", "", 0)


def test_signal_handlers_and_hooks_are_as_before() -> None:
    before = (signal.getsignal(signal.SIGINT), sys.unraisablehook)
    core.render(puff(), CAMERA)
    assert (signal.getsignal(signal.SIGINT), sys.unraisablehook) == before


def test_threads_out_of_range_are_an_error() -> None:
    with pytest.raises(core.FumaroleError, match="1025"):
        core.Context(threads=1025)
    context = core.Context(threads=2)
    with pytest.raises(core.FumaroleError, match="-1"):
        context.threads = -1
    assert context.threads == 2


def test_dropped_particles_are_counted_in_a_warning() -> None:
    with core.Context() as context:
        scene = core.Scene(context)
        position = np.zeros((10, 3), np.float32)
        position[[2, 5, 7]] = np.nan
        scene.add_particles(position, name="chimney")
        assert len(context.warnings) == 1
        assert "chimney" in context.warnings[0] and "3" in context.warnings[0]
        context.clear_warnings()
        assert context.warnings == []


@pytest.mark.parametrize("name", ["é" * 2000, "x" + "煙" * 2000, "lone \udce9 surrogate"])
def test_any_name_can_be_told(name: str) -> None:
    with core.Context() as context:
        scene = core.Scene(context)
        with pytest.raises(core.FumaroleError, match=name[:2]):
            scene.add_light("POINT", power=-1.0, name=name)
        scene.add_particles([(math.nan, 0, 0)], name=name)
        assert name[:2] in context.warnings[0]


def test_use_after_close_is_an_error() -> None:
    context = core.Context()
    scene = puff(context)
    context.close()
    context.close()
    for use in (lambda: core.render(scene, CAMERA), lambda: scene.add_light("SUN"), lambda: core.Scene(context)):
        with pytest.raises(core.FumaroleError, match="is closed"):
            use()
    with pytest.raises(core.FumaroleError, match="is closed"):
        context.warnings


def test_scene_keeps_its_context_and_both_end_with_the_last_reference() -> None:
    scene = puff(core.Context())
    context = weakref.ref(scene.context)
    gc.collect()
    assert core.render(scene, CAMERA)["Combined"].any()
    del scene
    gc.collect()
    assert context() is None


def test_second_call_on_a_busy_context_is_an_error() -> None:
    errors = []

    def progress(*_call: object) -> None:
        if not errors:
            with pytest.raises(core.FumaroleError, match="busy") as caught:
                scene.add_light("SUN")
            errors.append(caught)

    with core.Context(progress=progress) as context:
        scene = core.Scene(context)
        context.progress = None
        scene.add_particles([(0, 0, -5)])
        context.progress = progress
        core.render(scene, CAMERA)
    assert errors


def test_contexts_in_two_threads_are_independent() -> None:
    expected = core.render(puff(), CAMERA)["Combined"]
    found = []

    def work() -> None:
        with core.Context(threads=1) as context:
            for _ in range(3):
                found.append(core.render(puff(context), CAMERA)["Combined"])

    threads = [threading.Thread(target=work) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 6
    for picture in found:
        np.testing.assert_array_equal(picture, expected)
