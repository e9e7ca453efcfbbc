# SPDX-License-Identifier: GPL-3.0-or-later
"""OpenEXR files, read back by an independent reader."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from exr_reader import read_exr

from fumarole import core

RANDOM = np.random.default_rng(3)


def test_layers_come_back_bit_for_bit(tmp_path: Path) -> None:
    layers = {
        "Combined": RANDOM.normal(size=(37, 23, 4)).astype(np.float32),
        "Depth": RANDOM.normal(size=(37, 23, 1)).astype(np.float32),
        "Mine": RANDOM.normal(size=(37, 23, 3)).astype(np.float32),
    }
    path = tmp_path / "Rauchsäule 煙.exr"
    core.write_exr(path, layers)
    channels = read_exr(path)
    assert list(channels) == sorted(channels)
    assert set(channels) == {"R", "G", "B", "A", "Depth.Z", "Mine.R", "Mine.G", "Mine.B"}
    for index, name in enumerate("RGBA"):
        np.testing.assert_array_equal(channels[name], layers["Combined"][..., index])
    np.testing.assert_array_equal(channels["Depth.Z"], layers["Depth"][..., 0])
    for index, name in enumerate("RGB"):
        np.testing.assert_array_equal(channels[f"Mine.{name}"], layers["Mine"][..., index])


def test_smooth_pictures_are_compressed(tmp_path: Path) -> None:
    core.write_exr(tmp_path / "flat.exr", {"": np.ones((64, 64, 3))})
    assert (tmp_path / "flat.exr").stat().st_size < 4 * 64 * 64
    assert all((channel == 1).all() for channel in read_exr(tmp_path / "flat.exr").values())


def test_failure_keeps_the_file_that_was_there(tmp_path: Path) -> None:
    path = tmp_path / "kept.exr"
    path.write_bytes(b"before")
    with pytest.raises(core.FumaroleError, match=r"layer 'b' is \(2, 3\), the first one \(2, 2\)"):
        core.write_exr(path, {"a": np.zeros((2, 2, 1)), "b": np.zeros((2, 3, 1))})
    assert path.read_bytes() == b"before"


def test_missing_folder_is_a_file_error_that_names_the_path(tmp_path: Path) -> None:
    path = tmp_path / "nowhere" / "a.exr"
    with pytest.raises(core.FumaroleError, match=str(path)) as caught:
        core.write_exr(path, {"": np.zeros((2, 2, 4))})
    assert caught.value.code == core.ErrorCode.FILE


@pytest.mark.parametrize(
    ("layers", "message"),
    [
        ({}, "there is no layer to write"),
        ({"x": np.zeros((2, 2))}, r"layer 'x' has shape \(2, 2\)"),
        ({"x": np.zeros((2, 2, 5))}, r"layer 'x' has shape \(2, 2, 5\)"),
        ({"x": "picture"}, "layer 'x' is not an array of numbers"),
    ],
)
def test_wrong_layers_are_named(layers: dict[str, object], message: str, tmp_path: Path) -> None:
    with pytest.raises(core.FumaroleError, match=message):
        core.write_exr(tmp_path / "a.exr", layers)
    assert not list(tmp_path.iterdir())
