# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of the add-on in a real Blender: `python3 -m pytest tests/addon --blender 4.5`.

The files in inside/ are ordinary pytest files that run inside Blender, one process a file; each test there is a test
here. A process that crashes or hangs fails the test it was in, with what it printed. The other files run outside and
start processes of their own.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from blenders import HERE, VERSIONS, Blender, run  # noqa: E402

INSIDE = HERE / "inside"
SECONDS_A_FILE = 240


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--blender", choices=VERSIONS, default=VERSIONS[0], help="version of Blender to test in")


@pytest.fixture(scope="session")
def blender(request: pytest.FixtureRequest) -> Blender:
    return Blender(request.config.getoption("--blender"))


def pytest_report_header(config: pytest.Config) -> str:
    return f"blender: {config.getoption('--blender')}"


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    return InsideFile.from_parent(parent, path=module_path) if module_path.parent == INSIDE else None


class InsideFile(pytest.File):
    """A test file that was run inside Blender; its items hold the results."""

    def collect(self) -> Iterator[pytest.Item]:
        if self.config.option.collectonly:
            return
        blender = Blender(self.config.getoption("--blender"))
        with tempfile.TemporaryDirectory(prefix="fumarole-") as folder:
            report = Path(folder) / "report.jsonl"
            selection = ["-k", self.config.option.keyword] if self.config.option.keyword else []
            arguments = [str(report), str(self.path), *selection]
            done = run(blender.script_command(HERE / "run_inside.py", *arguments), Path(folder), SECONDS_A_FILE)
            lines = report.read_text().splitlines() if report.exists() else []
        events = [json.loads(line) for line in lines]
        results = {event["test"]: event for event in events if "outcome" in event}
        for event in results.values():
            yield InsideItem.from_parent(self, name=event["test"], outcome=event["outcome"], text=event["text"])
        unfinished = [event["test"] for event in events if event["test"] and event["test"] not in results]
        if unfinished or done.code not in (0, 1, 5) or not any("end" in event for event in events):
            name = unfinished[0] if unfinished else "process"
            text = f"Blender {blender.version} ended with exit code {done.code}:\n{done.output[-8000:]}"
            yield InsideItem.from_parent(self, name=name, outcome="failed", text=text)


class InsideItem(pytest.Item):
    """A test that ran inside Blender."""

    def __init__(self, outcome: str, text: str, **keywords: object) -> None:
        super().__init__(**keywords)
        self.outcome = outcome
        self.text = text

    def runtest(self) -> None:
        if self.outcome == "skipped":
            pytest.skip(self.text)
        if self.outcome == "failed":
            pytest.fail(self.text, pytrace=False)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        return self.path, None, self.name
