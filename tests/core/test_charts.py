# SPDX-License-Identifier: GPL-3.0-or-later
"""The charts of docs/ACCURACY.md: what they are drawn from is complete, and they draw."""

from __future__ import annotations

import csv
from pathlib import Path

import charts_measure
import pytest

DOCS = Path(__file__).resolve().parent.parent.parent / "docs"


def rows(table: str) -> list[dict[str, str]]:
    with (charts_measure.CHARTS / f"{table}.csv").open(newline="") as file:
        reader = csv.DictReader(file)
        assert tuple(reader.fieldnames or ()) == charts_measure.COLUMNS
        return list(reader)


@pytest.mark.parametrize("table", charts_measure.tables())
def test_files_hold_a_row_for_each_setting(table: str) -> None:
    expected = 0
    for run in charts_measure.tables()[table]:
        expected += (1 if "--light" in run else 4) * (1 + run.count("--then"))
    found = rows(table)
    assert len(found) == expected
    words = ("scene", "light", "device")
    for row in found:
        assert all(row[name].isalpha() for name in words)
        measured = {name: float(row[name]) for name in charts_measure.COLUMNS if name not in words}
        assert 0 < measured["image_rms_relative"] < 2 and min(measured["total_s"], measured["processor_s"]) > 0
        assert measured["reference_error"] < 0.1 * measured["image_rms_relative"]


def test_a_run_that_fails_is_named_and_leaves_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    wrong = ["image", "--scene", "fog", "--then"]
    small = ["image", "--scene", "puff", "--light", "side", "--width", "8", "--height", "8"]
    monkeypatch.setattr(charts_measure, "CHARTS", tmp_path)
    monkeypatch.setattr(charts_measure, "tables", lambda: {"wrong": [small, wrong], "right": [small]})
    (tmp_path / "wrong.csv").write_text("as it was")
    assert charts_measure.measure_all() == 1
    assert (tmp_path / "wrong.csv").read_text() == "as it was"
    assert len(rows("right")) == 1
    said = capfd.readouterr().err
    assert "wrong.csv" in said and "./run bench image --scene fog --then" in said and "no scene fog" in said


def test_charts_are_drawn_and_shown(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    import charts_draw

    text = (DOCS / "ACCURACY.md").read_text()
    for path in charts_draw.draw_all(charts_measure.CHARTS, tmp_path):
        assert path.read_bytes().startswith(b"\x89PNG") and path.stat().st_size < 200_000
        assert f"(pictures/{path.name})" in text and (DOCS / "pictures" / path.name).stat().st_size < 200_000


def test_front_keeps_what_nothing_beats() -> None:
    pytest.importorskip("matplotlib")
    import charts_draw

    assert charts_draw.front([(3, 1), (1, 5), (2, 6), (2, 2), (4, 1)]) == [(1, 5), (2, 2), (3, 1)]
