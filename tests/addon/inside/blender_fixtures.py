# SPDX-License-Identifier: GPL-3.0-or-later
"""pytest fixtures inside Blender."""

from __future__ import annotations

import bpy
import pytest


@pytest.fixture(autouse=True)
def scene() -> bpy.types.Scene:
    """An empty scene of 64 x 64 pixels that Fumarole renders, fresh for every test."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    result = bpy.context.scene
    result.render.engine = "FUMAROLE"
    result.render.resolution_x = result.render.resolution_y = 64
    result.render.resolution_percentage = 100
    result.frame_end = 30
    return result
