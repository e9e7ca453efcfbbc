# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion blur and depth of field from Blender's settings."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes
from exr import read_exr, read_metadata, stack
from test_deep import flatten

from fumarole import compat, core, engine, picture

FRAME = 10


def move(owner: bpy.types.Object, axis: int, expression: str) -> None:
    owner.driver_add("location", axis).driver.expression = expression


def puff(density: float = 6.0, radius: float = 0.6) -> bpy.types.Object:
    owner = scenes.points_by_nodes("Puff", [(0, 0, 0)], radius=radius)
    scenes.set_point_material(owner, scenes.material("Smoke", Density=density))
    scenes.light("SUN", energy=2.0)
    scenes.camera()
    bpy.context.scene.render.film_transparent = True
    bpy.context.scene.frame_set(FRAME)
    return owner


def open_shutter(length: float = 0.5, position: str = "CENTER", samples: int = 0) -> None:
    scene = bpy.context.scene
    scene.render.use_motion_blur = True
    scene.render.motion_blur_shutter = length
    compat.shutter_settings(scene).motion_blur_position = position
    scene.fumarole.blur_samples = samples


def open_aperture(fstop: float = 0.2, focus: float = 8.0, samples: int = 0) -> None:
    dof = bpy.context.scene.camera.data.dof
    dof.use_dof = True
    dof.aperture_fstop, dof.focus_distance = fstop, focus
    bpy.context.scene.fumarole.blur_samples = samples


def exported() -> core.Camera:
    (result,) = scenes.export_layers()
    return result.camera


def samples_of(folder: Path) -> int:
    """What the picture's metadata says; 0: nothing."""
    metadata = read_metadata(folder / "render.exr")
    return int(metadata.get(f"fumarole.{bpy.context.view_layer.name}.blur_samples", b"0"))


def middle_of(alpha: np.ndarray) -> np.ndarray:
    """Mean place (x, y) in pixels."""
    y, x = np.mgrid[: alpha.shape[0], : alpha.shape[1]] + 0.5
    return np.array(((x * alpha).sum(), (y * alpha).sum())) / alpha.sum()


def relative_rms(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.sqrt(((found - expected) ** 2).mean() / (expected**2).mean()))


def printed(capfd: pytest.CaptureFixture) -> str:
    result = capfd.readouterr()
    return result.out + result.err


@pytest.mark.parametrize("samples", [0, 5])
def test_what_stands_still_is_drawn_once(scene: bpy.types.Scene, tmp_path: Path, samples: int) -> None:
    owner = puff()
    scenes.plane("Wall", 1.0, location=(0.5, -1, 0), rotation=(90, 0, 0))
    move(bpy.data.objects["Sun"], 0, "frame")
    expected = scenes.render_combined(tmp_path)
    assert samples_of(tmp_path) == 0
    open_shutter(samples=samples)
    assert np.array_equal(scenes.render_combined(tmp_path), expected)
    assert samples_of(tmp_path) == 0
    move(owner, 0, "0.4 * (frame - 10)")
    assert not np.array_equal(scenes.render_combined(tmp_path), expected)
    assert samples_of(tmp_path) == samples or (samples == 0 and samples_of(tmp_path) > 1)


@pytest.mark.parametrize("position", ["START", "CENTER", "END"])
def test_smoke_is_spread_over_the_shutter(scene: bpy.types.Scene, tmp_path: Path, position: str) -> None:
    """Of an object that is moved, whose points come without velocities."""
    owner = puff(density=0.3)
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 6.4
    sharp = scenes.render_combined(tmp_path)[..., 3]
    move(owner, 0, f"2.0 * (frame - {FRAME})")
    open_shutter(0.8, position, samples=16)
    alpha = scenes.render_combined(tmp_path)[..., 3]
    assert samples_of(tmp_path) == 16
    assert scene.frame_current == FRAME and scene.frame_subframe == 0
    opens, closes = exported().shutter
    assert middle_of(alpha) == pytest.approx(np.array((32 + 10 * (opens + closes), 32)), abs=0.1)
    assert alpha.sum() == pytest.approx(sharp.sum(), rel=0.01)
    columns = np.arange(64) + 0.5
    row, row_of_sharp = alpha.sum(0), sharp.sum(0)
    spread, spread_of_sharp = (
        np.average((columns - np.average(columns, weights=values)) ** 2, weights=values)
        for values in (row, row_of_sharp)
    )
    assert spread - spread_of_sharp == pytest.approx((2.0 * 0.8 * 10) ** 2 / 12, rel=0.03)


def test_moving_particles_are_the_mean_over_the_shutter(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """Of pictures without blur at many times; gravity bends their ways."""
    owner = scenes.emitter(count=60, particle_size=0.3, normal_factor=6.0, factor_random=4.0)
    owner.show_instancer_for_render = False
    owner.particle_systems[0].settings.effector_weights.gravity = 1.0
    owner.data.materials.append(scenes.material("Smoke", Density=4.0))
    scenes.light("SUN")
    scenes.camera((0, -8, 0.6))
    scene.render.film_transparent = True
    scenes.bake()
    scene.frame_set(5)
    sharp = scenes.render_combined(tmp_path)
    frames = 5 + 0.25 + (np.arange(24) + 0.5) / 24 * 0.75 - 0.25
    means = []
    for frame in frames:
        scene.frame_set(int(frame), subframe=frame - int(frame))
        means.append(scenes.render_combined(tmp_path))
    expected = np.mean(means, axis=0)
    scene.frame_set(5)
    open_shutter(0.75, "START", samples=24)
    found = scenes.render_combined(tmp_path)
    assert relative_rms(found, expected) < 0.01
    assert relative_rms(sharp, expected) > 0.1


def test_moving_solids_take_samples(scene: bpy.types.Scene, tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    """So many that its edge comes in steps of at most four pixels; said where the user looks."""
    puff(density=20.0, radius=4.0).location.y = 6
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 6.4
    wall = scenes.plane("Wall", 2.0, location=(0, -6, 0), rotation=(90, 0, 0))
    move(wall, 0, f"4.0 * (frame - {FRAME})")
    open_shutter(0.5)
    printed(capfd)
    alpha = scenes.render_combined(tmp_path)[..., 3]
    assert samples_of(tmp_path) == 5
    if bpy.app.version < (5, 0, 0):  # newer ones print no statistics
        assert "5 blur samples" in printed(capfd)
    row = alpha[32]
    clear = alpha[5, 32]
    assert clear > 0.95
    # The wall, 20 pixels wide, goes from 22 - 10 to 42 + 10: the smoke behind shows to its share of the time.
    expected = clear * (1 - np.clip((np.minimum(np.arange(64), 63 - np.arange(64)) + 0.5 - 12) / 20, 0, 1))
    assert np.abs(row - expected).max() < 0.5 / 5 + 0.03
    assert np.abs(row - expected).mean() < 0.04
    wall.hide_render = True
    scenes.render_combined(tmp_path)
    assert samples_of(tmp_path) == 0, "nothing that is drawn moves"


def test_camera_that_moves(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """Is the same as smoke and solids that move the other way."""
    owner = puff()
    wall = scenes.plane("Wall", 1.0, location=(0.4, -1, 0), rotation=(90, 0, 0))
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 6.4
    open_shutter(1.0, "START", samples=8)
    move(scene.camera, 0, f"-1.5 * (frame - {FRAME})")
    found = scenes.render_combined(tmp_path)
    scene.camera.driver_remove("location", 0)
    scene.camera.location.x = 0
    move(owner, 0, f"1.5 * (frame - {FRAME})")
    move(wall, 0, f"1.5 * (frame - {FRAME}) + 0.4")
    expected = scenes.render_combined(tmp_path)
    assert relative_rms(found, expected) < 2e-3
    assert found[..., 3].max() > 0.3


@pytest.mark.parametrize("has_aperture", [False, True])
def test_shutter_longer_than_a_frame(scene: bpy.types.Scene, tmp_path: Path, has_aperture: bool) -> None:
    owner = puff(density=0.3)
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 6.4
    move(owner, 0, f"0.5 * (frame - {FRAME})")
    open_shutter(3.0, "START")
    if has_aperture:
        open_aperture(fstop=4.0, focus=8.0)
    alpha = scenes.render_combined(tmp_path)[..., 3]
    assert samples_of(tmp_path) >= 2
    assert middle_of(alpha)[0] == pytest.approx(32 + 0.5 * 1.5 * 10, abs=0.15)


def test_bent_ways_take_samples(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """A puff that goes half round an axis while the shutter is open."""
    owner = puff(density=0.02, radius=0.3)
    mesh = owner.data
    mesh.vertices[0].co = (1.5, 0, 0)
    owner.driver_add("rotation_euler", 1).driver.expression = f"3.14 * (frame - {FRAME})"
    open_shutter(1.0, "START")
    scenes.render_combined(tmp_path)
    assert 4 <= samples_of(tmp_path) <= 16


def test_depth_of_field(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """A puff stays the same in focus; out of it it spreads."""
    puff(density=0.3, radius=0.3)
    sharp = scenes.render_combined(tmp_path)[..., 3]
    open_aperture(fstop=0.05, samples=64)
    focused = scenes.render_combined(tmp_path)[..., 3]
    assert samples_of(tmp_path) == 64
    assert np.abs(focused - sharp).max() < 0.03 * sharp.max()
    scene.camera.data.dof.focus_distance = 4.0
    blurred = scenes.render_combined(tmp_path)[..., 3]
    assert blurred.sum() == pytest.approx(sharp.sum(), rel=0.02)
    assert blurred.max() < 0.7 * sharp.max()
    rows = np.arange(64) + 0.5 - 32
    spread, before = (
        np.average(rows**2, weights=values.sum(1)) for values in (blurred.astype(float), sharp.astype(float))
    )
    radius = 50e-3 / 2 / 0.05 * (1 / 4 - 1 / 8) * 64 * 50 / 36
    assert spread - before == pytest.approx(radius**2 / 4, rel=0.08)


def test_solids_out_of_focus_take_samples(scene: bpy.types.Scene, tmp_path: Path) -> None:
    puff(density=0.02)
    wall = scenes.plane("Wall", 0.5, location=(1.2, -3, 0), rotation=(90, 0, 0))
    open_aperture(fstop=0.05, focus=5.0)
    scenes.render_combined(tmp_path)
    assert samples_of(tmp_path) == 1
    scene.camera.data.dof.focus_distance = 20.0
    scenes.render_combined(tmp_path)
    circle = 2 * 50e-3 / 2 / 0.05 * (1 / 5 - 1 / 20) * 64 * 50 / 36
    assert samples_of(tmp_path) == math.ceil(circle / 4) == 4
    wall.visible_camera = False
    scenes.render_combined(tmp_path)
    assert samples_of(tmp_path) == 1


def test_passes(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """Those of places are the frame's own; the rest is averaged, and goes on adding up."""
    owner = puff()
    other = scenes.points_by_nodes("Other", [(0.4, 1, 0.2)], radius=0.6)
    scenes.set_point_material(other, bpy.data.materials["Smoke"])
    scenes.light("POINT", location=(2, -3, 3))
    move(owner, 0, f"2.0 * (frame - {FRAME})")
    layer = bpy.context.view_layer
    for switch in ("z", "position", "vector", "emit", "cryptomatte_object"):
        setattr(layer, f"use_pass_{switch}", True)
    for switch in ("opacity", "albedo", "lights"):
        setattr(layer.fumarole, f"use_pass_{switch}", True)
    sharp = scenes.render_channels(tmp_path)
    open_shutter(0.5, samples=6)
    blurred = scenes.render_channels(tmp_path)
    assert blurred.keys() == sharp.keys()
    name = layer.name
    for key in ("Depth", "Position", "Vector"):
        channels = [channel for channel in sharp if channel.startswith(f"{name}.{key}.")]
        assert channels
        for channel in channels:
            if key != "Vector":  # a point cloud that is moved has velocities with motion blur alone
                assert np.array_equal(blurred[channel], sharp[channel]), channel
    combined = stack(blurred, f"{name}.Combined", "RGBA")
    assert np.abs(combined - stack(sharp, f"{name}.Combined", "RGBA")).max() > 0.05
    parts = sum(stack(blurred, f"{name}.{part}", "RGB") for part in ("Light Sun", "Light Point", "Emit"))
    assert np.abs(parts - combined[..., :3]).max() < 1e-5
    (opacity,) = [channel for channel in blurred if channel.startswith(f"{name}.Opacity.")]
    assert np.abs(blurred[opacity] - combined[..., 3]).max() < 1e-5
    ranks = [stack(blurred, f"{name}.CryptoObject{pair:02}", "RGBA") for pair in range(3)]
    coverage = sum(pair[..., 1] + pair[..., 3] for pair in ranks)
    assert np.abs(coverage - combined[..., 3]).max() < 3e-3


def test_passes_that_smears_do_not_have(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """Samples without smears have them."""
    owner = puff(density=0.02)
    move(owner, 0, f"2.0 * (frame - {FRAME})")
    scenes.plane("Roof", 1.0, location=(0, 0, 3)).visible_camera = False
    layer = bpy.context.view_layer
    open_shutter(0.5)
    layer.fumarole.use_pass_error = layer.fumarole.use_pass_solid_shadow = True
    channels = scenes.render_channels(tmp_path)
    assert samples_of(tmp_path) >= 3
    shadow = stack(channels, f"{layer.name}.Solid Shadow", "RGB")
    assert shadow.min() >= 0 and shadow.min() < 0.9 and shadow.max() <= 1
    (error,) = [values for name, values in channels.items() if name.startswith(f"{layer.name}.Error.")]
    assert np.isfinite(error.astype(float)).all() and np.abs(error).max() < 0.05


def test_deep_files_are_without_blur(scene: bpy.types.Scene, tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    owner = puff()
    move(owner, 0, f"2.0 * (frame - {FRAME})")
    scene.fumarole.use_deep, scene.fumarole.deep_path = True, str(tmp_path / "deep_####.exr")
    sharp = scenes.render_combined(tmp_path)
    path = tmp_path / f"deep_{FRAME:04}.exr"
    assert flatten(path) == pytest.approx(sharp, abs=0.01)
    path.unlink()
    assert "Deep EXR" not in printed(capfd)
    open_shutter(0.5, samples=6)
    assert np.abs(scenes.render_combined(tmp_path) - sharp).max() > 0.1
    assert printed(capfd).count("Deep EXR: the file is without motion blur") == 1
    assert flatten(path) == pytest.approx(sharp, abs=0.01)


@pytest.mark.parametrize("is_persistent", [False, True])
def test_what_does_not_change_is_built_once(
    scene: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_persistent: bool
) -> None:
    owner = puff()
    scene.render.use_persistent_data = is_persistent
    built = []
    add = core.Scene.add_particles
    monkeypatch.setattr(core.Scene, "add_particles", lambda *a, **k: (built.append(1), add(*a, **k)))
    open_shutter(0.5, samples=6)
    move(scene.camera, 0, f"frame - {FRAME}")
    scenes.render_combined(tmp_path)
    assert len(built) == 1
    built.clear()
    move(owner, 0, f"frame - {FRAME}")
    scenes.render_combined(tmp_path)
    assert len(built) == 6
    built.clear()
    scene.render.use_motion_blur = False
    scene.render.use_persistent_data = False
    open_aperture(samples=6)
    scenes.render_combined(tmp_path)
    assert len(built) == 1


def test_world_is_blurred_with_the_camera(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """The picture behind the smoke turns with a camera that turns."""
    puff()
    picture = bpy.data.images.new("Sky", 64, 32, float_buffer=True)
    stripes = np.ones((32, 64, 4), np.float32)
    stripes[..., 0] = np.arange(64) % 4 < 2
    picture.pixels.foreach_set(stripes.ravel())
    world = bpy.data.worlds.new("World")
    world.use_nodes = True
    world.cycles_visibility.scatter = world.cycles_visibility.diffuse = False
    scene.world = world
    tree = world.node_tree
    node = tree.nodes.new("ShaderNodeTexEnvironment")
    node.image = picture
    background = next(item for item in tree.nodes if item.bl_idname == "ShaderNodeBackground")
    tree.links.new(node.outputs["Color"], background.inputs["Color"])
    scene.render.film_transparent = False
    sharp = scenes.render_combined(tmp_path)
    # A whole period of the stripes while the shutter is open.
    scene.camera.driver_add("rotation_euler", 2).driver.expression = f"{2 * math.pi / 16} * (frame - {FRAME})"
    open_shutter(1.0, samples=16)
    blurred = scenes.render_combined(tmp_path)
    assert np.ptp(sharp[4, :, 0]) > 0.9
    assert np.ptp(blurred[4, :, 0]) < 0.15


def test_views_are_blurred_alike(scene: bpy.types.Scene, tmp_path: Path) -> None:
    owner = puff()
    move(owner, 2, f"frame - {FRAME}")
    open_shutter(0.5, samples=4)
    plain = scenes.render_combined(tmp_path)
    scene.render.use_multiview = True
    scene.camera.data.stereo.interocular_distance = 0.0
    scenes.exr_output(tmp_path / "views.exr", multilayer=True)
    scene.render.image_settings.views_format = "MULTIVIEW"
    bpy.ops.render.render(write_still=True)
    channels = read_exr(tmp_path / "views.exr")
    for view in ("left", "right"):
        of_view = {name.replace(f".{view}.", "."): values for name, values in channels.items()}
        found = stack(of_view, f"{bpy.context.view_layer.name}.Combined", "RGBA")
        assert np.abs(found - plain).max() < 1e-4, view


def test_an_error_in_a_sample_leaves_nothing_behind(
    scene: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    owner = puff()
    move(owner, 0, f"frame - {FRAME}")
    open_shutter(0.5, samples=6)
    render, calls = core.render, []

    def fail(*arguments: object, **keywords: object) -> core.Result:
        calls.append(1)
        if len(calls) == 4:
            raise core.FumaroleError(core.ErrorCode.MEMORY, "no memory for sample 4")
        return render(*arguments, **keywords)

    monkeypatch.setattr(core, "render", fail)
    scenes.exr_output(tmp_path / "render.exr", multilayer=True)
    with pytest.raises(RuntimeError, match="no memory for sample 4"):
        bpy.ops.render.render(write_still=True)
    assert not list(tmp_path.iterdir())
    assert scene.frame_current == FRAME
    monkeypatch.undo()
    assert scenes.render_combined(tmp_path)[..., 3].max() > 0.1


@pytest.mark.parametrize("when", ["between", "within"])
def test_cancel(scene: bpy.types.Scene, monkeypatch: pytest.MonkeyPatch, when: str) -> None:
    owner = puff()
    move(owner, 0, f"frame - {FRAME}")
    open_shutter(0.5, samples=6)
    render, calls = core.render, []

    def count(core_scene: core.Scene, *arguments: object, **keywords: object) -> core.Result:
        calls.append(1)
        if when == "between":
            core_scene.context.progress = None
        return render(core_scene, *arguments, **keywords)

    def progress(*_arguments: object) -> picture.Progress:
        return picture.Progress(lambda fraction, text: len(calls) >= 3)

    monkeypatch.setattr(core, "render", count)
    monkeypatch.setattr(engine.FumaroleEngine, "_progress", progress)
    before = engine.last_stats()
    bpy.ops.render.render()
    assert len(calls) == 3
    assert engine.last_stats() is before, "no picture was made"
    assert scene.frame_current == FRAME


@pytest.mark.parametrize("samples", [0, 4])
def test_progress_runs_over_all_samples(
    scene: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, samples: int
) -> None:
    """Those passes that are not blurred come first."""
    owner = puff()
    wall = scenes.plane("Wall", 1.0, location=(0, -3, 0), rotation=(90, 0, 0))
    for item in (owner, wall):
        move(item, 0, f"2.0 * (frame - {FRAME})")
    told: dict[str, list[float]] = {}
    make = engine.FumaroleEngine._progress

    def progress(self: engine.FumaroleEngine, *arguments: int) -> picture.Progress:
        plain = make(self, *arguments)._tell

        def tell(fraction: float, text: str) -> bool:
            told.setdefault(text if text.startswith("Blur sample") else "look", []).append(fraction)
            return plain(fraction, text)

        return picture.Progress(tell)

    monkeypatch.setattr(engine.FumaroleEngine, "_progress", progress)
    open_shutter(0.5, samples=samples)
    bpy.context.view_layer.use_pass_z = True
    scenes.render_combined(tmp_path)
    count = samples_of(tmp_path)
    assert count == samples or (samples == 0 and count > 2)
    assert list(told) == ["look", *(f"Blur sample {number} of {count}" for number in range(1, count + 1))]
    parts = list(told.values())
    for before, after in zip(parts, parts[1:]):
        assert max(before) <= min(after) + 1e-9
    assert 0.9 < max(parts[-1]) <= 1.0 + 1e-9


def test_animation(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """Each frame is as it is by itself."""
    owner = puff()
    move(owner, 0, f"0.7 * (frame - {FRAME})")
    open_shutter(0.5, samples=3)
    scenes.exr_output(tmp_path / "frame_####.exr")
    scene.frame_start, scene.frame_end = FRAME - 1, FRAME + 1
    bpy.ops.render.render(animation=True)
    frames = [read_exr(tmp_path / f"frame_{frame:04}.exr")["A"] for frame in range(FRAME - 1, FRAME + 2)]
    places = [middle_of(frame.astype(float))[0] for frame in frames]
    assert (np.diff(places) > 3).all()
    scene.frame_set(FRAME)
    assert np.array_equal(scenes.render_combined(tmp_path)[..., 3], frames[1])
