# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs every test, as many stages at once as there are cores, and closes with the line "N passed, N failed, N skipped".

    ./run test        C unit tests, Python tests without Blender, tests inside Blender 3.4
    ./run test all    also inside Blender 4.2, 4.5 and 5.0, and everything but Blender under the sanitizers

What a stage prints is shown when it ends. Exits with 1 when a test failed or a stage could not run.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build"
REPORTS = BUILD / "test_reports"
BLENDERS = BUILD / "blenders"
PYTHON = "/usr/bin/python3"
BPY_VERSIONS = {"4.2": "4.2.23", "4.5": "4.5.15", "5.0": "5.0.1"}
STAGE_LIMIT_S = 2400


@dataclass
class Counts:
    """Results of a stage, or of all."""

    passed: int = 0
    failed: int = 0
    skipped: int = 0

    def __str__(self) -> str:
        return f"{self.passed} passed, {self.failed} failed, {self.skipped} skipped"


@dataclass
class Stage:
    """One program that writes a JUnit report."""

    name: str
    command: list[str]
    report: Path
    environment: Mapping[str, str] = field(default_factory=dict)


@dataclass
class Outcome:
    """What a stage came to: its tests, how long it took, and what it printed."""

    counts: Counts
    seconds: float
    output: str


def read_report(path: Path) -> Counts:
    """Counts the test cases of a JUnit file; a missing or broken one raises OSError or ParseError."""
    counts = Counts()
    for case in ElementTree.parse(path).getroot().iter("testcase"):
        if case.find("failure") is not None or case.find("error") is not None:
            counts.failed += 1
        elif case.find("skipped") is not None or case.get("status") in ("notrun", "disabled"):
            counts.skipped += 1
        else:
            counts.passed += 1
    return counts


def ctest(preset: str) -> Stage:
    report = REPORTS / f"ctest_{preset}.xml"
    command = ["ctest", "--test-dir", str(BUILD / preset), "--output-on-failure", "--output-junit", str(report)]
    return Stage(f"C unit tests, {preset} build", [*command, "--timeout", "600"], report)


def pytest(name: str, folder: str, *options: str, environment: Mapping[str, str] | None = None) -> Stage:
    report = REPORTS / ("_".join([folder, *name.split()]).replace(",", "") + ".xml")
    cache = f"cache_dir={BUILD / 'pytest_cache' / report.stem}"
    command = [PYTHON, "-m", "pytest", "-q", "-ra", "-o", cache, f"--junitxml={report}", f"tests/{folder}", *options]
    return Stage(name, command, report, environment or {})


def blender_environment(version: str) -> list[list[str]]:
    """Commands that make the virtual environment with Blender `version`; none when it is complete."""
    folder = BLENDERS / version
    release = BPY_VERSIONS[version]
    wanted = (f"bpy-{release}.dist-info/RECORD", "pytest-*.dist-info/RECORD")
    if all(list(folder.glob(f"lib/python*/site-packages/{name}")) for name in wanted):
        return []
    install = [str(folder / "bin" / "python"), "-m", "pip", "install", "--quiet", f"bpy=={release}", "pytest"]
    return [[PYTHON, "-m", "venv", str(folder)], install]


def sanitizer_stages() -> list[Stage]:
    """Unit tests and the Python core in the sanitizer build. Python itself leaks, so leaks are left to the unit tests."""
    # libstdc++ as well: the sanitizer looks up the C++ exception functions when it starts.
    libraries = [
        subprocess.run(["gcc", f"-print-file-name={name}"], capture_output=True, text=True, check=True).stdout.strip()
        for name in ("libasan.so", "libstdc++.so.6")
    ]
    environment = {
        "LD_PRELOAD": " ".join(libraries),
        "ASAN_OPTIONS": "detect_leaks=0",
        "FUMAROLE_LIBRARY": str(BUILD / "sanitize" / "libfumarole.so"),
    }
    # Packages and the benchmark program are those of the release build.
    released = [f"--ignore=tests/core/test_{name}.py" for name in ("package", "bench", "charts", "paper", "guard")]
    return [pytest("Python core, sanitize build", "core", *released, environment=environment), ctest("sanitize")]


def preparations(everything: bool) -> list[list[str]]:
    """Commands that must succeed before any stage."""
    if not everything:
        return []
    environments = [command for version in BPY_VERSIONS for command in blender_environment(version)]
    return [*environments, ["cmake", "--preset", "sanitize"], ["cmake", "--build", "--preset", "sanitize"]]


def stages(everything: bool) -> list[Stage]:
    """Those that take longest first, so that no core waits for them at the end."""
    versions = ["3.4", *BPY_VERSIONS] if everything else ["3.4"]
    return [
        *(sanitizer_stages() if everything else []),
        *(pytest(f"Blender {version}", "addon", "--blender", version) for version in versions),
        pytest("Stability", "stability"),
        pytest("Python core", "core"),
        ctest("release"),
    ]


def run(command: Sequence[str], environment: Mapping[str, str] | None = None) -> tuple[bool, str]:
    """Whether the command ended in time with exit code 0, and what it printed."""
    # Threads that wait by spinning take the core that other stages run on. The add-on sets it, too.
    surroundings = os.environ | {"OMP_WAIT_POLICY": "passive"} | (environment or {})
    try:
        done = subprocess.run(
            command,
            cwd=ROOT,
            env=surroundings,
            timeout=STAGE_LIMIT_S,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
        )
    except subprocess.TimeoutExpired as late:
        printed = (late.stdout or b"").decode(errors="replace")
        return False, f"{printed}\nstopped after {STAGE_LIMIT_S} s: {' '.join(command)}\n"
    except OSError as error:
        return False, f"could not run {command[0]}: {error}\n"
    return done.returncode == 0, done.stdout


def run_stage(stage: Stage) -> Outcome:
    """Runs one stage. What failed without a failed test in the report counts as one failure."""
    start = time.monotonic()
    stage.report.unlink(missing_ok=True)
    succeeded, output = run(stage.command, stage.environment)
    try:
        counts = read_report(stage.report)
    except (OSError, ElementTree.ParseError):
        counts = Counts()
        succeeded = False
    if not succeeded and counts.failed == 0:
        output += f"{stage.name}: the stage failed outside its tests\n"
        counts.failed = 1
    return Outcome(counts, time.monotonic() - start, output)


def main() -> int:
    parser = argparse.ArgumentParser(prog="./run test", description="Runs every test.")
    parser.add_argument("scope", nargs="?", choices=["all"], help="also the other Blenders and the sanitizers")
    everything = parser.parse_args().scope == "all"
    REPORTS.mkdir(parents=True, exist_ok=True)
    for command in preparations(everything):
        print("Preparing:", " ".join(command), flush=True)
        succeeded, output = run(command)
        if not succeeded:
            print(output)
            return 1
    total = Counts()
    summary = []
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        running = {pool.submit(run_stage, stage): stage for stage in stages(everything)}
        for future in as_completed(running):
            stage, outcome = running[future], future.result()
            print(f"\n== {stage.name}\n{outcome.output}", flush=True)
            summary.append(f"{outcome.seconds:7.1f} s  {stage.name}: {outcome.counts}")
            total.passed += outcome.counts.passed
            total.failed += outcome.counts.failed
            total.skipped += outcome.counts.skipped
    print("\n".join(summary))
    print(total)
    return 1 if total.failed else 0


if __name__ == "__main__":
    sys.exit(main())
