# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures what the chart of blur in docs/ACCURACY.md shows: errors and times of motion blur and of depth of field,
drawn in one pass, as the mean of smeared parts, and as the mean of sharp samples."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from charts_measure import CHARTS, ROOT, write_rows

sys.path.insert(0, str(ROOT / "blender_addon"))
from fumarole import core  # noqa: E402
from fumarole.core.blur import BlurSample, average  # noqa: E402

FILE = CHARTS / "blur.csv"
COLUMNS = ("blur", "smoke", "method", "samples", "error", "processor_s", "chosen", "expected_error")
SMOKES = {"thin": 0.5, "thick": 12.0, "behind an edge": 3.0}  # optical depths
COUNTS = (1, 2, 4, 8, 16)
TRUTH = 64  # sharp samples
PARTICLES, SIDE = 2000, 96


def scene_at(smoke: str, frames: float) -> core.Scene:
    """A ball that turns about the view's axis and drifts, lit from the side; `frames` from now."""
    rng = np.random.default_rng(7)
    places = rng.normal(size=(PARTICLES, 3))
    places *= (rng.random(PARTICLES) ** (1 / 3) / np.linalg.norm(places, axis=1))[:, None]
    velocities = 0.5 * np.stack((-places[:, 1], places[:, 0], 0 * places[:, 0]), axis=1) + (0.5, 0.0, 0.2)
    sigma = (0.5 * 4 / 3 * np.pi / PARTICLES) ** (1 / 3)
    density = SMOKES[smoke] / (2 * PARTICLES / (4 / 3 * np.pi) * sigma**3 * (2 * np.pi) ** 1.5)
    scene = core.Scene()
    # The ids stay, so that what hangs on them does.
    scene.add_particles(places + frames * velocities, radius=2 * sigma, density=density, velocity=velocities)
    scene.add_light("SUN", matrix=[[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]], power=3.0)
    if smoke == "behind an edge":
        scene.add_mesh([(0.1, -9, 1.6), (9, -9, 1.6), (9, 9, 1.6), (0.6, 9, 1.6)], [(0, 1, 2), (0, 2, 3)])
    return scene


def camera_at(blur: str, frames: float) -> core.Camera:
    """Passes by to the left; its shutter is open for half a frame or its lens sharp a metre in front of the ball."""

    def place(x: float) -> core.Camera:
        matrix = [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 5.0], [0, 0, 0, 1]]
        return core.Camera(matrix=matrix, lens=50, width=SIDE, height=SIDE)

    if blur == "depth of field":
        return place(0.0).blurred(aperture=core.Aperture(radius=0.25, focus=4.0, blades=6))
    speed = -0.4
    moving = place(speed * frames).moving(place(speed * (frames - 1)), place(speed * (frames + 1)))
    return moving.blurred((-0.25, 0.25))


def picture(blur: str, smoke: str, samples: int, is_sharp: bool) -> np.ndarray:
    """Combined of the mean of so many samples, smeared over their parts or not."""

    def draw(sample: BlurSample, wanted: list[str]) -> core.Result:
        camera = sample.camera(camera_at(blur, sample.time).blurred(now.shutter, now.aperture))
        return core.render(scene_at(smoke, sample.time), camera.blurred() if is_sharp else camera, passes=wanted)

    now = camera_at(blur, 0.0)
    return average(draw, {"Combined": "Combined"}, now.shutter, samples)["Combined"].astype(np.float64)


def error_of(found: np.ndarray, truth: np.ndarray) -> float:
    """Root mean square of all channels, relative to that of the truth."""
    return float(np.sqrt(np.mean((found - truth) ** 2) / np.mean(truth**2)))


def rows(blur: str, smoke: str) -> Iterator[dict[str, object]]:
    truth = picture(blur, smoke, TRUTH, True)
    needed = core.measure_blur(scene_at(smoke, 0.0), camera_at(blur, 0.0))
    for method, is_sharp in (("parts", False), ("sharp samples", True)):
        for samples in COUNTS:
            start = time.process_time()
            found = picture(blur, smoke, samples, is_sharp)
            yield {
                "blur": blur,
                "smoke": smoke,
                "method": method,
                "samples": samples,
                "error": f"{error_of(found, truth):.3g}",
                "processor_s": f"{time.process_time() - start:.3g}",
                "chosen": needed.samples,
                "expected_error": f"{needed.error:.3g}",
            }


def measure_all() -> None:
    CHARTS.mkdir(exist_ok=True)
    found = []
    for blur in ("motion", "depth of field"):
        for smoke in SMOKES:
            print(f"{blur}, smoke {smoke}", file=sys.stderr, flush=True)
            found += rows(blur, smoke)
    write_rows(Path(FILE), found, COLUMNS)


if __name__ == "__main__":
    measure_all()
