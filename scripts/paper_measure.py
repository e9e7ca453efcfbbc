# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures the paper's evaluation on the benchmark's plume: what docs/PERFORMANCE.md shows, as CSV files and pictures."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import charts_measure
import numpy as np
import paper_pictures
from exr_reader import read_exr

# Those of --solver that are held against each other.
SOLVERS = ("exact", "sweep")

LIGHTING = (
    "particles", "lights", "solver", "threads", "tolerance", "leaf", "subsampling", "build_s", "light_s", "sample",
    "rms", "accuracy_rms", "peak_rss_mb",
)  # fmt: skip
FRAME = (
    "particles", "lights", "solver", "device", "threads", "width", "height", "tolerance", "leaf", "subsampling", "grow",
    "dense", "light_points", "refinements", "build_s", "light_s", "meter_s", "sort_s", "draw_s", "total_s",
    "accuracy_rms", "peak_rss_mb",
)  # fmt: skip

Row = dict[str, object]


@dataclass(frozen=True)
class Sizes:
    """How much is measured."""

    particles: Sequence[int]
    lights: Sequence[int]
    widths: Sequence[int]
    leaves: Sequence[int]
    few: int  # particles of the runs over lights, frame sizes, drawn sizes and densities
    many: int  # over leaf sizes
    subsampled: int
    plume: int
    picture: tuple[int, int]
    repeats: int  # of runs that are short
    long: int  # particles times lights from which a run isn't repeated
    checks: int  # particles times lights times points that brute force takes, at 16 points or more


FULL = Sizes(
    particles=(250_000, 500_000, 1_000_000, 2_500_000, 5_000_000, 10_000_000),
    lights=(1, 2, 4, 8, 16),
    widths=(512, 1024, 2048, 4096),
    leaves=(8, 16, 32, 64, 128, 256, 512, 1024, 2048),
    few=250_000,
    many=1_000_000,
    subsampled=3_000_000,
    plume=350_000,
    picture=(384, 512),
    repeats=3,
    long=2_000_000,
    checks=50_000_000,
)
QUICK = Sizes(
    particles=(1_000, 2_000, 4_000),
    lights=(1, 2),
    widths=(64, 128),
    leaves=(16, 64),
    few=2_000,
    many=3_000,
    subsampled=4_000,
    plume=3_000,
    picture=(48, 64),
    repeats=1,
    long=1,
    checks=1_000_000,
)
SHARES, GROWN, DENSE = (1.0, 0.5, 0.1), (1, 2, 4), (1, 2, 4, 8)


@dataclass(frozen=True)
class Run:
    """A run of the benchmark; of `repeats`, the one of median time counts. `picture` names what it draws."""

    options: tuple[str, ...]
    repeats: int = 1
    picture: str = ""


def run(command: str, *options: object, repeats: int = 1, picture: str = "") -> Run:
    threads = len(os.sched_getaffinity(0))
    return Run((command, *map(str, options), "--threads", str(threads)), repeats, picture)


def lighting(sizes: Sizes, solver: str, particles: int, lights: int = 1, share: float = 1.0) -> Run:
    work = particles * lights
    sample = max(16, min(256, sizes.checks // work))
    options = ("--particles", particles, "--lights", lights, "--subsampling", share, "--solver", solver, "--sample", sample)
    return run("lighting", *options, repeats=1 if solver == "exact" and work >= sizes.long else sizes.repeats)


def frame(sizes: Sizes, particles: int, size: tuple[int, int], *more: object, device: str = "tiles", picture: str = "") -> Run:
    options = ("--particles", particles, "--width", size[0], "--height", size[1], "--device", device, *more)
    repeats = sizes.repeats if particles < sizes.long and device == "tiles" else 1
    return run("frame", *options, repeats=repeats, picture=picture)


def look(sizes: Sizes, option: str, factors: Sequence[float]) -> list[Run]:
    """Both devices, with the pictures of one."""
    return [
        frame(sizes, sizes.few, sizes.picture, option, x, device=device, picture=f"{x}" if device == "tiles" else "")
        for device in ("tiles", "gl")
        for x in factors
    ]


def tables(sizes: Sizes) -> dict[str, tuple[Sequence[str], list[Run]]]:
    """The columns of each file, paper_NAME.csv, and the runs that make it."""
    wide = (960, 540)
    return {
        "particles": (LIGHTING, [lighting(sizes, s, n) for s in SOLVERS for n in sizes.particles]),
        "lights": (LIGHTING, [lighting(sizes, s, sizes.few, k) for s in SOLVERS for k in sizes.lights]),
        "frame_size": (
            FRAME,
            [frame(sizes, sizes.few, (w, w * 9 // 16), "--solver", s) for s in SOLVERS for w in sizes.widths],
        ),
        "leaf_size": (
            FRAME,
            [frame(sizes, sizes.many, wide, "--leaf", n, "--solver", s) for s in SOLVERS for n in sizes.leaves],
        ),
        "subsampling_light": (LIGHTING, [lighting(sizes, s, sizes.subsampled, 1, x) for s in SOLVERS for x in SHARES]),
        "subsampling": (
            (*FRAME, "picture_change"),
            [
                frame(sizes, sizes.subsampled, sizes.picture, "--subsampling", x, "--solver", s, picture=f"{100 * x:g} %")
                for s in SOLVERS
                for x in SHARES
            ],
        ),
        "drawn_size": (FRAME, look(sizes, "--grow", GROWN)),
        "density": (FRAME, look(sizes, "--dense", DENSE)),
        "plume": (FRAME, [frame(sizes, sizes.plume, tuple(2 * n for n in sizes.picture), "--lights", 3, picture="plume")]),
    }


def time_of(row: Row) -> float:
    return float(row["total_s"] if "total_s" in row else row["light_s"])


def measure(item: Run, folder: Path) -> tuple[Row, np.ndarray | None]:
    """The row of median time, and the picture: (height, width, 4), first row on top."""
    path = folder / "picture.exr"
    options = [*item.options, "--exr", str(path)] if item.picture else [*item.options]
    rows = [charts_measure.measure(options)[0] for _ in range(item.repeats)]
    row = sorted(rows, key=time_of)[len(rows) // 2]
    if str(row.get("device", "")).startswith("llvmpipe"):
        row["device"] = "gl (llvmpipe)"  # without its version
    if not item.picture:
        return row, None
    channels = read_exr(path)
    return row, np.dstack([channels[name] for name in "RGBA"])[::-1]


def relative_rms(picture: np.ndarray, expected: np.ndarray) -> float:
    rgb = expected[..., :3].astype(float)
    return float(np.sqrt(((picture[..., :3] - rgb) ** 2).sum() / (rgb**2).sum()))


def measure_table(runs: Sequence[Run], folder: Path) -> tuple[list[Row], dict[str, np.ndarray]]:
    """All rows, and the pictures by their names; solvers agree within the tolerance, so the last one's are kept."""
    rows, pictures, first = [], {}, None
    for item in runs:
        row, picture = measure(item, folder)
        rows.append(row)
        if picture is not None:
            if row["subsampling"] == 1.0:
                first = picture
            row["picture_change"] = f"{relative_rms(picture, first):.3g}"
            pictures[item.picture] = picture
    return rows, pictures


TITLES: Mapping[str, Callable[[str], str]] = {
    "subsampling": lambda name: f"{name} of the particles cast shadows",
    "drawn_size": lambda name: f"drawn {name} times as large",
    "density": lambda name: f"{name} times as dense",
    "plume": lambda name: "",
}


def machine() -> Row:
    """What the times depend on."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    facts = {name.strip(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
    flags = set(facts.get("flags", "").split())
    known = {"AVX-512": {"avx512f", "avx512dq", "avx512vl", "avx512bw"}, "AVX2": {"avx2", "fma"}, "plain": set()}
    best = next(name for name, needed in known.items() if needed <= flags)
    processor = facts.get("model name", "unknown").replace(",", "")
    return {"processor": processor, "threads": len(os.sched_getaffinity(0)), "instruction_set": best}


def measure_all(sizes: Sizes, charts: Path, pictures: Path) -> int:
    """Writes every file. One that a run of which failed stays as it was; returns how many did."""
    failed = 0
    for folder in (charts, pictures):
        folder.mkdir(parents=True, exist_ok=True)
    here = machine()
    charts_measure.write_rows(charts / "paper_machine.csv", [here], tuple(here))
    for name, (columns, runs) in tables(sizes).items():
        try:
            with tempfile.TemporaryDirectory() as folder:
                rows, drawn = measure_table(runs, Path(folder))
        except (RuntimeError, OSError, ValueError) as error:
            print(f"bench paper: paper_{name}.csv is left as it was: {error}", file=sys.stderr)
            failed += 1
            continue
        charts_measure.write_rows(charts / f"paper_{name}.csv", rows, columns)
        if drawn:
            titled = {TITLES[name](title): picture for title, picture in drawn.items()}
            paper_pictures.write_sheet(pictures / f"paper_{name}.png", titled)
    return failed
