# SPDX-License-Identifier: GPL-3.0-or-later
"""The Blenders that the add-on is tested in, and how to run them."""

from __future__ import annotations

import os
import subprocess
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
VERSIONS = ("3.4", "4.2", "4.5", "5.0")


@dataclass
class Run:
    """What a process did: exit code (None when it was killed for taking too long) and all it printed."""

    code: int | None
    output: str


@dataclass
class Blender:
    """3.4 is the `blender` program, the others are Python environments with the bpy module."""

    version: str

    @property
    def is_program(self) -> bool:
        return self.version == "3.4"

    @property
    def python(self) -> Path:
        return ROOT / "build" / "blenders" / self.version / "bin" / "python"

    def script_command(self, script: Path, *arguments: str) -> list[str]:
        """The command that runs a Python script inside this Blender, with factory settings."""
        if self.is_program:
            options = ["--background", "--factory-startup", "--python-exit-code", "1"]
            return ["blender", *options, "--python", str(script), "--", *arguments]
        return [str(self.python), str(script), "--", *arguments]

    def render_command(self, blend: Path, *options: str) -> list[str]:
        """The command that renders a file with Fumarole: options are `-f N`, or `-s N -e N -j N -a`, as Blender has them."""
        if self.is_program:
            start = ["blender", "--background", "--factory-startup", "--addons", "fumarole"]
            return [*start, str(blend), "-E", "FUMAROLE", *options]
        return [str(self.python), str(HERE / "render_file.py"), "--", str(blend), *options]


def environment(folder: Path, with_checkout: bool = True) -> dict[str, str]:
    """An environment with a fresh user folder in `folder`; the checkout's add-on can be enabled there, or is absent."""
    user = folder / "user"
    addons = user / "scripts" / "addons"
    addons.mkdir(parents=True, exist_ok=True)
    link = addons / "fumarole"
    if with_checkout and not link.exists():
        link.symlink_to(ROOT / "blender_addon" / "fumarole")
    settings = {"BLENDER_USER_RESOURCES": str(user), "BLENDER_USER_SCRIPTS": str(user / "scripts")}
    return {**os.environ, **settings, "PYTHONDONTWRITEBYTECODE": "1"}


def run(command: list[str], folder: Path, seconds: float = 120, with_checkout: bool = True) -> Run:
    """Runs a command to its end or time limit, in the environment() of `folder`."""
    surroundings = environment(folder, with_checkout)
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=surroundings, errors="replace", text=True
    )
    try:
        output, _ = process.communicate(timeout=seconds)
        return Run(process.returncode, output)
    except subprocess.TimeoutExpired:
        process.kill()
        output, _ = process.communicate()
        return Run(None, output + f"\nkilled after {seconds} s\n")
