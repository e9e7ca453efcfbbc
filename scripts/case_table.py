# SPDX-License-Identifier: GPL-3.0-or-later
"""Prints a table of cases, each with a figure and a bound: a JSON line each, {"case", "figure", "bound", "pass"}, or
Markdown for docs/ACCURACY.md."""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def main(command: str, description: str, module: str) -> int:
    """The cases are CASES of a module in tests/stability. Gives 1 when one misses its bound."""
    parser = argparse.ArgumentParser(prog=f"./run bench {command}", description=description)
    parser.add_argument("--markdown", action="store_true", help="print the table of docs/ACCURACY.md")
    markdown = parser.parse_args().markdown
    sys.path[:0] = [str(ROOT / "tests" / "stability"), str(ROOT / "blender_addon")]
    failed = 0
    if markdown:
        print("| case | figure | bound | |\n| --- | --- | --- | --- |")
    for case in importlib.import_module(module).CASES:
        figure = float(case.measure())
        passes = figure <= case.bound
        failed += not passes
        if markdown:
            verdict = "keeps it" if passes else "misses it"
            print(f"| {case.name} | {figure:.2g} | {case.bound:g} | {verdict} |", flush=True)
        else:
            print(json.dumps({"case": case.name, "figure": figure, "bound": case.bound, "pass": passes}), flush=True)
    return 1 if failed else 0
