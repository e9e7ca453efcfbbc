# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of docs/PERFORMANCE.md from the CSV files that paper_measure wrote."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from charts_draw import Row, numbers, read, select, values
from doc_tables import error, markdown, put, seconds
from paper_draw import exponent

# Seconds that the paper's table 3 gives for 3,000,000 particles: theirs, and Krakatoa's.
PAPER_SUBSAMPLING = {1.0: (10.4, 17.8), 0.5: (5.5, 9.0), 0.1: (3.5, 2.2)}


def take(row: Row, columns: Iterable[str]) -> list[str]:
    """Cells of some columns: times by their names, errors, numbers."""
    cells = []
    for name in columns:
        value = row[name]
        if name.endswith("_s"):
            cells.append(seconds(float(value)))
        elif name in ("rms", "accuracy_rms"):
            cells.append(error(float(value)))
        elif name in ("solver", "device"):
            cells.append(value)
        else:
            cells.append(f"{float(value):,.10g}")
    return cells


def growth(rows: list[Row], column: str, time: str) -> str:
    """How time grows, for each solver."""
    found = []
    for solver in values(rows, "solver"):
        line = select(rows, solver=solver)
        found.append(f"{solver}: {exponent(numbers(line, column), numbers(line, time)):.2f}")
    return f"Exponent of the time over {column}: {', '.join(found)}."


def speedup(rows: list[Row], column: str, name: Callable[[float], str]) -> str:
    """How many times as long exact solvers light as sweeps."""
    exact, sweep = (select(rows, solver=solver) for solver in ("exact", "sweep"))
    ratios = zip(numbers(exact, column), numbers(exact, "light_s"), numbers(sweep, "light_s"), strict=True)
    found = ", ".join(f"{slow / fast:.0f} ({name(value)})" for value, slow, fast in ratios)
    return f"Lighting by a sweep is so many times as fast as the exact one: {found}."


def lighting_table(rows: list[Row], column: str, title: str) -> str:
    titles = (title, "solver", "octree (s)", "lighting (s)", "RMS error of T", "of the meter", "peak memory (MB)")
    columns = (column, "solver", "build_s", "light_s", "rms", "accuracy_rms")
    cells = [[*take(row, columns), f"{float(row['peak_rss_mb']):,.0f}"] for row in rows]
    return f"{markdown(titles, cells)}\n\n{growth(rows, column, 'light_s')}"


def machine_table(charts: Path) -> str:
    titles = ("", "processor", "threads", "instructions")
    ours = [["here", *row.values()] for row in read(charts / "paper_machine.csv")]
    return markdown(titles, [*ours, ["the paper", "Intel i7, 2.67 GHz", "four cores, hyperthreading", ""]])


def particles_table(charts: Path) -> str:
    rows = read(charts / "paper_particles.csv")
    table = lighting_table(rows, "particles", "particles")
    return f"{table}\n\n{speedup(rows, 'particles', lambda particles: f'{particles:,.0f}')}"


def lights_table(charts: Path) -> str:
    return lighting_table(read(charts / "paper_lights.csv"), "lights", "lights")


def frame_size_table(charts: Path) -> str:
    rows = read(charts / "paper_frame_size.csv")
    titles = ("frame", "solver", "light (s)", "meter (s)", "sort (s)", "draw (s)", "whole frame (s)", "RMS error of T")
    columns = ("solver", "light_s", "meter_s", "sort_s", "draw_s", "total_s", "accuracy_rms")
    cells = [[f"{row['width']} x {row['height']}", *take(row, columns)] for row in rows]
    return f"{markdown(titles, cells)}\n\n{growth(rows, 'width', 'total_s')}"


def leaf_size_table(charts: Path) -> str:
    titles = ("leaf size", "solver", "octree (s)", "light (s)", "whole frame (s)", "RMS error of T")
    columns = ("leaf", "solver", "build_s", "light_s", "total_s", "accuracy_rms")
    return markdown(titles, [take(row, columns) for row in read(charts / "paper_leaf_size.csv")])


def subsampling_table(charts: Path) -> str:
    """Frames beside the light at each particle, with the paper's own seconds."""
    light = read(charts / "paper_subsampling_light.csv")
    titles = (
        "share", "solver", "light at the particles (s)", "RMS error of T", "whole frame (s)", "refined", "picture differs by",
        "the paper (s)", "Krakatoa there (s)",
    )  # fmt: skip
    cells = []
    for row in read(charts / "paper_subsampling.csv"):
        share = float(row["subsampling"])
        (lit,) = select(light, solver=row["solver"], subsampling=share)
        paper = [f"{value:g}" for value in PAPER_SUBSAMPLING[share]]
        change = f"{100 * float(row['picture_change']):.2g} %"
        frame = (seconds(float(row["total_s"])), row["refinements"], change)
        cells.append([f"{100 * share:g} %", *take(lit, ("solver", "light_s", "rms")), *frame, *paper])
    return f"{markdown(titles, cells)}\n\n{speedup(light, 'subsampling', lambda share: f'{100 * share:g} %')}"


def look_table(path: Path, column: str) -> str:
    titles = ("factor", "device", "light (s)", "draw (s)", "whole frame (s)", "RMS error of T")
    columns = (column, "device", "light_s", "draw_s", "total_s", "accuracy_rms")
    return markdown(titles, [take(row, columns) for row in read(path)])


def drawn_size_table(charts: Path) -> str:
    return look_table(charts / "paper_drawn_size.csv", "grow")


def density_table(charts: Path) -> str:
    return look_table(charts / "paper_density.csv", "dense")


def plume_table(charts: Path) -> str:
    titles = ("particles", "lights", "frame", "light (s)", "draw (s)", "whole frame (s)", "RMS error of T")
    (row,) = read(charts / "paper_plume.csv")
    frame = f"{row['width']} x {row['height']}"
    cells = [*take(row, ("particles", "lights")), frame, *take(row, ("light_s", "draw_s", "total_s", "accuracy_rms"))]
    return markdown(titles, [cells])


TABLES: dict[str, Callable[[Path], str]] = {
    "machine": machine_table,
    "particles": particles_table,
    "lights": lights_table,
    "frame_size": frame_size_table,
    "leaf_size": leaf_size_table,
    "subsampling": subsampling_table,
    "drawn_size": drawn_size_table,
    "density": density_table,
    "plume": plume_table,
}


def fill(text: str, charts: Path) -> str:
    """The document with these tables anew."""
    for name, make in TABLES.items():
        text = put(text, name, make(charts))
    return text
