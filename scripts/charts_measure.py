# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures what the charts of docs/ACCURACY.md show: runs of `fumarole-bench image`, written as CSV files."""

from __future__ import annotations

import csv
import json
import os
import shlex
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CHARTS = ROOT / "docs" / "charts"
BENCH = ROOT / "build" / "release" / "fumarole-bench"

SCENE = ("scene", "particles", "depth", "light", "width", "height", "every")
SETTINGS = ("device", "tolerance", "subsampling", "threads")
RESULTS = ("image_rms_relative", "bias", "light_s", "draw_s", "total_s", "processor_s", "samples", "reference_error")
COLUMNS = SCENE + SETTINGS + RESULTS

TOLERANCES = (0.1, 0.03, 0.01, 0.003, 0.001)
SHARES = (0.5, 0.25, 0.1, 0.05, 0.01)
COUNTS = (100, 300, 1_000, 3_000, 10_000, 30_000, 100_000)
DEVICES = ("tiles", "gl")


@dataclass(frozen=True)
class Setting:
    """One row of a run."""

    device: str = "tiles"
    tolerance: float = 0.01
    subsampling: float = 1.0

    def options(self) -> list[str]:
        return ["--device", self.device, "--tolerance", f"{self.tolerance:g}", "--subsampling", f"{self.subsampling:g}"]


BOTH_DEVICES = tuple(Setting(device) for device in DEVICES)
EACH_TOLERANCE = tuple(Setting("tiles", tolerance) for tolerance in TOLERANCES)
EVERYTHING = (*EACH_TOLERANCE, Setting("gl"))
SUBSAMPLED = tuple(Setting(device, subsampling=share) for device in DEVICES for share in SHARES)


def command(scene: str, settings: Iterable[Setting], *more: object) -> list[str]:
    """What `./run bench` is asked for: a scene and all settings that are held against its reference."""
    rows = [setting.options() for setting in settings]
    options = rows[0] + [word for row in rows[1:] for word in ("--then", *row)]
    threads = len(os.sched_getaffinity(0))
    return ["image", "--scene", scene, "--threads", str(threads), *map(str, more), *options]


def size(pixels: int, every: int) -> tuple[object, ...]:
    return "--width", pixels, "--height", pixels, "--every", every


def tables() -> dict[str, list[list[str]]]:
    """The runs that make each file."""
    side = ("--light", "side")
    quick = (*side, *size(384, 4), "--repeat", 3)
    few = size(192, 4)
    return {
        "settings": [
            command("ball", EVERYTHING, "--depth", 20, *quick),
            command("mixed", EVERYTHING, *quick),
            command("plume", EVERYTHING + SUBSAMPLED, *side, *size(768, 24), "--reference-tolerance", 0.001),
        ],
        "particle_count": [
            command("ball", BOTH_DEVICES, *side, *size(384, 8), "--depth", depth, "--particles", count)
            for depth in (5, 20)
            for count in COUNTS
        ],
        "tolerance": [
            command("puff", EACH_TOLERANCE, *few),
            command("six", EACH_TOLERANCE, *few),
            command("ball", EACH_TOLERANCE, *few),
            command("edge", EACH_TOLERANCE, *few),
            command("plume", EACH_TOLERANCE, *few, "--particles", 20_000),
        ],
    }


def measure(run: list[str]) -> list[dict[str, object]]:
    """The rows of one run. Raises RuntimeError with the run and what it said."""
    repeat = f"./run bench {shlex.join(run)}"
    print(repeat, file=sys.stderr, flush=True)
    done = subprocess.run([str(BENCH), *run], capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(f"{repeat}\nexit code {done.returncode}: {done.stderr.strip()}")
    return [json.loads(line) for line in done.stdout.splitlines()]


def write_rows(path: Path, rows: Iterable[Mapping[str, object]], columns: Sequence[str]) -> None:
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def measure_all() -> int:
    """Writes every file. One that a run of which failed stays as it was; returns how many did."""
    CHARTS.mkdir(exist_ok=True)
    failed = 0
    for name, runs in tables().items():
        try:
            rows = [row for run in runs for row in measure(run)]
        except (RuntimeError, OSError, ValueError) as error:
            print(f"bench charts: {name}.csv is left as it was: {error}", file=sys.stderr)
            failed += 1
            continue
        write_rows(CHARTS / f"{name}.csv", rows, COLUMNS)
    return failed
