# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the charts of docs/PERFORMANCE.md from the CSV files that paper_measure wrote."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from charts_draw import BLUE, GREEN, GUIDE, INK, ORANGE, STYLE, Row, numbers, plain, pyplot, read, round_ticks, scale, select, values
from matplotlib.axes import Axes
from matplotlib.figure import Figure

COLOURS = (BLUE, ORANGE, GREEN)
MARKERS = "osD"
DASHED = (0, (5, 3))


def exponent(x: Sequence[float], y: Sequence[float]) -> float:
    """Power of x with which y grows: the slope of the line through the logarithms."""
    horizontal, vertical = [math.log(value) for value in x], [math.log(max(value, 1e-6)) for value in y]
    middle, height = sum(horizontal) / len(x), sum(vertical) / len(y)
    spread = sum((value - middle) ** 2 for value in horizontal)
    return sum((a - middle) * (b - height) for a, b in zip(horizontal, vertical, strict=True)) / spread


def short(value: float, _: object = None) -> str:
    """A number of particles."""
    for size, unit in ((1e6, " M"), (1e3, " k")):
        if value >= size:
            return f"{value / size:g}{unit}"
    return f"{value:g}"


def set_axes(axes: Axes, x_label: str, ticks: Sequence[float], label: object = plain) -> None:
    """Logarithmic axes; the times' ticks are chosen, those of x given."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    scale(axes.xaxis, sorted(set(ticks)), label)
    low, high = axes.get_ylim()
    steps = (1, 3) if high > 30 * low else (1, 2, 5)
    scale(axes.yaxis, round_ticks(low, high, steps), plain)
    axes.set_xlabel(x_label)


def draw_line(axes: Axes, rows: list[Row], x: str, y: str, name: str, index: int, **more: object) -> None:
    heights = [max(value, 1e-4) for value in numbers(rows, y)]
    axes.plot(numbers(rows, x), heights, color=COLOURS[index], marker=MARKERS[index], label=name, **more)


def draw_guide(axes: Axes, rows: list[Row], x: str, y: str, name: str) -> None:
    """What growth in proportion to x would be, from the first row on."""
    ends = min(numbers(rows, x)), max(numbers(rows, x))
    start = float(rows[0][y])
    heights = [start, start * ends[1] / ends[0]]
    axes.plot(ends, heights, color=GUIDE, linestyle=DASHED, linewidth=1.2, zorder=1, label=name)


def draw_lighting(charts: Path) -> Figure:
    figure, panels = pyplot.subplots(1, 2, figsize=(10, 4.2))
    for axes, name, column in zip(panels, ("particles", "lights"), ("particles", "lights"), strict=True):
        rows = read(charts / f"paper_{name}.csv")
        for index, solver in enumerate(values(rows, "solver")):
            draw_line(axes, select(rows, solver=solver), column, "light_s", solver, index)
        draw_guide(axes, rows, column, "light_s", "in proportion")
        set_axes(axes, column, numbers(rows, column), short)
    panels[0].legend(frameon=False, fontsize=9)
    panels[0].set_title("lighting (s), one light")
    panels[1].set_title(f"lighting (s), {short(float(rows[0]['particles']))} particles")
    return figure


def draw_parts(axes: Axes, rows: list[Row], column: str) -> None:
    """The whole frame for each solver, with its light dashed, and the drawing."""
    for index, solver in enumerate(values(rows, "solver")):
        line = select(rows, solver=solver)
        draw_line(axes, line, column, "total_s", f"frame, {solver}", index)
        draw_line(axes, line, column, "light_s", f"light, {solver}", index, linestyle=DASHED, mfc="white")
    first = select(rows, solver=rows[0]["solver"])
    axes.plot(numbers(first, column), numbers(first, "draw_s"), color=INK, marker="^", linewidth=1.2, label="drawing")


def draw_frame(charts: Path) -> Figure:
    figure, panels = pyplot.subplots(1, 2, figsize=(10, 4.4))
    contents = (("frame_size", "width", "width of the frame (pixels)"), ("leaf_size", "leaf", "leaf size of the octree"))
    for axes, (name, column, label) in zip(panels, contents, strict=True):
        rows = read(charts / f"paper_{name}.csv")
        draw_parts(axes, rows, column)
        set_axes(axes, label, numbers(rows, column), lambda value, _: f"{value:g}")
        axes.set_title(f"time (s), {short(float(rows[0]['particles']))} particles, one light")
    panels[0].legend(frameon=False, fontsize=9)
    return figure


def draw_looks(charts: Path) -> Figure:
    figure, panels = pyplot.subplots(1, 2, figsize=(10, 4.2))
    contents = (("drawn_size", "grow", "factor on the drawn radius"), ("density", "dense", "factor on the density"))
    for axes, (name, column, label) in zip(panels, contents, strict=True):
        rows = read(charts / f"paper_{name}.csv")
        for index, device in enumerate(values(rows, "device")):
            line = select(rows, device=device)
            draw_line(axes, line, column, "total_s", f"frame, {device}", index)
            draw_line(axes, line, column, "light_s", f"light, {device}", index, linestyle=DASHED, mfc="white")
        set_axes(axes, label, numbers(rows, column))
        axes.set_title(f"time (s), {short(float(rows[0]['particles']))} particles, one light")
    panels[0].legend(frameon=False, fontsize=9)  # for both
    return figure


CHARTS = {"lighting": draw_lighting, "frame": draw_frame, "looks": draw_looks}


def draw_all(charts: Path, pictures: Path) -> list[Path]:
    """Writes every chart; returns their paths."""
    paths = []
    for name, draw in CHARTS.items():
        with pyplot.rc_context(STYLE):
            figure = draw(charts)
            path = pictures / f"chart_paper_{name}.png"
            figure.tight_layout()
            figure.savefig(path, dpi=130, facecolor="white", metadata={"Software": None})
            pyplot.close(figure)
        paths.append(path)
    return paths
