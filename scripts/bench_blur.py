# SPDX-License-Identifier: GPL-3.0-or-later
"""The chart of motion blur and depth of field in docs/ACCURACY.md: `./run bench blur [--draw]`.

Measures docs/charts/blur.csv, then draws docs/pictures/chart_blur.png from it.
"""

from __future__ import annotations

import argparse
import sys

import blur_measure
from blur_draw import draw

PICTURE = blur_measure.ROOT / "docs" / "pictures" / "chart_blur.png"


def main() -> int:
    parser = argparse.ArgumentParser(prog="./run bench blur", description="Errors and times of blur.")
    parser.add_argument("--draw", action="store_true", help="only draw what was measured before")
    if not parser.parse_args().draw:
        blur_measure.measure_all()
    draw(blur_measure.FILE, PICTURE)
    print(PICTURE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
