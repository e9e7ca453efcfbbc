# SPDX-License-Identifier: GPL-3.0-or-later
"""Light units. The figures are those measured with Cycles on a white plane, as closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fumarole import core
from fumarole.core import units

ABOVE = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2.0], [0, 0, 0, 1]])
UP = (0.0, 0.0, 1.0)
OLD, NEW = (3, 4), (4, 2)


def light_on_plane(*points: tuple[float, float, float], **light: object) -> np.ndarray:
    """Irradiance at points of the plane z = 0 with nothing in the way."""
    with core.Context() as context:
        scene = core.Scene(context)
        scene.add_light(**{"matrix": ABOVE} | light)
        settings = core.Settings(light_samples=1024)
        return core.irradiance(scene, points or [(0, 0, 0)], normals=UP, settings=settings)


def test_point_light() -> None:
    color = np.array([1.0, 0.5, 0.25])
    expected = 100 / (4 * math.pi) / 4 * color
    np.testing.assert_allclose(light_on_plane(type="POINT", power=100, color=color)[0], expected, rtol=1e-5)
    oblique = 100 / (4 * math.pi) / 8 * math.sqrt(0.5)
    np.testing.assert_allclose(light_on_plane((2, 0, 0), type="POINT", power=100)[0], oblique, rtol=1e-5)


def test_point_light_with_radius_is_a_disc_that_faces_the_point() -> None:
    expected = 100 / (4 * math.pi) / (4 + 0.25)
    np.testing.assert_allclose(light_on_plane(type="POINT", power=100, radius=0.5)[0], expected, rtol=5e-3)


@pytest.mark.parametrize("version", [OLD, NEW])
def test_sun(version: tuple[int, int]) -> None:
    angle = 1.0
    factor = 2 * (1 / math.cos(0.5) - 1) / math.tan(0.5) ** 2 if version == OLD else 1.0
    found = light_on_plane(type="SUN", power=3, angle=angle, cycles=version)[0]
    np.testing.assert_allclose(found, 3 * factor, rtol=5e-3)
    np.testing.assert_allclose(light_on_plane(type="SUN", power=3, cycles=version)[0], 3, rtol=1e-5)


@pytest.mark.parametrize("version", [OLD, NEW])
def test_spot(version: tuple[int, int]) -> None:
    angle, blend = math.radians(60), 0.5
    cosine = 2 / math.hypot(2, 0.9)
    share = (cosine - math.cos(angle / 2)) / ((1 - math.cos(angle / 2)) * blend)
    soft = share * share * (3 - 2 * share) if share < 1 else 1.0
    expected = 50 / (4 * math.pi) / (4 + 0.81) * cosine * soft * (cosine if version == OLD else 1.0)
    points = [(0.9, 0, 0), (2 * math.tan(angle / 2) + 0.01, 0, 0)]
    found = light_on_plane(*points, type="SPOT", power=50, spot_angle=angle, spot_blend=blend, cycles=version)
    np.testing.assert_allclose(found[0], expected, rtol=1e-4)
    assert not found[1].any()


def test_scale_shapes_the_cone_of_a_spot_except_in_3_4() -> None:
    wide = ABOVE @ np.diag([2.0, 2.0, 1.0, 1.0])
    options = {"type": "SPOT", "power": 50, "spot_angle": math.radians(60), "spot_blend": 0.0, "matrix": wide}
    outside = (1.5, 0, 0)
    assert not light_on_plane(outside, **options, cycles=OLD).any()
    assert light_on_plane(outside, **options, cycles=NEW).all()


@pytest.mark.parametrize(("version", "factor"), [(OLD, 1 / 4), (NEW, 1 / math.pi)])
@pytest.mark.parametrize(("shape", "share"), [("RECTANGLE", 1.0), ("ELLIPSE", math.pi / 4)])
def test_area_radiance_far_away(version: tuple[int, int], factor: float, shape: str, share: float) -> None:
    far = ABOVE.copy()
    far[2, 3] = 50
    found = light_on_plane(type="AREA", power=1000, shape=shape, size=0.4, size_y=0.2, matrix=far, cycles=version)
    np.testing.assert_allclose(found[0], 1000 * factor / 50**2, rtol=1e-3)
    without = units.area_radiance(np.ones(3), 0.08 * share, normalize=False, cycles=version)
    np.testing.assert_allclose(without, 1 / math.pi)


def test_area_light_near_a_large_square() -> None:
    """The form factor of a square above a point, by the closed form of a rectangle seen from its corner's normal."""
    a = 1.0 / 2.0
    corner = 2 / (2 * math.pi) * a / math.hypot(1, a) * math.atan(a / math.hypot(1, a))
    radiance = 10 / (math.pi * 4)
    expected = math.pi * radiance * 4 * corner
    np.testing.assert_allclose(light_on_plane(type="AREA", power=10, size=2.0)[0], expected, rtol=5e-3)


def test_scale_of_the_matrix_enlarges_an_area_light() -> None:
    scaled = light_on_plane(type="AREA", power=10, size=0.5, matrix=ABOVE @ np.diag([4.0, 4.0, 1.0, 1.0]))
    np.testing.assert_allclose(scaled, light_on_plane(type="AREA", power=10, size=2.0), rtol=1e-5)


def test_square_and_disk_ignore_the_second_size() -> None:
    for shape in ("SQUARE", "DISK"):
        one = light_on_plane(type="AREA", power=10, shape=shape, size=0.5, size_y=3.0)
        np.testing.assert_array_equal(one, light_on_plane(type="AREA", power=10, shape=shape, size=0.5))


@pytest.mark.parametrize("nothing", [{"size": 0.0}, {"matrix": np.diag([0.0, 0, 0, 1])}])
def test_area_light_without_a_surface_emits_nothing(nothing: dict[str, object]) -> None:
    assert not light_on_plane(type="AREA", power=10, **nothing).any()


def test_without_normalize_the_radiance_is_that_of_a_square_metre() -> None:
    power = np.array([1.0, 2.0, 3.0])
    disc = math.pi * 0.5**2
    np.testing.assert_allclose(units.point_intensity(power, 0.5, normalize=False), power / math.pi * disc)
    np.testing.assert_allclose(units.point_intensity(power, 0.0, normalize=False), power / math.pi)
    solid_angle = math.pi * math.sin(0.1) ** 2
    np.testing.assert_allclose(units.sun_irradiance(power, 0.2, normalize=False), power * solid_angle)
    np.testing.assert_allclose(units.sun_irradiance(power, 0.0, normalize=False), power)


def test_narrow_sun_of_3_4_has_no_division_by_zero() -> None:
    for angle in (0.0, 1e-12, 1e-4):
        np.testing.assert_allclose(units.sun_irradiance(np.ones(3), angle, cycles=OLD), 1.0, rtol=1e-8)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"type": "HEMI"}, "type of 'key' is 'HEMI', expected one of POINT, SPOT, SUN, AREA"),
        ({"type": "AREA", "shape": "STAR"}, "shape of 'key' is 'STAR'"),
        ({"type": "AREA", "size": -1.0}, "the size of area light 'key' is -1.0 x -1.0 m, expected finite and at least 0"),
        ({"type": "AREA", "size": math.nan}, "the size of area light 'key' is nan x nan m"),
        ({"type": "SPOT", "matrix": np.diag([0.0, 1, 1, 1]), "cycles": OLD}, "matrix of 'key' has the scale"),
        ({"type": "POINT", "power": "bright"}, "power of 'key' is 'bright', expected a number"),
        ({"type": "POINT", "color": (1, 2)}, r"color of 'key' is \(1, 2\), expected a number or three"),
        ({"type": "POINT", "power": -1.0}, "key"),
        ({"type": "POINT", "power": math.nan}, "key"),
        ({"type": "POINT", "radius": -0.5}, "key"),
        ({"type": "SUN", "angle": 4.0}, "key"),
        ({"type": "SPOT", "spot_angle": 0.0}, "key"),
        ({"type": "SPOT", "spot_blend": 1.5}, "key"),
        ({"type": "AREA", "spread": 0.0}, "key"),
    ],
)
def test_wrong_values_name_the_light(options: dict[str, object], message: str) -> None:
    scene = core.Scene()
    with pytest.raises(core.FumaroleError, match=message) as caught:
        scene.add_light(name="key", **options)
    assert caught.value.code == core.ErrorCode.ARGUMENT


def test_lights_are_numbered_in_order_and_cleared() -> None:
    scene = core.Scene()
    assert [scene.add_light("POINT"), scene.add_light("SUN")] == [0, 1]
    scene.clear_lights()
    assert scene.add_light("AREA") == 0
    with pytest.raises(core.FumaroleError, match="light"):
        core.transmittance(scene, [(0, 0, 0)], light=1)
