# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the charts of docs/ACCURACY.md from the CSV files that charts_measure wrote."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot  # noqa: E402
from matplotlib.axes import Axes  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator  # noqa: E402

# Colours of Okabe and Ito, told apart by colour-blind people.
BLUE, ORANGE, GREEN, PINK, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9"
INK, GUIDE = "#333333", "#999999"
METHODS = {"tiles": ("Processor", BLUE, "o"), "gl": ("OpenGL", ORANGE, "s")}
STYLE = {
    "font.size": 10,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.edgecolor": GUIDE,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.minor.size": 0,
    "ytick.minor.size": 0,
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "lines.linewidth": 1.8,
    "lines.markersize": 5.5,
}

Row = dict[str, str]


def read(path: Path) -> list[Row]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def select(rows: Iterable[Row], **wanted: object) -> list[Row]:
    """Rows whose columns hold these values; numbers are compared as numbers."""

    def holds(row: Row, name: str, value: object) -> bool:
        return row[name] == value if isinstance(value, str) else float(row[name]) == value

    return [row for row in rows if all(holds(row, name, value) for name, value in wanted.items())]


def numbers(rows: Iterable[Row], column: str) -> list[float]:
    return [float(row[column]) for row in rows]


def values(rows: Iterable[Row], column: str) -> list[str]:
    """Different values of a column in their order."""
    return list(dict.fromkeys(row[column] for row in rows))


def percent(value: float, _: object = None) -> str:
    return f"{100 * value:g} %"


def plain(value: float, _: object = None) -> str:
    return f"{value:,.0f}" if value >= 1 else f"{value:g}"


def scale(axis: object, ticks: Sequence[float], label: object) -> None:
    """Ticks at these values alone."""
    axis.set_major_locator(FixedLocator(ticks))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(label))


def round_ticks(low: float, high: float, steps: Sequence[float] = (1, 3)) -> list[float]:
    every = [step * 10.0**power for power in range(-6, 8) for step in steps]
    return [tick for tick in every if 0.99 * low <= tick <= 1.01 * high]


def fit(axes: Axes, x: Sequence[float], y: Sequence[float], x_label: object = plain) -> None:
    """Logarithmic axes with some room around the data."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(min(x) / 1.6, max(x) * 1.6)
    axes.set_ylim(min(y) / 1.6, max(y) * 1.6)
    scale(axes.xaxis, round_ticks(*axes.get_xlim()), x_label)
    scale(axes.yaxis, round_ticks(*axes.get_ylim()), percent)


def write_beside(axes: Axes, text: str, x: float, y: float, offset: tuple[float, float], **more: object) -> None:
    """Text at a distance in points from a place of the chart."""
    axes.annotate(text, (x, y), offset, textcoords="offset points", **({"fontsize": 9, "va": "center"} | more))


def front(points: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """The points than which no other is both faster and more exact."""
    best: list[tuple[float, float]] = []
    for time, error in sorted(points):
        if not best or error < best[-1][1]:
            best.append((time, error))
    return best


def position(row: Row) -> tuple[float, float]:
    """Where a setting stands in the chart of error against time."""
    return float(row["processor_s"]), float(row["image_rms_relative"])


def scene_title(row: Row) -> str:
    return f"{row['scene']}: {int(row['particles']):,} particles, depth {float(row['depth']):g}"


def draw_scene_settings(axes: Axes, rows: list[Row]) -> None:
    """Error against time of one scene: methods as lines over the tolerance, the front of all."""
    times, errors = numbers(rows, "processor_s"), numbers(rows, "image_rms_relative")
    best = front(zip(times, errors, strict=True))
    axes.step(*zip(*best, strict=True), where="post", color="#dddddd", linewidth=6, solid_joinstyle="round", zorder=1)
    for device, (_, colour, marker) in METHODS.items():
        full = select(rows, device=device, subsampling=1.0)
        axes.plot(numbers(full, "processor_s"), numbers(full, "image_rms_relative"), color=colour, marker=marker)
        part = [row for row in select(rows, device=device) if float(row["subsampling"]) < 1]
        axes.plot(numbers(part, "processor_s"), numbers(part, "image_rms_relative"), color=colour, marker=marker, ls="", mfc="white")
        side, align = (7, "left") if device == "tiles" else (-7, "right")
        for row in part:
            write_beside(axes, percent(float(row["subsampling"])), *position(row), (side, 0), ha=align, color=colour)
    for row in select(rows, device="tiles", subsampling=1.0):
        write_beside(axes, percent(float(row["tolerance"])), *position(row), (7, 4), color=BLUE)
    fit(axes, times, errors)
    axes.set_xlim(right=2.6 * max(times))
    axes.set_title(scene_title(rows[0]))
    axes.set_xlabel("processor time of a picture (s)")


def draw_error_time(rows: list[Row]) -> Figure:
    kept = [row for row in rows if float(row["subsampling"]) in (1.0, 0.5, 0.1)]
    scenes = values(kept, "scene")
    figure, charts = pyplot.subplots(1, len(scenes), figsize=(10, 4.4), sharey=True)
    for axes, scene in zip(charts, scenes, strict=True):
        draw_scene_settings(axes, select(kept, scene=scene))
    errors = numbers(kept, "image_rms_relative")
    charts[0].set_ylim(min(errors) / 1.6, max(errors) * 1.6)
    scale(charts[0].yaxis, round_ticks(*charts[0].get_ylim()), percent)
    charts[0].set_ylabel("error of the picture (relative RMS)")
    for device, tolerance, offset in (("tiles", 0.001, (-10, -6)), ("gl", 0.01, (-10, 0))):
        name, colour, _ = METHODS[device]
        row = select(kept, scene=scenes[0], device=device, tolerance=tolerance)[0]
        write_beside(charts[0], name, *position(row), offset, ha="right", color=colour, weight="bold")
    return figure


def draw_particle_count(rows: list[Row]) -> Figure:
    depths = values(rows, "depth")
    figure, charts = pyplot.subplots(1, len(depths), figsize=(10, 4.2), sharey=True)
    for axes, depth in zip(charts, depths, strict=True):
        here = select(rows, depth=depth)
        for device, (name, colour, marker) in METHODS.items():
            line = select(here, device=device)
            counts, errors = numbers(line, "particles"), numbers(line, "image_rms_relative")
            axes.plot(counts, errors, color=colour, marker=marker)
            write_beside(axes, name, counts[2], errors[2], (4, 12), color=colour, weight="bold")
        first = select(here, device="gl")[0]
        count, error = float(first["particles"]), float(first["image_rms_relative"])
        ends = [count, max(numbers(here, "particles"))]
        guide = [error * (n / count) ** (-1 / 3) for n in ends]
        axes.plot(ends, guide, color=GUIDE, linestyle=(0, (5, 3)), linewidth=1.2, zorder=1)
        write_beside(axes, "$N^{-1/3}$", ends[1], guide[1], (5, 3), color="#666666")
        fit(axes, numbers(here, "particles"), numbers(rows, "image_rms_relative"))
        axes.set_xlim(right=3.5 * ends[1])
        scale(axes.xaxis, round_ticks(*axes.get_xlim(), steps=(1,)), plain)
        axes.set_title(f"ball of optical depth {float(depth):g}")
        axes.set_xlabel("particles")
    charts[0].set_ylabel("error of the picture (relative RMS)")
    return figure


def spread(heights: Sequence[float], least: float) -> list[float]:
    """Heights moved up as little as needed for the least factor between neighbours."""
    moved = list(heights)
    order = sorted(range(len(heights)), key=lambda i: heights[i])
    for below, above in zip(order, order[1:], strict=False):
        moved[above] = max(moved[above], moved[below] * least)
    return moved


def draw_tolerance(rows: list[Row]) -> Figure:
    figure, axes = pyplot.subplots(figsize=(8, 5))
    scenes = values(rows, "scene")
    worst: dict[str, list[float]] = {}
    tolerances = sorted({float(value) for value in values(rows, "tolerance")})
    for scene in scenes:
        errors = [max(numbers(select(rows, scene=scene, tolerance=t), "image_rms_relative")) for t in tolerances]
        worst[scene] = errors
    fit(axes, tolerances, [*tolerances, *(error for errors in worst.values() for error in errors)], percent)
    axes.set_xlim(min(tolerances) / 1.3, max(tolerances) * 2.2)
    axes.plot(tolerances, tolerances, color=GUIDE, linestyle=(0, (5, 3)), linewidth=1.2, zorder=1)
    write_beside(axes, "measured = asked", tolerances[2], tolerances[2], (-6, 12), ha="right", color="#666666")
    heights = spread([worst[scene][-1] for scene in scenes], 1.24)
    colours = (BLUE, ORANGE, GREEN, PINK, SKY)
    for scene, height, colour, marker in zip(scenes, heights, colours, "osD^v", strict=True):
        axes.plot(tolerances, worst[scene], color=colour, marker=marker)
        count = int(select(rows, scene=scene)[0]["particles"])
        write_beside(axes, f"{scene} ({count:,})", tolerances[-1], height, (10, 0), color=colour)
    axes.set_xlabel("tolerance asked")
    axes.set_ylabel("error of the picture, worst of four lights")
    return figure


def draw_subsampling(rows: list[Row]) -> Figure:
    kept = select(rows, scene="plume", tolerance=0.01)
    figure, charts = pyplot.subplots(1, 2, figsize=(10, 4.2))
    shares = numbers(kept, "subsampling")
    contents = (
        ("image_rms_relative", "error of the picture (relative RMS)", {"tiles": (12, 0, -2), "gl": (0, 0, 20)}),
        ("processor_s", "processor time of a picture (s)", {"tiles": (0, -1, 12), "gl": (0, -1, 12)}),
    )
    for axes, (column, label, places) in zip(charts, contents, strict=True):
        for device, (name, colour, marker) in METHODS.items():
            line = sorted(select(kept, device=device), key=lambda row: -float(row["subsampling"]))
            axes.plot(numbers(line, "subsampling"), numbers(line, column), color=colour, marker=marker)
            right, end, up = places[device]
            place = float(line[end]["subsampling"]), float(line[end][column])
            align = "right" if end else "left"
            write_beside(axes, name, *place, (right, up), ha=align, color=colour, weight="bold")
        fit(axes, shares, numbers(kept, column), percent)
        axes.invert_xaxis()
        scale(axes.xaxis, sorted(set(shares)), percent)
        axes.set_title(label)
        axes.set_xlabel("share of the particles that cast shadows")
    low, high = charts[1].get_ylim()
    scale(charts[1].yaxis, round_ticks(low, high, steps=(1, 2, 3, 5)), plain)
    return figure


CHARTS = {
    "error_time": ("settings", draw_error_time),
    "particle_count": ("particle_count", draw_particle_count),
    "tolerance": ("tolerance", draw_tolerance),
    "subsampling": ("settings", draw_subsampling),
}


def draw_all(charts: Path, pictures: Path) -> list[Path]:
    """Writes every picture; returns their paths."""
    paths = []
    for name, (table, draw) in CHARTS.items():
        with pyplot.rc_context(STYLE):
            figure = draw(read(charts / f"{table}.csv"))
            path = pictures / f"chart_{name}.png"
            figure.tight_layout()
            figure.savefig(path, dpi=130, facecolor="white", metadata={"Software": None})
            pyplot.close(figure)
        paths.append(path)
    return paths
