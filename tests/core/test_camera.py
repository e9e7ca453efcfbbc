# SPDX-License-Identifier: GPL-3.0-or-later
"""The camera's window. Numbers worked out by hand from Blender's lens and sensor rules."""

from __future__ import annotations

import numpy as np
import pytest

from fumarole import core


def window(**options: object) -> tuple[float, ...]:
    return core.Camera(**options).window


def test_default_lens_is_36_mm_over_50_mm_across_the_larger_side() -> None:
    assert window(width=512, height=512) == pytest.approx((-0.36, 0.36, -0.36, 0.36))
    assert window(width=1920, height=1080) == pytest.approx((-0.36, 0.36, -0.2025, 0.2025))
    assert window(width=1080, height=1920) == pytest.approx((-0.2025, 0.2025, -0.36, 0.36))


def test_sensor_fit_chooses_the_side() -> None:
    assert window(width=100, height=200, sensor_fit="HORIZONTAL") == pytest.approx((-0.36, 0.36, -0.72, 0.72))
    vertical = window(width=200, height=100, sensor_fit="VERTICAL", sensor_height=24)
    assert vertical == pytest.approx((-0.48, 0.48, -0.24, 0.24))


def test_pixel_aspect_stretches_and_decides_the_automatic_fit() -> None:
    assert window(width=100, height=100, pixel_aspect=(2, 1)) == pytest.approx((-0.36, 0.36, -0.18, 0.18))
    assert window(width=120, height=100, pixel_aspect=(1, 2)) == pytest.approx((-0.216, 0.216, -0.36, 0.36))


def test_shift_is_in_units_of_the_fitted_side() -> None:
    shifted = window(width=200, height=100, shift=(0.5, -0.25))
    assert shifted == pytest.approx((0.0, 0.72, -0.36, 0.0))


def test_orthographic_scale_is_the_larger_side() -> None:
    assert window(type="ORTHOGRAPHIC", ortho_scale=8, width=200, height=100) == pytest.approx((-4, 4, -2, 2))


def test_crop_keeps_the_pixels_where_they_are() -> None:
    camera = core.Camera(width=100, height=50, shift=(0.1, 0.2), clip=(1, 2))
    part = camera.crop(10, 20, 40, 45)
    left, right, bottom, top = camera.window
    expected = (left + 0.1 * (right - left), left + 0.4 * (right - left))
    expected += (bottom + 0.4 * (top - bottom), bottom + 0.9 * (top - bottom))
    assert part.window == pytest.approx(expected)
    assert (part.width, part.height, part.type, part.clip) == (30, 25, "PERSPECTIVE", (1.0, 2.0))
    assert camera.crop(0, 0, 100, 50).window == pytest.approx(camera.window)


def test_from_window_keeps_what_it_is_given() -> None:
    camera = core.Camera.from_window(np.diag([1, 2, 3, 1]), (-1, 2, -3, 4), 7, 5, "ORTHOGRAPHIC", (0, 9))
    struct = camera.struct()
    assert list(struct.window) == [-1, 2, -3, 4]
    assert list(struct.world_from_camera) == [1, 0, 0, 0, 0, 2, 0, 0, 0, 0, 3, 0, 0, 0, 0, 1]
    assert (struct.width, struct.height, struct.type, struct.clip_start, struct.clip_end) == (7, 5, 1, 0, 9)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"lens": 0}, "camera: lens is 0, expected above 0"),
        ({"sensor": -1.0}, "camera: sensor is -1.0, expected above 0"),
        ({"sensor_fit": "DIAGONAL"}, "camera: sensor_fit is 'DIAGONAL', expected one of AUTO, HORIZONTAL, VERTICAL"),
        ({"type": "PANO"}, "camera: type is 'PANO', expected one of PERSPECTIVE, ORTHOGRAPHIC"),
        ({"matrix": np.eye(3)}, r"camera: matrix has shape \(3, 3\), expected \(4, 4\)"),
        ({"matrix": np.full((4, 4), np.nan)}, "camera: matrix holds nan, expected finite numbers"),
        ({"pixel_aspect": (1, 0)}, "camera: pixel_aspect is 0, expected above 0"),
        ({"width": 0}, "camera: width is 0, expected above 0"),
        ({"lens": "wide"}, "camera: lens is 'wide', expected a number"),
        ({"lens": float("nan")}, "camera: lens is nan, expected above 0"),
    ],
)
def test_wrong_values_are_named(options: dict[str, object], message: str) -> None:
    with pytest.raises(core.FumaroleError, match=message) as caught:
        core.Camera(**options)
    assert caught.value.code == core.ErrorCode.ARGUMENT


def test_empty_crop_is_an_error() -> None:
    with pytest.raises(core.FumaroleError, match=r"the crop from \(5, 0\) to \(5, 9\) is empty"):
        core.Camera().crop(5, 0, 5, 9)


@pytest.mark.parametrize(
    ("shutter", "aperture", "message"),
    [
        ((0.5, 0.25), {}, "shutter from 0.5 to 0.25"),
        ((-1.5, 0), {}, "shutter from -1.5 to 0"),
        ((0, 0), {"radius": -1.0}, "aperture_radius is -1"),
        ((0, 0), {"focus": 0.0}, "focus_distance is 0"),
        ((0, 0), {"blades": 2}, "aperture_blades is 2"),
        ((0, 0), {"rotation": float("inf")}, "aperture_rotation is inf"),
        ((0, 0), {"ratio": 0.0}, "aperture_ratio is 0"),
    ],
)
def test_blur_is_checked(shutter: tuple[float, float], aperture: dict[str, float], message: str) -> None:
    camera = core.Camera(width=8, height=8).blurred(shutter, core.Aperture(**aperture))
    with pytest.raises(core.FumaroleError, match=message):
        core.render(core.Scene(), camera)
