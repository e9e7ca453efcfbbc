# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the chart of blur in docs/ACCURACY.md from the CSV file that blur_measure wrote."""

from __future__ import annotations

from pathlib import Path

from charts_draw import BLUE, ORANGE, STYLE, Row, fit, numbers, plain, pyplot, read, round_ticks, scale, select
from charts_draw import values, write_beside
from matplotlib.axes import Axes

METHODS = {"parts": ("smeared parts", BLUE, "o"), "sharp samples": ("sharp samples", ORANGE, "s")}


def draw_case(axes: Axes, rows: list[Row]) -> None:
    """Error against time; numbers are samples, the ring is what is chosen."""
    for method, (_, colour, marker) in METHODS.items():
        line = select(rows, method=method)
        axes.plot(numbers(line, "processor_s"), numbers(line, "error"), color=colour, marker=marker)
    parts = select(rows, method="parts")
    for row in parts[::2]:
        place = float(row["processor_s"]), float(row["error"])
        write_beside(axes, row["samples"], *place, (6, 6), color=BLUE)
    chosen = float(parts[0]["chosen"])
    ring = min((row for row in parts if float(row["samples"]) >= chosen), key=lambda row: float(row["samples"]))
    axes.plot(float(ring["processor_s"]), float(ring["error"]), "o", ms=13, mfc="none", mec=BLUE, mew=1.4)
    axes.axhline(0.01, color="#999999", linestyle=(0, (5, 3)), linewidth=1)


def draw(table: Path, picture: Path) -> None:
    rows = read(table)
    with pyplot.rc_context(STYLE):
        blurs, smokes = values(rows, "blur"), values(rows, "smoke")
        figure, charts = pyplot.subplots(len(blurs), len(smokes), figsize=(11, 6), sharex=True, sharey=True)
        for line, blur in zip(charts, blurs, strict=True):
            for axes, smoke in zip(line, smokes, strict=True):
                draw_case(axes, select(rows, blur=blur, smoke=smoke))
                axes.set_title(f"{blur}, {smoke}" + ("" if smoke == "behind an edge" else " smoke"))
                fit(axes, numbers(rows, "processor_s"), numbers(rows, "error"))
                scale(axes.xaxis, round_ticks(*axes.get_xlim(), steps=(1,)), plain)
        for axes in charts[-1]:
            axes.set_xlabel("processor time (s)")
        for axes in charts[:, 0]:
            axes.set_ylabel("error (relative RMS)")
        for number, (name, colour, _) in enumerate(METHODS.values()):
            charts[0][0].text(0.04, 0.06 + 0.09 * number, name, transform=charts[0][0].transAxes, color=colour, weight="bold")
        figure.tight_layout()
        figure.savefig(picture, dpi=130, facecolor="white", metadata={"Software": None})
        pyplot.close(figure)
