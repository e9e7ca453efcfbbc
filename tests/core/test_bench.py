# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark program: what it prints, what it reads, what it refuses."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from exr_reader import read_exr

from fumarole.core import _library

BENCH = _library.candidates()[-1].parent / "fumarole-bench"


def bench(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [str(BENCH), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, env=dict(os.environ))


def row(*arguments: object) -> dict:
    done = bench(*arguments)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n") == 1
    return json.loads(done.stdout)


@pytest.mark.parametrize(("solver", "ran", "rms", "worst"), [("exact", "exact", 3e-4, 1e-3), ("automatic", "sweep", 2.5e-3, 0.03)])
def test_lighting_is_within_the_promise(solver: str, ran: str, rms: float, worst: float) -> None:
    found = row("lighting", "--particles", 20_000, "--lights", 2, "--solver", solver, "--threads", 2, "--sample", 100)
    assert (found["particles"], found["lights"], found["solver"], found["threads"]) == (20_000, 2, ran, 2)
    assert 0 < found["rms"] < rms and found["rms"] <= found["p95"] <= found["worst"] < worst
    assert found["build_s"] > 0 and found["light_s"] > 0 and found["peak_rss_mb"] > 1
    tight = row("lighting", "--particles", 20_000, "--lights", 2, "--tolerance", 0.001, "--sample", 100)
    assert tight["solver"] == "exact" and tight["worst"] < 1e-4


def test_frame_writes_the_picture(tmp_path: Path) -> None:
    path = tmp_path / "plume.exr"
    found = row("frame", "--particles", 5_000, "--width", 96, "--height", 64, "--depth", "--exr", path, "--device", "gl")
    assert found["drawn"] == 5_000 and found["device"]
    assert found["total_s"] >= found["light_s"] + found["sort_s"] + found["draw_s"] + found["passes_s"]
    channels = read_exr(path)
    assert set(channels) == {"R", "G", "B", "A", "Depth.Z"}
    assert channels["A"].shape == (64, 96) and 0.9 < channels["A"].max() <= 1.0
    assert channels["A"][0, 0] < 0.01 and channels["R"].max() > 0.01


def test_frame_says_how_exact_light_is() -> None:
    found = row("frame", "--particles", 5_000, "--width", 96, "--height", 64, "--tolerance", 0.02, "--leaf", 32)
    assert (found["tolerance"], found["leaf"], found["subsampling"]) == (0.02, 32, 1)
    assert found["accuracy_count"] > 100 and found["refinements"] >= 0 and found["light_points"] > 1_000
    assert 0 < found["accuracy_rms"] < found["accuracy_worst"] and found["accuracy_rms"] < 0.02


def test_frame_draws_larger_and_denser_particles(tmp_path: Path) -> None:
    """Larger ones are lit as before, so that with light at their centres its errors are the same."""
    pictures, rows = [], []
    for index, more in enumerate(((), ("--grow", 3), ("--dense", 4))):
        path = tmp_path / f"{index}.exr"
        size = ("--particles", 5_000, "--width", 96, "--height", 64, "--device", "gl", "--exr", path)
        rows.append(row("frame", *size, *more))
        pictures.append(read_exr(path)["A"])
    assert [(found["grow"], found["dense"]) for found in rows] == [(1, 1), (3, 1), (1, 4)]
    assert rows[1]["accuracy_rms"] == pytest.approx(rows[0]["accuracy_rms"], rel=0.05) and rows[0]["accuracy_rms"] > 0
    for alpha in pictures[1:]:
        assert alpha.sum() > 1.1 * pictures[0].sum()


HEADER = """ply
format binary_little_endian 1.0
comment made by a test
element vertex {count}
property double x
property float z
property float y
property uchar red
property uchar green
property uchar blue
property int age
property float radius
{rest}end_header
"""
LAYOUT = np.dtype(
    [("x", "<f8"), ("z", "<f4"), ("y", "<f4"), ("rgb", "u1", 3), ("age", "<i4"), ("radius", "<f4"), ("density", "<f4")]
)


def test_ply_file(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    points = np.zeros(3_000, LAYOUT)
    for axis in "xyz":
        points[axis] = rng.uniform(-1, 1, points.size)
    points["rgb"], points["radius"], points["density"] = (255, 128, 0), 0.2, 1.0
    path = tmp_path / "points.ply"
    path.write_bytes(HEADER.format(count=points.size, rest="property float density\n").encode() + points.tobytes())
    picture = tmp_path / "points.exr"
    found = row("frame", "--file", path, "--width", 32, "--height", 32, "--exr", picture)
    assert found["particles"] == 3_000
    channels = read_exr(picture)
    assert channels["G"].sum() == pytest.approx(channels["R"].sum() * 128 / 255, rel=1e-3)
    assert channels["B"].max() == 0.0
    lighting = row("lighting", "--file", path, "--sample", 50)
    assert lighting["particles"] == 3_000 and 0 < lighting["worst"] < 1e-3


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"solid nothing", "not a PLY file"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0", "binary_little_endian"),
        (b"ply\nformat binary_little_endian 1.0\nend_header\n", "no element vertex"),
        (b"ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty list uchar int x\nend_header\n", "can't use"),
        (b"ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\nend_header\n\0\0\0\0", "ends before"),
        (b"ply\nformat binary_little_endian 1.0\nelement vertex 2\n", "header doesn't end"),
    ],
)
def test_broken_ply_is_named(content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "broken.ply"
    path.write_bytes(content)
    done = bench("lighting", "--file", path)
    assert done.returncode == 1 and done.stdout == ""
    assert message in done.stderr and "broken.ply" in done.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["fly"],
        ["lighting", "--particles"],
        ["lighting", "--solver", "guess"],
        ["frame", "--width", "x"],
        ["frame", "--then"],
        ["frame", "--grow", "0"],
        ["lighting", "--grow", "2"],
        ["image", "--light", "top"],
    ],
)
def test_wrong_arguments_show_the_usage(arguments: list[str]) -> None:
    done = bench(*arguments)
    assert done.returncode == 2 and done.stdout == "" and "usage: fumarole-bench" in done.stderr


def test_missing_file_is_named() -> None:
    done = bench("lighting", "--file", "/nowhere/points.ply")
    assert done.returncode == 1 and "/nowhere/points.ply" in done.stderr


def test_reference_writes_the_picture(tmp_path: Path) -> None:
    """The same camera and lights as `frame`."""
    path, fast = tmp_path / "reference.exr", tmp_path / "frame.exr"
    size = ("--particles", 3_000, "--width", 72, "--height", 48)
    found = row("reference", *size, "--tolerance", 1e-3, "--exr", path)
    assert (found["particles"], found["width"], found["height"], found["tolerance"]) == (3_000, 72, 48, 1e-3)
    assert 0 < found["error"] < 1e-3 and found["unconverged"] == 0 and found["steps"] > 1_000 and found["seconds"] > 0
    row("frame", *size, "--exr", fast)
    reference, frame = read_exr(path), read_exr(fast)
    assert set(reference) == {"R", "G", "B", "A"} and reference["A"].shape == (48, 72)
    assert np.abs(reference["A"] - frame["A"]).max() < 0.02


@pytest.mark.parametrize("scene", ["ball", "puff", "six", "mixed", "edge", "plume"])
def test_image_compares_with_the_reference(scene: str) -> None:
    count = {"puff": 1, "six": 6}.get(scene, 200)
    size = ("--particles", count, "--width", 32, "--height", 32, "--every", 4)
    done = bench("image", "--scene", scene, *size, "--depth", 2, "--reference-tolerance", 1e-3)
    assert done.returncode == 0, done.stderr
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert [found["light"] for found in rows] == ["side", "front", "behind", "two"]
    for found in rows:
        assert (found["scene"], found["particles"], found["depth"]) == (scene, count, 2)
        assert 0 < found["image_rms_relative"] < 0.7 and abs(found["bias"]) < found["image_rms_relative"] * 1.5
        assert found["reference_error"] < 1e-3 and {"light_s", "draw_s", "slices", "samples"} <= set(found)


def test_image_tries_settings_against_one_reference() -> None:
    """The options after --then keep what was set before."""
    size = ("--particles", 200, "--width", 32, "--height", 32, "--reference-tolerance", 1e-3, "--light", "behind", "--threads", 2)
    tried = ("--tolerance", 0.1, "--repeat", 3, "--then", "--tolerance", 0.01, "--then", "--subsampling", 0.5)
    done = bench("image", *size, *tried)
    assert done.returncode == 0, done.stderr
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert [(found["tolerance"], found["subsampling"]) for found in rows] == [(0.1, 1), (0.01, 1), (0.01, 0.5)]
    assert len({found["reference_s"] for found in rows}) == 1
    for found in rows:
        assert (found["light"], found["device"], found["threads"]) == ("behind", "tiles", 2)
        assert found["total_s"] >= found["light_s"] + found["draw_s"] and found["processor_s"] > 0
    loose, fine, sparse = (found["image_rms_relative"] for found in rows)
    assert fine < loose and fine < sparse


def test_image_error_falls_with_the_number_of_particles() -> None:
    """At a fixed optical depth, whatever lights the particles: it is measured, not assumed."""
    size = ("--depth", 1, "--width", 32, "--height", 32, "--every", 4, "--reference-tolerance", 1e-3)
    done = bench("image", "--scene", "ball", "--particles", 20_000, *size)
    assert done.returncode == 0, done.stderr
    assert all(json.loads(line)["image_rms_relative"] < 0.03 for line in done.stdout.splitlines())


def test_unknown_scenes_and_too_many_puffs_are_named() -> None:
    for arguments, message in ((("--scene", "fog"), "no scene fog"), (("--scene", "six", "--particles", 7), "at most 6")):
        done = bench("image", *arguments)
        assert done.returncode == 1 and message in done.stderr
