# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs every test, one stage after another, and closes with the line "N passed, N failed, N skipped".

    ./run test        C unit tests, Python tests without Blender, tests inside Blender 3.4
    ./run test all    also inside Blender 4.2, 4.5 and 5.0, and everything but Blender under the sanitizers

Exits with 1 when a test failed or a stage could not run.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build"
REPORTS = BUILD / "test_reports"
BLENDERS = BUILD / "blenders"
PYTHON = "/usr/bin/python3"
BPY_VERSIONS = {"4.2": "4.2.23", "4.5": "4.5.15", "5.0": "5.0.1"}
STAGE_LIMIT_S = 1200


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
    """One program that writes a JUnit report. `prepare` are commands that must succeed first."""

    name: str
    command: list[str]
    report: Path
    environment: Mapping[str, str] = field(default_factory=dict)
    prepare: Sequence[list[str]] = ()


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


def ctest(preset: str, prepare: Sequence[list[str]] = ()) -> Stage:
    report = REPORTS / f"ctest_{preset}.xml"
    command = ["ctest", "--test-dir", str(BUILD / preset), "--output-on-failure", "--output-junit", str(report)]
    return Stage(f"C unit tests, {preset} build", [*command, "--timeout", "300"], report, prepare=prepare)


def pytest(name: str, folder: str, *options: str, environment: Mapping[str, str] | None = None) -> Stage:
    report = REPORTS / ("_".join([folder, *name.split()]).replace(",", "") + ".xml")
    cache = f"cache_dir={BUILD / 'pytest_cache'}"
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
    build = [["cmake", "--preset", "sanitize"], ["cmake", "--build", "--preset", "sanitize"]]
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
    # The package is made of the release build alone.
    core = pytest("Python core, sanitize build", "core", "--ignore=tests/core/test_package.py", environment=environment)
    return [ctest("sanitize", build), core]


def stages(everything: bool) -> list[Stage]:
    listed = [
        ctest("release"),
        pytest("Python core", "core"),
        pytest("Stability", "stability"),
        pytest("Blender 3.4", "addon", "--blender", "3.4"),
    ]
    if everything:
        for version in BPY_VERSIONS:
            stage = pytest(f"Blender {version}", "addon", "--blender", version)
            stage.prepare = blender_environment(version)
            listed.append(stage)
        # The tests of the core look into the 5.0 environment, hence before them.
        listed[0].prepare = blender_environment("5.0")
        listed += sanitizer_stages()
    return listed


def run(command: Sequence[str], environment: Mapping[str, str] | None = None) -> bool:
    """True when the command ended in time with exit code 0. Its output is passed on."""
    try:
        done = subprocess.run(command, cwd=ROOT, env=os.environ | (environment or {}), timeout=STAGE_LIMIT_S)
    except subprocess.TimeoutExpired:
        print(f"stopped after {STAGE_LIMIT_S} s: {' '.join(command)}", file=sys.stderr)
        return False
    except OSError as error:
        print(f"could not run {command[0]}: {error}", file=sys.stderr)
        return False
    return done.returncode == 0


def run_stage(stage: Stage) -> Counts:
    """Runs one stage. What failed without a failed test in the report counts as one failure."""
    stage.report.unlink(missing_ok=True)
    succeeded = all(run(command) for command in stage.prepare) and run(stage.command, stage.environment)
    try:
        counts = read_report(stage.report)
    except (OSError, ElementTree.ParseError):
        counts = Counts()
        succeeded = False
    if not succeeded and counts.failed == 0:
        print(f"{stage.name}: the stage failed outside its tests", file=sys.stderr)
        counts.failed = 1
    return counts


def main() -> int:
    parser = argparse.ArgumentParser(prog="./run test", description="Runs every test.")
    parser.add_argument("scope", nargs="?", choices=["all"], help="also the other Blenders and the sanitizers")
    everything = parser.parse_args().scope == "all"
    REPORTS.mkdir(parents=True, exist_ok=True)
    total = Counts()
    summary = []
    for stage in stages(everything):
        print(f"\n== {stage.name}", flush=True)
        start = time.monotonic()
        counts = run_stage(stage)
        summary.append(f"{time.monotonic() - start:7.1f} s  {stage.name}: {counts}")
        total.passed += counts.passed
        total.failed += counts.failed
        total.skipped += counts.skipped
    print("\n" + "\n".join(summary))
    print(total)
    return 1 if total.failed else 0


if __name__ == "__main__":
    sys.exit(main())
