# SPDX-License-Identifier: GPL-3.0-or-later
"""Deep files: one a frame, layer and view, where and as the settings say."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes
from exr import read_metadata
from test_render import smoke

sys.path.append(str(Path(__file__).parents[3] / "scripts"))

from exr_reader import read_deep  # noqa: E402


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A saved file's folder; the scene writes deep files into its folder `deep`."""
    smoke()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.context.scene.fumarole.use_deep = True
    return tmp_path


def flatten(path: Path) -> np.ndarray:
    """(height, width, 4), samples over one another."""
    counts, samples = read_deep(path)
    counts = counts.astype(int)
    result = np.zeros((*counts.shape, 4), np.float32)
    left = np.ones(counts.shape, np.float32)
    first = (np.cumsum(counts) - counts.ravel()).reshape(counts.shape)
    for layer in range(counts.max(initial=0)):
        inside = counts > layer
        sample = samples[first[inside] + layer]
        result[inside] += left[inside][:, None] * sample[:, :4]
        left[inside] *= 1 - sample[:, 3]
    return result


def files(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if "deep" in str(path) and path.is_file())


def test_an_animation_writes_a_file_a_frame(folder: Path) -> None:
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 3, 4
    pictures = {}
    for frame in (3, 4):
        scene.frame_set(frame)
        pictures[frame] = scenes.render_combined(folder / "flat")
    assert files(folder) == ["deep/smoke_0003.exr", "deep/smoke_0004.exr"]
    for name in files(folder):
        (folder / name).unlink()
    scenes.exr_output(folder / "out_")
    bpy.ops.render.render(animation=True)
    assert files(folder) == ["deep/smoke_0003.exr", "deep/smoke_0004.exr"]
    for frame, picture in pictures.items():
        flat = flatten(folder / f"deep/smoke_{frame:04d}.exr")
        assert picture[..., 3].max() > 0.5
        assert abs(flat - picture).max() < 1e-3
    assert not np.array_equal(flatten(folder / "deep/smoke_0003.exr"), flatten(folder / "deep/smoke_0004.exr"))


def test_openimageio_reads_the_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in Path(bpy.utils.resource_path("LOCAL")).glob("python/lib/python*/site-packages/OpenImageIO"):
        monkeypatch.syspath_prepend(str(module.parent))
    OpenImageIO = pytest.importorskip("OpenImageIO", reason="this Blender brings none")
    picture = scenes.render_combined(folder / "flat")
    path = folder / "deep" / "smoke_0001.exr"
    counts, samples = read_deep(path)
    image = OpenImageIO.ImageBuf(str(path))
    spec = image.spec()
    names = ["R", "G", "B", "A", "Z", "ZBack"]
    assert spec.deep and sorted(spec.channelnames) == sorted(names)
    data = image.deepdata()
    order = [list(spec.channelnames).index(name) for name in names]
    height, width = counts.shape
    sample = 0
    for y in range(height):
        for x in range(width):
            pixel = (height - 1 - y) * width + x
            assert data.samples(pixel) == counts[y, x]
            for n in range(counts[y, x]):
                values = [data.deep_value(pixel, channel, n) for channel in order]
                assert values == samples[sample].tolist()
                sample += 1
    flat = OpenImageIO.ImageBufAlgo.flatten(image).get_pixels(OpenImageIO.FLOAT)[::-1]
    colors = [list(spec.channelnames).index(name) for name in "RGBA"]
    assert abs(flat[..., colors] - picture).max() < 1e-3


def test_nothing_is_written_unless_asked_for(folder: Path) -> None:
    bpy.context.scene.fumarole.use_deep = False
    scenes.render_combined(folder / "flat")
    assert files(folder) == []


def test_layers_have_files_of_their_own(folder: Path) -> None:
    scene = bpy.context.scene
    scene.view_layers.new("No smoke/at all")
    scene.view_layers["No smoke/at all"].layer_collection.exclude = True
    scene.fumarole.deep_path = "//deep/v#2/a##b.EXR"
    scene.frame_set(12)
    bpy.ops.render.render()
    first = bpy.path.clean_name(scene.view_layers[0].name)
    assert files(folder) == ["deep/v#2/a12b_No_smoke_at_all.exr", f"deep/v#2/a12b_{first}.exr"]
    assert read_deep(folder / files(folder)[1])[0].max() > 0
    scene.view_layers.new("No smoke_at all")
    with pytest.raises(RuntimeError, match="several view layers are called 'No_smoke_at_all'"):
        bpy.ops.render.render()


def test_views_have_files_of_their_own(folder: Path) -> None:
    scene = bpy.context.scene
    scene.render.use_multiview = True
    scene.fumarole.deep_path = "//deep/smoke"
    bpy.ops.render.render()
    assert files(folder) == ["deep/smoke0001_L.exr", "deep/smoke0001_R.exr"]
    left, right = (flatten(folder / name) for name in files(folder))
    assert not np.array_equal(left, right)


def test_frames_that_are_there_are_kept_without_overwrite(folder: Path) -> None:
    scene = bpy.context.scene
    scene.frame_start = scene.frame_end = 1
    scene.render.use_overwrite = False
    (folder / "deep").mkdir()
    path = folder / "deep" / "smoke_0001.exr"
    path.write_bytes(b"before")
    scenes.exr_output(folder / "out_")
    scene.render.use_overwrite = False
    bpy.ops.render.render(animation=True)
    assert path.read_bytes() == b"before"
    scene.render.use_overwrite = True
    bpy.ops.render.render(animation=True)
    assert read_deep(path)[0].max() > 0


def test_a_border_keeps_its_place_in_the_frame(folder: Path) -> None:
    picture = scenes.render_combined(folder / "flat")
    render = bpy.context.scene.render
    render.use_border, render.use_crop_to_border = True, False
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.5, 0.5, 1.0
    bpy.ops.render.render()
    path = folder / "deep" / "smoke_0001.exr"
    attributes = read_metadata(path)
    assert struct.unpack("<4i", attributes["displayWindow"]) == (0, 0, 63, 63)
    assert struct.unpack("<4i", attributes["dataWindow"]) == (16, 0, 31, 31)
    assert abs(flatten(path) - picture[32:, 16:32]).max() < 5e-3
    render.use_crop_to_border = True
    bpy.ops.render.render()
    assert struct.unpack("<4i", read_metadata(path)["displayWindow"]) == (0, 0, 15, 31)


def test_what_fails_names_the_path(folder: Path) -> None:
    scene = bpy.context.scene
    (folder / "occupied").write_bytes(b"a file")
    scene.fumarole.deep_path = "//occupied/deep_####.exr"
    with pytest.raises(RuntimeError, match="Deep EXR '.*occupied/deep_0001.exr' can't be written"):
        bpy.ops.render.render()
    scene.fumarole.deep_path = "//deep/"
    with pytest.raises(RuntimeError, match="Deep EXR '//deep/': it names no file"):
        bpy.ops.render.render()
    scene.fumarole.deep_path = "//deep/smoke_####.exr"
    scene.fumarole.device = "GL"
    with pytest.raises(RuntimeError, match="deep pixels: OpenGL keeps no depths"):
        bpy.ops.render.render()
    assert files(folder) == []


def test_unsaved_files_have_no_folder() -> None:
    smoke()
    bpy.context.scene.fumarole.use_deep = True
    with pytest.raises(RuntimeError, match="it is relative to the file, which isn't saved yet"):
        bpy.ops.render.render()


@pytest.mark.parametrize(
    ("pattern", "frame", "expected"),
    [("a#", 7, "a7"), ("a##", 123, "a123"), ("#a###.b", 5, "#a005.b"), ("a", 5, "a0005"), ("a_##", -3, "a_-03")],
)
def test_frames_are_numbered_as_blender_does(pattern: str, frame: int, expected: str) -> None:
    from fumarole import deep

    assert deep._numbered(pattern, frame) == expected
    bpy.context.scene.render.filepath = f"/folder/{pattern}"
    bpy.context.scene.render.use_file_extension = False
    assert bpy.context.scene.render.frame_path(frame=frame) == f"/folder/{expected}"


@pytest.mark.parametrize("persistent", [False, True])
def test_a_frame_that_fails_leaves_no_file(folder: Path, persistent: bool) -> None:
    """The second layer can't be written; then the first one has no file either, but for that of the frame before."""
    scene = bpy.context.scene
    scene.render.use_persistent_data = persistent
    scene.view_layers.new("Second")
    scenes.exr_output(folder / "flat_")
    scene.frame_start, scene.frame_end = 1, 3
    first = bpy.path.clean_name(scene.view_layers[0].name)
    (folder / "deep" / "smoke_0002_Second.exr").mkdir(parents=True)
    with pytest.raises(RuntimeError, match="smoke_0002_Second.exr.* can't be written"):
        bpy.ops.render.render(animation=True)
    assert files(folder) == ["deep/smoke_0001_Second.exr", f"deep/smoke_0001_{first}.exr"]
    assert [path.name for path in folder.glob("flat_*")] == ["flat_0001.exr"]
