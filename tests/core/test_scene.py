# SPDX-License-Identifier: GPL-3.0-or-later
"""What scenes take and what they refuse."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fumarole import core

POSITION = np.random.default_rng(1).normal(0, 0.5, (50, 3)).astype(np.float32)
POINTS = [(0.0, 0.0, -1.0), (0.5, 0.0, -2.0), (-1.0, 1.0, 0.0)]
ABOVE = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4.0], [0, 0, 0, 1]])


def shares(**particles: object) -> np.ndarray:
    """Transmittance from a lamp above through one set of particles."""
    with core.Context() as context:
        scene = core.Scene(context)
        scene.add_particles(**{"position": POSITION} | particles)
        scene.add_light("POINT", matrix=ABOVE)
        return core.transmittance(scene, POINTS)


def test_numbers_and_arrays_say_the_same() -> None:
    expected = shares(radius=0.3, density=2.0)
    assert ((0 < expected) & (expected < 1)).all()
    np.testing.assert_array_equal(shares(radius=np.full(50, 0.3), density=np.full(50, 2.0)), expected)
    np.testing.assert_array_equal(shares(radius=np.float64(0.3), density=2), expected)


def test_layout_and_type_of_arrays_do_not_matter() -> None:
    expected = shares(radius=0.3)
    np.testing.assert_array_equal(shares(position=POSITION.astype(np.float64), radius=0.3), expected)
    np.testing.assert_array_equal(shares(position=np.asfortranarray(POSITION), radius=0.3), expected)
    np.testing.assert_array_equal(shares(position=np.repeat(POSITION, 2, axis=0)[::2], radius=0.3), expected)
    np.testing.assert_array_equal(shares(position=POSITION.tolist(), radius=0.3), expected)


def test_arrays_are_copied() -> None:
    with core.Context() as context:
        position = POSITION.copy()
        scene = core.Scene(context)
        scene.add_particles(position, radius=0.3)
        scene.add_light("POINT", matrix=ABOVE)
        position[:] = 100.0
        np.testing.assert_array_equal(core.transmittance(scene, POINTS), shares(radius=0.3))


def test_no_particles_are_allowed() -> None:
    for none in (np.zeros((0, 3)), np.zeros((0, 3), np.float32)):
        np.testing.assert_array_equal(shares(position=none, radius=np.zeros(0), albedo=np.zeros((0, 3))), 1.0)


def test_every_optional_array_is_accepted() -> None:
    expected = shares(radius=0.3)
    found = shares(
        radius=0.3,
        albedo=np.full((50, 3), 0.5),
        emission=(0.1, 0.2, 0.3),
        velocity=(0.0, 0.0, 1.0),
        ident=np.arange(50)[::-1] + 2**40,
        anisotropy=-0.5,
    )
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(
    ("particles", "message"),
    [
        ({"position": np.zeros((5, 2))}, r"position of 'puff' has shape \(5, 2\), expected \(n, 3\)"),
        ({"position": np.zeros(3)}, r"position of 'puff' has shape \(3,\), expected \(n, 3\)"),
        ({"position": [["a", 0, 0]]}, "position of 'puff' is not an array of numbers"),
        ({"radius": np.zeros(49)}, r"radius of 'puff' has shape \(49,\), expected a number or \(50,\)"),
        ({"density": np.zeros((50, 1))}, r"density of 'puff' has shape \(50, 1\), expected a number or \(50,\)"),
        ({"albedo": np.zeros((49, 3))}, r"albedo of 'puff' has shape \(49, 3\), expected \(50, 3\)"),
        ({"albedo": (0.1, 0.2)}, r"albedo of 'puff' is \(0.1, 0.2\), expected a number or three"),
        ({"emission": np.zeros((50, 4))}, r"emission of 'puff' has shape \(50, 4\), expected \(50, 3\)"),
        ({"velocity": np.zeros((2, 3))}, r"velocity of 'puff' has shape \(2, 3\), expected \(50, 3\)"),
        ({"ident": np.zeros(50)}, "ident of 'puff' has type float64, expected integers"),
        ({"ident": np.arange(50) - 1}, "ident of 'puff' holds -1, expected 0 to 18446744073709551615"),
        ({"ident": np.arange(49)}, r"ident of 'puff' has shape \(49,\), expected \(50,\)"),
        ({"anisotropy": 1.0}, "puff"),
        ({"radius": -0.5}, "puff.*-0.5"),
        ({"density": math.nan}, "puff.*nan"),
        ({"albedo": 1.5}, "puff.*1.5"),
        ({"emission": -1.0}, "puff.*-1"),
        ({"radius": 1e300}, "puff.*inf"),
    ],
)
def test_wrong_particles_are_named(particles: dict[str, object], message: str) -> None:
    with pytest.raises(core.FumaroleError, match=message) as caught:
        shares(name="puff", **particles)
    assert caught.value.code == core.ErrorCode.ARGUMENT


SQUARE = np.array([(-1, -1, 2), (1, -1, 2), (1, 1, 2), (-1, 1, 2)], np.float32)
FACES = np.array([(0, 1, 2), (0, 2, 3)])


def lit(vertices: object = SQUARE, triangles: object = FACES, settings: core.Settings | None = None, **mesh: object):
    """Share of the lamp's light below and beside a square in its way."""
    with core.Context() as context:
        scene = core.Scene(context)
        scene.add_mesh(vertices, triangles, **mesh)
        scene.add_light("POINT", matrix=ABOVE)
        return core.transmittance(scene, [(0, 0, 0), (3.5, 0, 0), (0, 0, 3)], settings=settings).tolist()


def test_mesh_casts_a_shadow() -> None:
    assert lit() == [0.0, 1.0, 1.0]
    assert lit(visible_to_camera=False) == [0.0, 1.0, 1.0]
    assert lit(visible_to_shadow=False) == [1.0, 1.0, 1.0]
    assert lit(settings=core.Settings(solid_shadow_intensity=0.25)) == [0.75, 1.0, 1.0]


def test_matrix_moves_the_mesh() -> None:
    aside = np.eye(4)
    aside[0, 3] = 1.75
    assert lit(matrix=aside) == [1.0, 0.0, 1.0]


@pytest.mark.parametrize("kind", [np.int32, np.uint32, np.int64, np.uint8])
def test_triangles_of_any_integer_type(kind: type) -> None:
    assert lit(triangles=FACES.astype(kind)) == [0.0, 1.0, 1.0]


def test_mesh_without_triangles_is_allowed() -> None:
    assert lit(triangles=[]) == [1.0, 1.0, 1.0]
    assert lit(vertices=np.zeros((0, 3)), triangles=np.zeros((0, 3), int)) == [1.0, 1.0, 1.0]


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        ({"triangles": [(0, 1, 4)]}, "wall.*4"),
        ({"triangles": [(0, 1, -1)]}, "triangles of 'wall' holds -1, expected 0 to 4294967295"),
        ({"triangles": [(0, 1, 2, 3)]}, r"triangles of 'wall' has shape \(1, 4\), expected \(m, 3\)"),
        ({"triangles": [(0.0, 1.0, 2.0)]}, "triangles of 'wall' has type float64, expected integers"),
        ({"vertices": np.zeros((4, 2))}, r"vertices of 'wall' has shape \(4, 2\), expected \(n, 3\)"),
        ({"vertices": np.where(SQUARE > 1, np.inf, SQUARE)}, "wall"),
        ({"matrix": np.eye(2)}, r"matrix of 'wall' has shape \(2, 2\), expected \(4, 4\)"),
    ],
)
def test_wrong_meshes_are_named(mesh: dict[str, object], message: str) -> None:
    with pytest.raises(core.FumaroleError, match=message) as caught:
        lit(name="wall", **mesh)
    assert caught.value.code == core.ErrorCode.ARGUMENT


def test_particles_born_on_a_surface_are_lit() -> None:
    """An emitter's newborn particles lie in its surface: light from its front reaches them, from its back it doesn't."""
    position = np.random.default_rng(1).uniform(-1, 1, (200, 3)) * (1, 1, 1e-7)
    for height, is_lit in ((4.0, True), (-4.0, False)):
        scene = core.Scene(core.Context())
        scene.add_particles(position, radius=0.2, density=1.0)
        scene.add_mesh([(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)], [(0, 1, 2), (0, 2, 3)])
        lamp = np.eye(4)
        lamp[2, 3] = height
        scene.add_light("POINT", matrix=lamp, power=1000.0)
        above = np.eye(4)
        above[2, 3] = 5.0
        view = core.Camera(matrix=above, type="ORTHOGRAPHIC", ortho_scale=1.0, width=8, height=8)
        assert (core.render(scene, view)["Combined"][..., 0].min() > 0.01) == is_lit
