# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs a pytest file inside Blender: -- REPORT FILE [pytest options]. Writes a JSON line as a test starts and ends."""

from __future__ import annotations

import json
import os
import sys
import traceback
from pathlib import Path
from typing import IO

HERE = Path(__file__).resolve().parent


class Recorder:
    """The pytest plugin that writes the lines."""

    def __init__(self, file: IO[str]) -> None:
        self.file = file

    def write(self, **event: object) -> None:
        self.file.write(json.dumps(event) + "\n")
        self.file.flush()

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self.write(test=short(nodeid))

    def pytest_runtest_logreport(self, report) -> None:
        if report.when == "call" or report.outcome != "passed":
            text = str(report.longrepr[2]) if report.skipped else report.longreprtext
            text += "".join(f"\n----- {title}\n{content}" for title, content in report.sections if report.failed)
            self.write(test=short(report.nodeid), outcome=report.outcome, text=text)

    def pytest_collectreport(self, report) -> None:
        if report.failed:
            self.write(test="collection", outcome="failed", text=report.longreprtext)


def short(nodeid: str) -> str:
    return nodeid.split("::", 1)[-1]


def main() -> int:
    import bpy  # noqa: F401  (first: where bpy is a module, it brings addon_utils with it)
    import addon_utils
    import pytest

    report, file, *options = sys.argv[sys.argv.index("--") + 1 :]
    sys.path[:0] = [str(HERE.parents[1] / "blender_addon"), str(HERE / "inside"), str(HERE)]
    with open(report, "w") as lines:
        recorder = Recorder(lines)
        if addon_utils.enable("fumarole", default_set=True) is None:
            recorder.write(test="enable", outcome="failed", text="the add-on could not be enabled")
            return 1
        folder = Path(report).parent / "pytest"
        plugins = ["-p", "no:cacheprovider", "-p", "blender_fixtures"]
        places = ["-c", os.devnull, f"--rootdir={HERE}", f"--confcutdir={HERE / 'inside'}", f"--basetemp={folder}"]
        code = int(pytest.main([file, "-q", *plugins, *places, *options], [recorder]))
        recorder.write(test="", end=True)
    return code


try:
    status = main()
except BaseException:
    traceback.print_exc()
    status = 3
sys.stdout.flush()
sys.stderr.flush()
os._exit(status)  # bpy 4.5 may hang in its exit handlers
