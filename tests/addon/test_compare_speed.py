# SPDX-License-Identifier: GPL-3.0-or-later
"""A tiny run of `./run bench cycles`: everything in scripts/compare_speed.py works."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from blenders import ROOT, Blender, run

pytest.importorskip("matplotlib")  # Debian's Blender has the same Python


def test_tiny_comparison(blender: Blender, tmp_path: Path) -> None:
    if not blender.is_program:
        pytest.skip("is run in Blender 3.4 alone")
    (tmp_path / "PERFORMANCE.md").write_text("<!-- table cycles -->\nold\n<!-- end -->\n")
    tiny = ("--particles", "500", "--size", "32", "--samples", "2", "8", "--converged", "32", "--threads", "2")
    done = run(blender.script_command(ROOT / "scripts" / "compare_speed.py", *tiny, "--folder", str(tmp_path)), tmp_path)
    assert done.code == 0, done.output
    with (tmp_path / "charts" / "cycles.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["engine"], row["samples"] or row["tolerance"]) for row in rows] == [
        ("Cycles", "2"),
        ("Cycles", "8"),
        ("Cycles", "32"),
        ("Fumarole", "0.1"),
        ("Fumarole", "0.01"),
    ]
    errors = [float(row["error"]) for row in rows]
    assert errors[0] > errors[1] > errors[2] > 0 and 0 < errors[4] < 0.02
    text = (tmp_path / "PERFORMANCE.md").read_text()
    assert "extrapolated" in text and "\nold\n" not in text
    assert (tmp_path / "pictures" / "cycles_and_fumarole.png").read_bytes().startswith(b"\x89PNG")
