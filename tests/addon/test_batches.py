# SPDX-License-Identifier: GPL-3.0-or-later
"""Animations from the command line: which frames are rendered, what a failure leaves, and that memory is steady."""

from __future__ import annotations

from pathlib import Path

import pytest
from blenders import HERE, Blender, Run, run
from exr import read_exr

SOAK_SECONDS = 900  # quiet machines need a tenth


def make_batch(blender: Blender, folder: Path, *words: str) -> Path:
    blend = folder / "batch.blend"
    done = run(blender.script_command(HERE / "make_batch.py", str(folder), *words), folder)
    assert done.code == 0 and blend.exists(), done.output
    return blend


def render(blender: Blender, folder: Path, *options: str) -> Run:
    return run(blender.render_command(folder / "batch.blend", *options), folder)


def outputs(folder: Path) -> list[str]:
    """Every file that a render left, the blend file and Blender's own folders aside."""
    own = ("batch.blend", "batch.blend1")
    files = [path.relative_to(folder) for path in folder.rglob("*") if path.is_file()]
    return sorted(str(path) for path in files if path.parts[0] != "user" and path.name not in own)


def outputs_of(*frames: int) -> list[str]:
    return sorted(name for frame in frames for name in (f"flat_{frame:04d}.exr", f"deep_{frame:04d}.exr", f"node/node_{frame:04d}.exr"))


def test_frames_first_last_and_step(blender: Blender, tmp_path: Path) -> None:
    make_batch(blender, tmp_path)
    done = render(blender, tmp_path, "-s", "2", "-e", "9", "-j", "3", "-a")
    assert done.code == 0, done.output
    assert outputs(tmp_path) == outputs_of(2, 5, 8)
    stepped = {frame: read_exr(tmp_path / f"flat_{frame:04d}.exr") for frame in (5, 8)}
    done = render(blender, tmp_path, "-s", "4", "-e", "8", "-a")
    assert done.code == 0, done.output
    for frame, channels in stepped.items():
        again = read_exr(tmp_path / f"flat_{frame:04d}.exr")
        assert all((again[name] == values).all() for name, values in channels.items())
    assert (stepped[5]["A"] != stepped[8]["A"]).any()


def test_failed_frame_ends_the_animation_and_leaves_nothing(blender: Blender, tmp_path: Path) -> None:
    """Placeholders of Blender's own go as well."""
    make_batch(blender, tmp_path, "fails", "keep", "placeholders")
    done = render(blender, tmp_path, "-s", "1", "-e", "5", "-a")
    assert done.code == 1, done.output
    assert "clip range 60..50 is not valid" in done.output
    assert outputs(tmp_path) == outputs_of(1, 2)
    assert read_exr(tmp_path / "flat_0002.exr")["A"].max() > 0.5


def test_frames_that_are_there_are_skipped(blender: Blender, tmp_path: Path) -> None:
    """A finished one, and one that another machine has marked as its own: no output of any kind is touched."""
    make_batch(blender, tmp_path, "keep", "placeholders")
    (tmp_path / "flat_0002.exr").write_bytes(b"finished")
    (tmp_path / "flat_0003.exr").touch()
    done = render(blender, tmp_path, "-s", "1", "-e", "4", "-a")
    assert done.code == 0, done.output
    assert outputs(tmp_path) == sorted([*outputs_of(1, 4), "flat_0002.exr", "flat_0003.exr"])
    assert (tmp_path / "flat_0002.exr").read_bytes() == b"finished"
    assert (tmp_path / "flat_0003.exr").read_bytes() == b""


def test_frames_that_are_there_are_overwritten(blender: Blender, tmp_path: Path) -> None:
    make_batch(blender, tmp_path)
    for name in outputs_of(2):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"old")
    done = render(blender, tmp_path, "-s", "2", "-e", "2", "-a")
    assert done.code == 0, done.output
    assert all(len((tmp_path / name).read_bytes()) > 1000 for name in outputs_of(2))


def test_unbaked_smoke_is_named_once(blender: Blender, tmp_path: Path) -> None:
    make_batch(blender, tmp_path, "unbaked")
    done = render(blender, tmp_path, "-s", "4", "-e", "6", "-a")
    assert done.code == 0, done.output
    assert done.output.count("'Smoke' of 'Emitter' isn't baked and wasn't played from its first frame, 1") == 1
    assert outputs(tmp_path) == outputs_of(4, 5, 6)


@pytest.mark.parametrize(
    ("frames", "words", "bound_mib"), [(80, [], 4), (80, ["persistent", "deep"], 8), (100, ["opengl"], 40)]
)
def test_memory_is_steady(blender: Blender, tmp_path: Path, frames: int, words: list[str], bound_mib: float) -> None:
    """The least resident memory of the last quarter over that of a quarter near the start. A picture that is lost in each
    frame would be 12 MiB in 50 frames, or 62 in 62 of OpenGL, whose Mesa takes and gives back up to 26."""
    done = run(blender.script_command(HERE / "soak.py", str(tmp_path), str(frames), *words), tmp_path, SOAK_SECONDS)
    assert done.code == 0, done.output[-4000:]
    told = [line.split()[1:] for line in done.output.splitlines() if line.startswith("RSS ")]
    used = {int(frame): int(kib) / 1024 for frame, kib in told}
    assert sorted(used) == list(range(1, frames + 1))
    early = min(used[frame] for frame in range(frames // 8, 3 * frames // 8))
    late = min(used[frame] for frame in range(3 * frames // 4, frames + 1))
    assert late - early <= bound_mib, used
    assert len(list(tmp_path.glob("0*.exr"))) == frames
