# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's settings of motion blur and depth of field as the camera has them."""

from __future__ import annotations

import math

import bpy
import pytest
import scenes
from test_blur import exported, move, open_aperture, open_shutter

from fumarole import core


@pytest.mark.parametrize(
    ("position", "expected"), [("START", (0.0, 0.8)), ("CENTER", (-0.4, 0.4)), ("END", (-0.8, 0.0))]
)
def test_shutter(scene: bpy.types.Scene, position: str, expected: tuple[float, float]) -> None:
    scenes.camera()
    assert exported().shutter == (0.0, 0.0)
    open_shutter(0.8, position)
    assert exported().shutter == pytest.approx(expected)
    layer = bpy.context.view_layer
    if hasattr(layer, "use_motion_blur"):
        layer.use_motion_blur = False
        assert exported().shutter == (0.0, 0.0)


def test_shutter_that_is_not_modelled_is_named(scene: bpy.types.Scene) -> None:
    scenes.camera()
    open_shutter()
    assert not any("Motion blur" in text for text in scenes.export().warnings)
    scene.render.motion_blur_shutter_curve.curves[0].points[0].location[1] = 0.0
    assert any("shutter curve" in text for text in scenes.export().warnings)
    scene.cycles.rolling_shutter_type = "TOP"
    assert any("rolling shutter" in text for text in scenes.export().warnings)


@pytest.mark.parametrize(("kind", "radius"), [("PERSP", 35e-3 / 2 / 1.4), ("ORTHO", 1 / 2 / 1.4)])
def test_aperture(kind: str, radius: float) -> None:
    owner = scenes.camera(type=kind, lens=35)
    assert exported().aperture == core.Aperture()
    open_aperture(1.4, 3.0)
    aperture = exported().aperture
    assert (aperture.radius, aperture.focus, aperture.blades) == (pytest.approx(radius), pytest.approx(3.0), 0)
    dof = owner.data.dof
    dof.aperture_blades, dof.aperture_rotation, dof.aperture_ratio = 5, 0.3, 2.0
    aperture = exported().aperture
    assert (aperture.blades, aperture.ratio) == (5, pytest.approx(2.0))
    # Cycles has the middle of a side where ours have a corner.
    assert aperture.rotation == pytest.approx(0.3 + math.pi / 5)
    dof.aperture_blades = 2
    assert exported().aperture.blades == 0
    dof.focus_distance = 0.0
    assert 0 < exported().aperture.focus < 1e-4


def test_focus_object(scene: bpy.types.Scene) -> None:
    """The distance along the axis, of where it is now, also of a bone."""
    owner = scenes.camera(location=(0, -8, 0))
    open_aperture(focus=1.0)
    target = scenes.link("Target", None, location=(3, 0, 2))
    target.hide_render = True
    move(target, 1, "0.5 * frame")
    owner.data.dof.focus_object = target
    for frame in (2, 6):
        scene.frame_set(frame)
        assert exported().aperture.focus == pytest.approx(8 + 0.5 * frame)
    armature = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    scene.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    bone = armature.data.edit_bones.new("Hand")
    bone.head, bone.tail = (0, 4, 0), (0, 5, 0)
    bpy.ops.object.mode_set(mode="OBJECT")
    armature.location.y = 1
    owner.data.dof.focus_object, owner.data.dof.focus_subtarget = armature, "Hand"
    assert exported().aperture.focus == pytest.approx(8 + 1 + 4)
    owner.data.dof.focus_subtarget = "No such bone"
    assert exported().aperture.focus == pytest.approx(8 + 1)
