# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's evaluation on our scenes: `./run bench paper [--draw] [--quick]`.

Measures docs/charts/paper_*.csv and docs/pictures/paper_*.png with the benchmark program, draws
docs/pictures/chart_paper_*.png from them, and puts the tables into docs/PERFORMANCE.md. Prints the tables. Exits with 1
when a run failed; its file then stays as it was.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
TRIED = ROOT / "out" / "paper"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="./run bench paper", description="The paper's evaluation on our scenes.")
    parser.add_argument("--draw", action="store_true", help="only draw and print what was measured before")
    parser.add_argument("--quick", action="store_true", help="tiny sizes, into out/paper: whether everything works")
    options = parser.parse_args(arguments)
    import paper_draw
    import paper_measure
    import paper_tables

    folder = TRIED if options.quick else DOCS
    charts, pictures = folder / "charts", folder / "pictures"
    sizes = paper_measure.QUICK if options.quick else paper_measure.FULL
    failed = 0 if options.draw else paper_measure.measure_all(sizes, charts, pictures)
    for path in paper_draw.draw_all(charts, pictures):
        print(path.relative_to(ROOT), file=sys.stderr)
    for name, make in paper_tables.TABLES.items():
        print(f"{name}\n\n{make(charts)}\n")
    document = folder / "PERFORMANCE.md"
    if document.exists():
        document.write_text(paper_tables.fill(document.read_text(), charts))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
