# SPDX-License-Identifier: GPL-3.0-or-later
"""The charts of docs/ACCURACY.md: `./run bench charts [--draw]`.

Measures docs/charts/*.csv with the benchmark program, then draws docs/pictures/chart_*.png from them. Exits with 1 when a
run failed; its file then stays as it was.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import charts_measure

PICTURES = Path(__file__).resolve().parent.parent / "docs" / "pictures"


def main() -> int:
    parser = argparse.ArgumentParser(prog="./run bench charts", description="The charts of docs/ACCURACY.md.")
    parser.add_argument("--draw", action="store_true", help="only draw what was measured before")
    failed = 0 if parser.parse_args().draw else charts_measure.measure_all()
    from charts_draw import draw_all

    for path in draw_all(charts_measure.CHARTS, PICTURES):
        print(path)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
