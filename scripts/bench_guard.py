# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether the library does more work than it did: `./run bench guard [--keep]`.

Times depend on what else runs; numbers of instructions don't. Three small renders run on one thread in valgrind's
callgrind, which counts the instructions inside fum_render. They are compared with those that tests/guard.json keeps; a
difference of more than 3 % either way is named, with the functions that it comes from, and the exit code is 1. After a
change that is meant, `--keep` writes the file.

Prints a JSON line for each workload: {"workload", "instructions", "kept", "change", "pass"}. Counts depend on the
compiler, the C library and the instruction set that valgrind shows to programs (AVX2 where the processor has it, never
AVX-512); all three are kept beside them.
"""

from __future__ import annotations

import argparse
import json
import platform
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
KEPT = ROOT / "tests" / "guard.json"
BENCH = ROOT / "build" / "release" / "fumarole-bench"

LIMIT = 0.03
TOP = 12  # functions that are listed of a workload that differs
SMALL = 0.001  # share of a workload below which functions aren't kept
# Valgrind takes about a minute for all: it is slow at fused multiplication and addition.
WORKLOADS = {
    "light at 10,000 particles": "lighting --particles 10000 --sample 0",
    "plume of 5,000 particles in tiles": "frame --particles 5000 --device tiles --width 192 --height 108",
    "ball under two lights": "frame --scene ball --lights 2 --device tiles --width 96 --height 96",
}

# 12,066,781 ( 2.00%)  file:function [object]
FUNCTION_LINE = re.compile(r"^\s*([\d,]+) \([\d. ]+%\)\s+(?:\S+?:)?(\S+?)(?:'\d+)?(?: \[.*\])?$")


@dataclass
class Count:
    """Instructions of a workload, in all and by function."""

    instructions: int
    functions: dict[str, int]


@dataclass
class Verdict:
    """A workload held against what was kept; without anything kept it doesn't pass."""

    workload: str
    instructions: int
    kept: int | None
    change: float | None

    @property
    def passes(self) -> bool:
        return self.change is not None and abs(self.change) <= LIMIT + 1e-9

    def line(self) -> str:
        rounded = None if self.change is None else round(self.change, 5)
        return json.dumps(asdict(self) | {"change": rounded, "pass": self.passes})


def read_functions(annotated: str) -> Count:
    """What callgrind_annotate printed. Functions of the same name count as one, so do the levels of a recursion."""
    total, functions = 0, {}
    for line in annotated.splitlines():
        match = FUNCTION_LINE.match(line)
        if "PROGRAM TOTALS" in line:
            total = int(line.split()[0].replace(",", ""))
        elif match:
            instructions, name = int(match[1].replace(",", "")), match[2]
            functions[name] = functions.get(name, 0) + instructions
    if total == 0:
        raise ValueError("callgrind_annotate printed no total")
    return Count(total, {name: n for name, n in functions.items() if n >= SMALL * total})


def count(options: str, folder: Path) -> Count:
    """Runs a workload. Raises RuntimeError with what failed."""
    out = folder / "callgrind.out"
    valgrind = ["valgrind", "--tool=callgrind", "--toggle-collect=fum_render", f"--callgrind-out-file={out}"]
    run_tool([*valgrind, str(BENCH), *shlex.split(options), "--threads", "1"])
    return read_functions(run_tool(["callgrind_annotate", "--threshold=99.9", "--auto=no", str(out)]))


def run_tool(command: list[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(f"{shlex.join(command)}\nexit code {done.returncode}: {done.stderr.strip()}")
    return done.stdout


def conditions() -> dict[str, str]:
    """What counts depend on besides the source."""
    comment = run_tool(["readelf", "-p", ".comment", str(BENCH.parent / "libfumarole.so")])
    compiler = re.search(r"\]\s+(.*)", comment)
    flags = Path("/proc/cpuinfo").read_text().partition("flags")[2].partition("\n")[0].split()
    return {
        "compiler": compiler[1].strip() if compiler else "unknown",
        "c_library": " ".join(platform.libc_ver()),
        "instruction_set": "AVX2" if {"avx2", "fma"} <= set(flags) else "plain",
    }


def compare(workload: str, found: Count, kept: Mapping[str, object] | None) -> Verdict:
    if kept is None:
        return Verdict(workload, found.instructions, None, None)
    before = int(kept["instructions"])
    return Verdict(workload, found.instructions, before, found.instructions / before - 1.0)


def changed_functions(found: Mapping[str, int], kept: Mapping[str, int]) -> list[tuple[str, int, int]]:
    """The functions that changed most: name, instructions now and before. Those below a thousandth count as 0."""
    names = dict.fromkeys([*found, *kept])
    rows = [(name, found.get(name, 0), kept.get(name, 0)) for name in names]
    rows.sort(key=lambda row: -abs(row[1] - row[2]))
    return [row for row in rows[:TOP] if row[1] != row[2]]


def explain(verdict: Verdict, found: Count, kept: Mapping[str, object]) -> str:
    """What a difference comes from, as a table in text."""
    word = "more" if verdict.change > 0 else "fewer"
    lines = [f"{verdict.workload}: {100 * abs(verdict.change):.1f} % {word} instructions; by function, now and before:"]
    for name, now, before in changed_functions(found.functions, kept["functions"]):
        lines.append(f"  {now - before:+15,} {now:15,} {before:15,}  {name}")
    return "\n".join(lines)


def read_kept() -> dict:
    return json.loads(KEPT.read_text()) if KEPT.exists() else {"conditions": {}, "workloads": {}}


def differences(here: Mapping[str, str], kept: Mapping[str, str]) -> list[str]:
    """Sentences on what else may make counts differ."""
    return [
        f"kept with {name.replace('_', ' ')} {kept[name]}, here {value}: counts may differ for that"
        for name, value in here.items()
        if name in kept and kept[name] != value
    ]


def check(found: Mapping[str, Count], kept: Mapping[str, Mapping]) -> int:
    """Prints the verdicts. Returns how many don't pass."""
    failed = 0
    for workload, counted in found.items():
        before = kept.get(workload)
        verdict = compare(workload, counted, before)
        print(verdict.line(), flush=True)
        if before is None:
            print(f"{workload}: nothing is kept; ./run bench guard --keep keeps it", file=sys.stderr)
        elif not verdict.passes:
            print(explain(verdict, counted, before), file=sys.stderr)
        failed += not verdict.passes
    return failed


def main() -> int:
    parser = argparse.ArgumentParser(prog="./run bench guard", description="Whether the library does more work than it did.")
    parser.add_argument("--keep", action="store_true", help="write tests/guard.json instead of comparing with it")
    keep = parser.parse_args().keep
    try:
        here = conditions()
        with tempfile.TemporaryDirectory() as folder:
            found = {workload: count(options, Path(folder)) for workload, options in WORKLOADS.items()}
    except (RuntimeError, OSError, ValueError) as error:
        print(f"bench guard: {error}", file=sys.stderr)
        return 1
    kept = read_kept()
    if keep:
        workloads = {workload: asdict(counted) for workload, counted in found.items()}
        KEPT.write_text(json.dumps({"conditions": here, "workloads": workloads}, indent=1) + "\n")
        kept = read_kept()
    for sentence in differences(here, kept["conditions"]):
        print(f"bench guard: {sentence}", file=sys.stderr)
    return 1 if check(found, kept["workloads"]) else 0


if __name__ == "__main__":
    sys.exit(main())
