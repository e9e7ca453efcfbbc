# SPDX-License-Identifier: GPL-3.0-or-later
"""The stability cases as a benchmark: `./run bench stability [--markdown]`.

Prints a JSON line each, {"case", "figure", "bound", "pass"}, or the table of docs/ACCURACY.md. Exits with 1 when a case
misses its bound.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "tests" / "stability"), str(ROOT / "blender_addon")]


def main() -> int:
    parser = argparse.ArgumentParser(prog="./run bench stability", description="Where methods fail.")
    parser.add_argument("--markdown", action="store_true", help="print the table of docs/ACCURACY.md")
    markdown = parser.parse_args().markdown
    from cases import CASES

    failed = 0
    if markdown:
        print("| case | figure | bound | |\n| --- | --- | --- | --- |")
    for case in CASES:
        figure = case.measure()
        passes = figure <= case.bound
        failed += not passes
        if markdown:
            verdict = "keeps it" if passes else "misses it"
            print(f"| {case.name} | {figure:.2g} | {case.bound:g} | {verdict} |", flush=True)
        else:
            print(json.dumps({"case": case.name, "figure": float(figure), "bound": case.bound, "pass": bool(passes)}), flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
