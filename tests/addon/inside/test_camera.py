# SPDX-License-Identifier: GPL-3.0-or-later
"""The camera against Blender's own projection matrix."""

from __future__ import annotations

import itertools

import bpy
import numpy as np
import pytest
import scenes


def blender_window(owner: bpy.types.Object, orthographic: bool) -> np.ndarray:
    """(left, right, bottom, top) at unit depth out of calc_matrix_camera."""
    render = bpy.context.scene.render
    percentage = render.resolution_percentage / 100
    matrix = np.array(
        owner.calc_matrix_camera(
            bpy.context.evaluated_depsgraph_get(),
            x=int(render.resolution_x * percentage),
            y=int(render.resolution_y * percentage),
            scale_x=render.pixel_aspect_x,
            scale_y=render.pixel_aspect_y,
        )
    )
    offset = matrix[:2, 3] if orthographic else -matrix[:2, 2]
    scale = np.diag(matrix)[:2]
    (left, bottom), (right, top) = (-1 - offset) / scale, (1 - offset) / scale
    return np.array((left, right, bottom, top))


@pytest.mark.parametrize("size", [(64, 48), (48, 64), (37, 37)])
@pytest.mark.parametrize("aspect", [(1, 1), (2, 1), (1, 1.7)])
def test_window_is_blenders(scene: bpy.types.Scene, size: tuple[int, int], aspect: tuple[float, float]) -> None:
    owner = scenes.camera(sensor_width=31, sensor_height=17, lens=28, ortho_scale=5, shift_x=0.13, shift_y=-0.2)
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = aspect
    for fit, kind, percentage in itertools.product(("AUTO", "HORIZONTAL", "VERTICAL"), ("PERSP", "ORTHO"), (100, 51)):
        owner.data.sensor_fit, owner.data.type = fit, kind
        scene.render.resolution_percentage = percentage
        (result,) = scenes.export_layers()
        expected = blender_window(owner, kind == "ORTHO")
        width, height = size[0] * percentage // 100, size[1] * percentage // 100
        assert (result.camera.width, result.camera.height) == (width, height)
        assert np.allclose(result.camera.window, expected, atol=2e-6 * np.ptp(expected)), (fit, kind, percentage)


def test_matrix_and_clipping(scene: bpy.types.Scene) -> None:
    owner = scenes.camera(location=(1, 2, 3), rotation=(70, 10, 30), clip_start=0.5, clip_end=77)
    owner.scale = (2, 2, 2)
    (result,) = scenes.export_layers()
    bpy.context.view_layer.update()
    assert np.allclose(result.camera.matrix, np.array(owner.matrix_world.normalized()), atol=1e-6)
    assert result.camera.clip == (0.5, 77)


def test_border_is_part_of_the_whole_window(scene: bpy.types.Scene) -> None:
    scenes.camera(shift_x=0.1)
    (whole,) = scenes.export_layers()
    render = scene.render
    render.use_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.7, 0.1, 0.6
    (part,) = scenes.export_layers()
    assert (part.camera.width, part.camera.height) == (int(64 * 0.7) - 16, int(64 * 0.6) - 6)
    step = (whole.camera.window[1] - whole.camera.window[0]) / 64
    assert part.camera.window[0] == pytest.approx(whole.camera.window[0] + 16 * step)
    assert part.camera.window[3] == pytest.approx(whole.camera.window[2] + 38 * step)


def test_camera_follows_its_animation_and_parent(scene: bpy.types.Scene) -> None:
    owner = scenes.camera(location=(0, 0, 0))
    parent = scenes.link("Dolly", None, location=(0, 0, 2))
    owner.parent = parent
    parent.keyframe_insert("location", frame=1)
    parent.location = (0, 0, 12)
    parent.keyframe_insert("location", frame=11)
    scene.frame_set(11)
    (result,) = scenes.export_layers()
    assert np.allclose(result.camera.matrix[:3, 3], (0, 0, 12))


def test_panorama_is_an_error_that_names_the_camera(scene: bpy.types.Scene) -> None:
    scenes.camera(type="PANO")
    scene.render.engine = "FUMAROLE"
    with pytest.raises(RuntimeError, match="'Camera'.*PANO"):
        bpy.ops.render.render()


def test_another_object_as_camera_is_an_error_that_names_it(scene: bpy.types.Scene) -> None:
    scene.camera = scenes.light("SPOT")
    with pytest.raises(RuntimeError, match="'Spot'"):
        bpy.ops.render.render()


