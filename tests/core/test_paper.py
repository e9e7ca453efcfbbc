# SPDX-License-Identifier: GPL-3.0-or-later
"""The charts and tables of docs/PERFORMANCE.md: they are made, complete, and those of the document are current."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

pytest.importorskip("matplotlib")

import bench_paper  # noqa: E402
import numpy as np  # noqa: E402
import paper_draw  # noqa: E402
import paper_measure  # noqa: E402
import paper_pictures  # noqa: E402
import paper_tables  # noqa: E402

DOCS = Path(__file__).resolve().parent.parent.parent / "docs"
LIMIT = 1_000_000  # bytes of a picture


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_tiny_sizes_make_everything(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench_paper, "TRIED", tmp_path)
    monkeypatch.setattr(bench_paper, "ROOT", tmp_path)
    (tmp_path / "PERFORMANCE.md").write_text("Before\n<!-- table plume -->\nold\n<!-- end -->\nafter\n")
    assert bench_paper.main(["--quick"]) == 0
    for name, (columns, runs) in paper_measure.tables(paper_measure.QUICK).items():
        found = rows(tmp_path / "charts" / f"paper_{name}.csv")
        assert len(found) == len(runs) and tuple(found[0]) == tuple(columns)
        for row in found:
            assert 0 < float(row["accuracy_rms"]) < 0.02 and float(row["light_s"]) >= 0
    shares = rows(tmp_path / "charts" / "paper_subsampling.csv")
    changes = [float(row["picture_change"]) for row in shares[:3]]
    assert changes[0] == 0 < changes[1] < changes[2]
    for picture in ("chart_paper_lighting", "paper_subsampling", "paper_density", "paper_drawn_size", "paper_plume"):
        assert (tmp_path / "pictures" / f"{picture}.png").read_bytes().startswith(b"\x89PNG")
    text = (tmp_path / "PERFORMANCE.md").read_text()
    assert text.startswith("Before") and text.endswith("after\n") and "old" not in text and "| 3,000 |" in text
    assert "| 10.4 | 17.8 |" in capsys.readouterr().out


def test_a_run_that_fails_is_named_and_leaves_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    wrong = paper_measure.run("lighting", "--solver", "guess")
    right = paper_measure.run("lighting", "--particles", 100)
    tables = {"wrong": (paper_measure.LIGHTING, [right, wrong]), "right": (paper_measure.LIGHTING, [right])}
    monkeypatch.setattr(paper_measure, "tables", lambda sizes: tables)
    (tmp_path / "paper_wrong.csv").write_text("as it was")
    assert paper_measure.measure_all(paper_measure.QUICK, tmp_path, tmp_path) == 1
    assert (tmp_path / "paper_wrong.csv").read_text() == "as it was"
    assert len(rows(tmp_path / "paper_right.csv")) == 1
    said = capfd.readouterr().err
    assert "paper_wrong.csv" in said and "--solver guess" in said


def test_the_document_shows_what_was_measured() -> None:
    text = (DOCS / "PERFORMANCE.md").read_text()
    assert paper_tables.fill(text, DOCS / "charts") == text
    for name in (*paper_tables.TABLES, "cycles", "cycles_match"):
        assert f"<!-- table {name} -->\n|" in text
    sheets = [f"paper_{name}" for name in paper_measure.TITLES]
    for name in ["cycles_and_fumarole", *sheets, *(f"chart_paper_{name}" for name in paper_draw.CHARTS)]:
        assert f"(pictures/{name}.png)" in text
        assert (DOCS / "pictures" / f"{name}.png").stat().st_size < LIMIT


def test_growth_is_the_slope_of_the_logarithms() -> None:
    assert paper_draw.exponent([1, 2, 4], [3, 6, 12]) == pytest.approx(1)
    assert paper_draw.exponent([512, 1024, 2048], [1, 4, 16]) == pytest.approx(2)


def test_sheets_show_pictures_under_one_exposure(tmp_path: Path) -> None:
    from matplotlib import pyplot

    dark, bright = np.full((8, 10, 4), 0.25), np.full((8, 10, 4), 1.0)
    paper_pictures.write_sheet(tmp_path / "sheet.png", {"a": bright, "b": dark}, white=1.0)
    sheet = pyplot.imread(tmp_path / "sheet.png")[..., :3]
    assert sheet.shape[1] == 2 * 10 + paper_pictures.GAP
    assert sheet[-4, 4].min() > 0.98 and 0.45 < sheet[-4, -5].max() < 0.6
