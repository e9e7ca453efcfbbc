# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole runs of Blender: from a file to pictures and an exit code."""

from __future__ import annotations

import signal
import subprocess
import time
from pathlib import Path

import pytest
from blenders import HERE, ROOT, Blender, Run, environment, run
from exr import read_exr


def make_blend(blender: Blender, folder: Path, camera: str = "PERSP", shutter: float = 0.0) -> Path:
    blend = folder / "smoke.blend"
    arguments = [str(blend), f"{folder}/####", camera, str(shutter)]
    done = run(blender.script_command(HERE / "make_blend.py", *arguments), folder)
    assert done.code == 0 and blend.exists(), done.output
    return blend


def render(blender: Blender, folder: Path, *options: str, camera: str = "PERSP") -> Run:
    return run(blender.render_command(make_blend(blender, folder, camera), *options), folder)


def pictures(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.glob("*.exr"))


def test_one_frame(blender: Blender, tmp_path: Path) -> None:
    done = render(blender, tmp_path, "-f", "5")
    assert done.code == 0, done.output
    assert pictures(tmp_path) == ["0005.exr"]
    assert read_exr(tmp_path / "0005.exr")["ViewLayer.Combined.A"].max() > 0.5


@pytest.mark.parametrize("shutter", [0.0, 1.0])
def test_animation_moves_and_equals_single_frames(blender: Blender, tmp_path: Path, shutter: float) -> None:
    """With motion blur too, whose samples go to times beside each frame."""
    blend = make_blend(blender, tmp_path, shutter=shutter)
    done = run(blender.render_command(blend, "-s", "4", "-e", "6", "-a"), tmp_path)
    assert done.code == 0, done.output
    assert pictures(tmp_path) == ["0004.exr", "0005.exr", "0006.exr"]
    alphas = {name: read_exr(tmp_path / name)["ViewLayer.Combined.A"] for name in pictures(tmp_path)}
    assert (alphas["0004.exr"] != alphas["0006.exr"]).any()
    done = run(blender.render_command(blend, "-f", "6"), tmp_path)
    assert done.code == 0, done.output
    assert (read_exr(tmp_path / "0006.exr")["ViewLayer.Combined.A"] == alphas["0006.exr"]).all()


@pytest.mark.parametrize("options", [("-f", "5"), ("-s", "4", "-e", "6", "-a")])
def test_error_of_the_engine_is_exit_code_1(blender: Blender, tmp_path: Path, options: tuple[str, ...]) -> None:
    done = render(blender, tmp_path, *options, camera="PANO")
    assert done.code == 1, done.output
    assert done.output.count("'Camera' is of type PANO") >= 1
    assert pictures(tmp_path) == []


def test_no_camera(blender: Blender, tmp_path: Path) -> None:
    done = render(blender, tmp_path, "-f", "5", camera="NONE")
    assert "no camera" in done.output.lower()
    assert pictures(tmp_path) == []


def test_interrupt_stops_the_render(blender: Blender, tmp_path: Path) -> None:
    command = blender.script_command(HERE / "cancel_render.py", f"{tmp_path}/cancelled.exr")
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment(tmp_path)
    )
    output = ""
    try:
        for line in process.stdout:
            output += line
            if "RENDER STARTS" in line:
                break
        time.sleep(1.5)
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=60)
        output += rest
    except subprocess.TimeoutExpired:
        process.kill()
        pytest.fail(f"still running after the interrupt:\n{output}{process.communicate()[0]}")
    assert "OUTCOME" in output
    assert pictures(tmp_path) == [], output


def test_package_installs_and_renders(blender: Blender, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    import package

    monkeypatch.setattr(package, "PACKAGE", tmp_path / "package")
    archive = package.make_package()
    monkeypatch.delenv("FUMAROLE_LIBRARY", raising=False)
    command = blender.script_command(HERE / "install_package.py", str(archive), f"{tmp_path}/picture.exr")
    done = run(command, tmp_path, with_checkout=False)
    assert done.code == 0, done.output
    for word in ("INSTALLED", "LIBRARY"):
        (line,) = [line for line in done.output.splitlines() if line.startswith(word)]
        assert str(tmp_path) in line, line
    alpha = read_exr(tmp_path / "picture.exr")["ViewLayer.Combined.A"]
    assert alpha.max() > 0.3
    assert alpha[32, 32] == 0, "the wall hides the smoke behind it"
