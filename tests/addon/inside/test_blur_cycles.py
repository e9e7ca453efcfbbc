# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion blur and depth of field against the same scenes by Cycles."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes
from scenes import cube, paint
from test_solids_cycles import build, by_cycles, by_fumarole, check, relative_rms

from fumarole import compat


def open_aperture(fstop: float, focus: float) -> bpy.types.CameraDOFSettings:
    dof = bpy.context.scene.camera.data.dof
    dof.use_dof, dof.aperture_fstop, dof.focus_distance = True, fstop, focus
    return dof


def check_blur(folder: Path, runs: int = 4) -> None:
    """Ours is Cycles' picture, which is not what it is without blur. What is left is mostly Cycles' noise, 2 % of squares
    of 4 x 4 pixels in four runs."""
    scene = bpy.context.scene
    scene.fumarole.blur_samples = 48
    expected = by_cycles(64, runs)
    found = by_fumarole(folder)
    check(found, expected, 0.1, 0.03)
    scene.camera.data.dof.use_dof = scene.render.use_motion_blur = False
    sharp = by_fumarole(folder)
    assert max(relative_rms(sharp[..., k], expected[..., k]) for k in (0, 3)) > 0.1, "it matters"


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
def test_smoke_out_of_focus(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, kind: str) -> None:
    """Smoke before and behind what is in focus, through an aperture with corners."""
    build(monkeypatch)
    view = bpy.context.scene.camera.data
    view.type, view.ortho_scale = kind, 4.0
    dof = open_aperture(0.03 if kind == "PERSP" else 0.5, 4.0)
    dof.aperture_blades, dof.aperture_rotation, dof.aperture_ratio = 3, 0.4, 1.5
    check_blur(tmp_path)


def test_holdouts_out_of_focus(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Smoke before, amid and behind sharp edges."""
    build(monkeypatch)
    for owner in (
        scenes.plane("Behind", 1.6, location=(0.7, 2.2, 0.3), rotation=(70, 20, 0)),
        cube("Within", 0.35, (0.2, -0.1, 0.2), (20, 30, 40)),
        scenes.plane("In Front", 0.9, location=(-0.7, -1.9, 0.7), rotation=(60, -30, 10)),
    ):
        owner.is_holdout = True
    open_aperture(0.05, 4.5)
    check_blur(tmp_path)


@pytest.mark.parametrize("blades", [0, 3, 5])
def test_bright_spots_have_the_apertures_shape(tmp_path: Path, blades: int) -> None:
    """Small glowing squares, out of focus."""
    scene = bpy.context.scene
    scenes.camera(lens=50)
    for place in ((0, 0), (-1, 1.1), (1.2, -0.8)):
        card = scenes.plane("Spot", 0.4, location=(place[0], 0, place[1]), rotation=(90, 0, 0))
        paint(card, "ShaderNodeEmission", Color=(1, 0.5, 0.2, 1), Strength=5.0)
    scene.render.film_transparent = True
    scene.render.resolution_x = scene.render.resolution_y = 48
    scene.fumarole.solids = "SHADED"
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 1.0
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    dof = open_aperture(0.06, 4.0)
    dof.aperture_blades, dof.aperture_rotation = blades, 0.2
    scene.fumarole.blur_samples = 256
    expected, found = by_cycles(1024, 1), by_fumarole(tmp_path)
    assert found[..., :3].sum() == pytest.approx(expected[..., :3].sum(), rel=0.02)
    # 256 squares of light leave some texture.
    assert relative_rms(found[..., :3], expected[..., :3]) < 0.1
    blocks = (16, 3, 16, 3, 4)
    means = [item.reshape(blocks).mean((1, 3)) for item in (found, expected)]
    assert relative_rms(*means) < 0.03
    if blades == 3:
        dof.aperture_rotation += np.pi / blades
        turned = by_fumarole(tmp_path).reshape(blocks).mean((1, 3))
        assert relative_rms(turned, means[1]) > 0.08


@pytest.mark.parametrize("position", ["START", "CENTER"])
def test_moving_camera_and_solids(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, position: str) -> None:
    """Smoke and a holdout pass a camera that moves and turns; another holdout goes its own way."""
    build(monkeypatch)
    scene = bpy.context.scene
    still = scenes.plane("Still", 1.0, location=(0.5, -1.2, 0.6), rotation=(70, 0, 0))
    moving = scenes.plane("Moving", 0.9, location=(-0.5, -1.5, 0.4), rotation=(60, -20, 0))
    still.is_holdout = moving.is_holdout = True
    scene.frame_set(10)
    for owner, path, axis, step in (
        (scene.camera, "location", 0, 0.6),
        (scene.camera, "rotation_euler", 2, -0.05),
        (moving, "location", 2, 0.8),
    ):
        start = getattr(owner, path)[axis]
        owner.driver_add(path, axis).driver.expression = f"{start} + {step} * (frame - 10)"
    scene.render.use_motion_blur = True
    scene.render.motion_blur_shutter = 1.0
    compat.shutter_settings(scene).motion_blur_position = position
    check_blur(tmp_path, 6)
    assert scene.frame_current == 10


def test_both_at_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    build(monkeypatch)
    scene = bpy.context.scene
    wall = scenes.plane("Wall", 1.0, location=(0.4, -1.6, 0.6), rotation=(70, 0, 0))
    wall.is_holdout = True
    scene.frame_set(10)
    wall.driver_add("location", 0).driver.expression = "0.4 + 1.2 * (frame - 10)"
    scene.render.use_motion_blur = True
    scene.render.motion_blur_shutter = 1.0
    open_aperture(0.08, 5.0)
    check_blur(tmp_path)
