# SPDX-License-Identifier: GPL-3.0-or-later
"""Solids in the picture: shaded against closed forms and the reference, holdouts, edges, sums of passes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fumarole import core

SHADED = core.Settings(solids="SHADED")
NOTHING = {"position": np.zeros((0, 3))}
BALL = {"position": [(0.2, 0.1, 1.2), (-0.5, 0.4, 0.9)], "radius": 1.1, "density": 1.5, "albedo": 0.7}
SQUARE = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float)
FACES = [(0, 1, 2), (0, 2, 3)]
ALBEDO = np.array([0.9, 0.5, 0.2])
DEVICES = ["TILES", "GL"]


def at(x: float, y: float, z: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def tilted(degrees: float, x: float, y: float, z: float) -> np.ndarray:
    """Turned about y."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    matrix = at(x, y, z)
    matrix[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    return matrix


LIGHTS = {
    "point": {"type": "POINT", "power": 100.0, "matrix": at(1.0, -0.5, 3.0)},
    "soft point": {"type": "POINT", "power": 100.0, "matrix": at(1.0, -0.5, 3.0), "radius": 0.3},
    "sun": {"type": "SUN", "power": 2.0, "matrix": tilted(40, 0, 0, 5)},
    "spot": {"type": "SPOT", "power": 200.0, "matrix": at(0.2, 0.1, 4.0), "spot_angle": 1.5, "spot_blend": 0.4},
    "area": {"type": "AREA", "power": 60.0, "matrix": tilted(20, 1.0, 0.0, 3.5), "size": 0.8},
}


def make(lights: list[dict], particles: dict = NOTHING, threads: int = 0) -> core.Scene:
    scene = core.Scene(core.Context(threads=threads))
    scene.add_particles(**particles)
    for light in lights:
        scene.add_light(**light)
    return scene


def floor(scene: core.Scene, half: float = 10.0, z: float = 0.0, **look) -> None:
    scene.add_mesh(half * SQUARE + (0, 0, z), FACES, **({"albedo": ALBEDO} | look))


def frame(size: int = 32, scale: float = 4.0, **camera) -> core.Camera:
    """From above."""
    given = {"matrix": at(0, 0, 8.0), "type": "ORTHOGRAPHIC", "ortho_scale": scale, "width": size, "height": size}
    return core.Camera(**(given | camera))


def floor_points(size: int = 32, scale: float = 4.0) -> np.ndarray:
    axis = (np.arange(size) + 0.5) / size * scale - scale / 2
    x, y = np.meshgrid(axis, axis)
    return np.stack([x, y, np.zeros_like(x)], -1)


def combined(scene: core.Scene, view: core.Camera, **settings) -> np.ndarray:
    chosen = core.Settings(**({"solids": "SHADED"} | settings))
    return core.render(scene, view, chosen, ["Combined"])["Combined"].astype(float)


def rms(found: np.ndarray, expected: np.ndarray) -> float:
    """Relative to the expected."""
    return float(np.sqrt(((found - expected) ** 2).mean() / (expected**2).mean()))


def lit_floor(*lights: str, particles: dict = NOTHING, threads: int = 0) -> core.Scene:
    scene = make([LIGHTS[light] for light in lights], particles, threads)
    floor(scene)
    return scene


@pytest.mark.parametrize("device", DEVICES)
def test_lambert_has_a_closed_form(device: str) -> None:
    """I cos / d^2 of a point light, E cos of a sun, times albedo / pi."""
    line = np.array([1.0, -0.5, 3.0]) - floor_points()
    intensity = LIGHTS["point"]["power"] / (4 * math.pi)
    point = intensity * line[..., 2] / np.linalg.norm(line, axis=-1) ** 3
    sun = np.full((32, 32), 2.0 * math.cos(math.radians(40)))
    for light, irradiance in (("point", point), ("sun", sun)):
        found = combined(lit_floor(light), frame(), device=device)
        assert np.allclose(found[..., :3], irradiance[..., None] * ALBEDO / math.pi, rtol=2e-4)
        assert (found[..., 3] == 1).all()


def test_a_floor_under_an_even_sky_has_a_closed_form() -> None:
    """Albedo times the sky's radiance, by the fast renderer and by the reference."""
    sky = np.array([0.5, 1.0, 2.0])
    scene = make([])
    scene.add_world(color=sky)
    floor(scene)
    result = core.render(scene, frame(8), SHADED, ["Combined", ("Light", 0)])
    expected = core.render_reference(scene, frame(4), solids="SHADED")["Combined"]
    for found in (result["Combined"], expected):
        assert np.allclose(found[..., :3], ALBEDO * sky, rtol=1e-4)
    assert np.allclose(result["Light", 0], result["Combined"][..., :3], rtol=1e-6)


@pytest.mark.parametrize("light", LIGHTS)
def test_each_light_shades_as_the_reference(light: str) -> None:
    """Without smoke and behind it."""
    for particles in (NOTHING, BALL):
        scene = lit_floor(light, particles=particles)
        found = combined(scene, frame(12, 2.0), light_samples=64)
        expected = core.render_reference(scene, frame(12, 2.0), 1e-3, 400, solids="SHADED")["Combined"]
        assert rms(found[..., :3], expected[..., :3]) < 0.004
        assert np.allclose(found[..., 3], 1) and np.allclose(expected[..., 3], 1)


def still_life(threads: int = 0) -> core.Scene:
    """A floor, a wall in front of it, one that glows and a holdout, in the smoke of two particles."""
    scene = make([LIGHTS["soft point"], LIGHTS["sun"]], BALL | {"emission": 0.1}, threads)
    floor(scene)
    scene.add_mesh(0.7 * SQUARE, FACES, tilted(25, -0.8, 0.3, 1.0), name="wall", albedo=(0.2, 0.6, 0.9))
    scene.add_mesh(0.4 * SQUARE, FACES, tilted(-15, 0.9, -0.9, 0.6), name="lamp", albedo=0.1, emission=(1.0, 0.5, 0.2))
    scene.add_mesh(0.5 * SQUARE, FACES, tilted(10, 0.7, 0.9, 1.4), name="matte", holdout=True)
    return scene


def test_smoke_around_solids_is_that_of_the_reference() -> None:
    scene, view = still_life(), frame(32)
    found = combined(scene, view, light_samples=64)
    expected = core.render_reference(scene, view, 1e-3, 144, solids="SHADED")["Combined"]
    # The reference looks at pixels' centres: where edges of solids and shadows are, it isn't the mean of the pixel.
    flat = np.ones((32, 32), bool)
    for axis in (0, 1):
        for channel in range(4):
            bend = np.abs(np.diff(expected[..., channel], 2, axis=axis, prepend=np.nan, append=np.nan))
            flat &= ~(bend > 0.05 * expected[..., channel].max())
    assert flat.mean() > 0.5
    assert rms(found[flat][:, :3], expected[flat][:, :3]) < 0.006
    assert np.allclose(found[flat][:, 3], expected[flat][:, 3], atol=0.004)
    assert expected[..., 3].min() < 0.7, "the matte is transparent"


def test_solids_through_tinted_smoke_with_linked_lights() -> None:
    """Each colour of a floor is seen through its own smoke, and each light shines on what it is linked to."""
    light = LIGHTS["point"] | {"light_sets": [0]}
    scene = make([light, LIGHTS["sun"]], BALL | {"extinction_color": (0.4, 1.0, 1.6)})
    floor(scene, light_set=1)
    scene.add_mesh(0.8 * SQUARE, FACES, tilted(5, 0, 0, 0.4), name="lit by both")
    scene.add_mesh(0.3 * SQUARE, FACES, at(0, 0, 1.5), name="matte", holdout=True)
    settings = core.Settings(solids="SHADED")
    result = core.render(scene, frame(24), settings, ["Combined", "Holdout", ("Light", 0), ("Light", 1), "Emit"])
    expected = core.render_reference(scene, frame(24), 1e-3, solids="SHADED")["Combined"]
    inside = np.ones((24, 24), bool)
    edges = np.abs(floor_points(24)[..., :2]).max(-1)
    for edge in (0.3, 0.8):
        inside &= np.abs(edges - edge) > 0.2
    flat = inside & (np.abs(result["Combined"] - expected).max(-1) < 0.2)
    assert flat.sum() > 0.9 * inside.sum(), "shadows' edges apart"
    assert rms(result["Combined"][flat], expected[flat]) < 0.01
    total = result["Emit"] + result["Light", 0] + result["Light", 1]
    assert np.abs(total - result["Combined"][..., :3]).max() <= 2e-6 * result["Combined"].max()
    held = result["Holdout"][12, 12]
    assert held[0] > 1.1 * held[1] > 1.2 * held[2]
    assert result["Combined"][12, 12, 3] == pytest.approx(1 - held.mean(), abs=1e-5)


def test_parts_add_up_to_combined() -> None:
    scene, view = still_life(), frame(48)
    result = core.render(scene, view, SHADED, ["Combined", "Emit", ("Light", 0), ("Light", 1), "Opacity"])
    total = result["Emit"] + result["Light", 0] + result["Light", 1]
    assert np.abs(total - result["Combined"][..., :3]).max() <= 2e-6 * result["Combined"].max()
    assert (result["Opacity"] == result["Combined"][..., 3:]).all()
    assert result["Emit"].max() > 0.5, "the lamp glows"
    same = core.render(scene, view, SHADED, ["Combined"])["Combined"]
    assert rms(same, result["Combined"]) < 1e-3, "with parts more pixels are looked at closely, and no more than that"
    held = core.render(scene, view, passes=["Emit", ("Light", 0)])
    assert held["Emit"].max() < 0.2 and held["Light", 0].max() < 0.8 * result["Light", 0].max()


def test_deep_pixels_hold_the_smoke_alone() -> None:
    scene, view = still_life(), frame(24)
    held = []
    for settings in (SHADED, core.Settings()):
        scene.context.clear_warnings()
        result = core.render(scene, view, settings, ["Combined"], deep=True)
        assert any("deep pixels hold the smoke alone" in text for text in result.warnings) == (settings is SHADED)
        with result.deep as samples:
            held.append(samples.samples)
    assert len(held[0]) > 0 and np.array_equal(*held)


def test_other_passes_are_those_of_holdouts() -> None:
    wanted = ["Depth", "Position", "Depth Front", "Depth Back", "Shadow", ("Light Shadow", 1)]
    scene = still_life()
    shaded, held = (core.render(scene, frame(), settings, wanted) for settings in (SHADED, None))
    assert all((shaded[name] == held[name]).all() for name in wanted)


@pytest.mark.parametrize("device", DEVICES)
def test_a_holdout_among_shaded_solids(device: str) -> None:
    """Its alpha is that of the smoke in front, and what a background may add is what neither takes."""
    scene, view = still_life(), frame(48)
    shaded, held = (
        core.render(scene, view, core.Settings(solids=solids, device=device), ["Combined", "Holdout"])
        for solids in ("SHADED", "HOLDOUT")
    )
    matte = shaded["Holdout"][..., 0] > 0
    assert 0.02 < matte.mean() < 0.3
    assert shaded["Combined"][~matte][:, 3] == pytest.approx(1, abs=1e-5), "the floor is everywhere"
    for result in (shaded, held):
        total = result["Combined"][..., 3] + result["Holdout"][..., 0]
        assert np.allclose(total, 1, atol=2e-5), "nothing is left for a background"
    inside = matte & (np.abs(shaded["Holdout"] - held["Holdout"]).max(-1) < 1e-6)
    assert inside.sum() > 0.5 * matte.sum(), "the rest are its edges"
    assert np.allclose(shaded["Combined"][inside], held["Combined"][inside], atol=1e-6)


def test_a_background_is_left_beside_solids() -> None:
    scene = make([LIGHTS["sun"]], BALL)
    scene.add_mesh(0.5 * SQUARE, FACES, at(0, 0, 0.5), holdout=True)
    result = core.render(scene, frame(40), None, ["Combined", "Holdout"])
    points = floor_points(40)
    beside = np.abs(points[..., :2]).max(-1) > 0.56
    assert (result["Holdout"][beside] == 0).all()
    within = np.abs(points[..., :2]).max(-1) < 0.44
    assert np.allclose(result["Combined"][within][:, 3] + result["Holdout"][within][:, 0], 1, atol=1e-6)
    empty = core.render(make([], BALL), frame(8), None, ["Holdout"])["Holdout"]
    assert (empty == 0).all()


def test_solids_are_shaded_from_both_sides() -> None:
    """A wall between the camera and a light is dark; where the light is on the camera's side it is lit."""
    for light_z, is_lit in ((3.0, True), (-3.0, False)):
        for order in (FACES, [face[::-1] for face in FACES]):
            scene = make([{"type": "POINT", "power": 100.0, "matrix": at(0, 0, light_z)}])
            scene.add_mesh(SQUARE, order)
            found = combined(scene, frame(8))
            assert (found[2:6, 2:6, 0] > 0.1).all() if is_lit else (found[..., :3] == 0).all()


def slanted(size: int, device: str, holdout: bool) -> dict:
    """A slanted wall in front of half of the smoke and of a floor, which has another colour in one half."""
    smoke = {"position": [(0.0, 0.0, 0.5), (0.4, 0.3, 0.9)], "radius": 2.0, "density": 0.8, "emission": 0.2}
    scene = make([LIGHTS["sun"]], smoke)
    wall = np.array([(-3.0, -3.0, 2.0), (0.13, -3.0, 2.0), (0.61, 3.0, 2.0), (-3.0, 3.0, 2.0)])
    scene.add_mesh(wall, FACES, albedo=(0.2, 0.3, 0.9), holdout=holdout)
    corners = np.array([(-9.0, -9.0, -1.0), (9.0, -9.0, -1.0), (9.0, 0.21, -1.0), (-9.0, 0.42, -1.0)])
    scene.add_mesh(corners, FACES, albedo=(0.9, 0.3, 0.1))
    corners = np.array([(-9.0, 0.42, -1.0), (9.0, 0.21, -1.0), (9.0, 1.5, -1.0), (-9.0, 1.5, -1.0)])
    scene.add_mesh(corners, FACES, albedo=(0.1, 0.8, 0.3))
    settings = core.Settings(solids="SHADED", device=device)
    return core.render(scene, frame(size), settings, ["Combined", "Holdout"])


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("holdout", [False, True])
def test_edges_are_antialiased(device: str, holdout: bool) -> None:
    """Of the wall, of its shadow, between colours and towards nothing: a coarse picture is the mean of a fine one."""
    fine, coarse = slanted(256, device, holdout), slanted(32, device, holdout)
    for name in ("Combined", "Holdout"):
        expected = fine[name].astype(float).reshape(32, 8, 32, 8, -1).mean((1, 3))
        if not expected.any():
            continue
        errors = np.abs(coarse[name] - expected)
        assert errors.max() < 0.07 * expected.max(), "a sixteenth of the step at the edge"
        assert np.sqrt((errors**2).mean()) < 0.01 * expected.max()


def test_devices_agree_on_edges() -> None:
    """In smoke that hardly shades itself."""
    for holdout in (False, True):
        tiles, gl = (slanted(96, device, holdout)["Combined"].astype(float) for device in DEVICES)
        assert rms(gl[..., 3], tiles[..., 3]) < 1e-3


def test_any_number_of_threads_gives_the_same_bits() -> None:
    wanted = ["Combined", "Holdout", ("Light", 0), "Emit"]
    first, *others = [core.render(still_life(threads=n), frame(32), SHADED, wanted) for n in (1, 2, 3)]
    for other in others:
        assert all((first[name] == other[name]).all() for name in wanted)


def test_what_is_out_of_view_or_invisible_is_not_shaded() -> None:
    scene = make([LIGHTS["sun"]], BALL)
    scene.add_mesh(SQUARE, FACES, visible_to_camera=False)
    shaded, held = (combined(scene, frame(), solids=solids) for solids in ("SHADED", "HOLDOUT"))
    assert (shaded == held).all() and held[..., 3].max() < 1


def sphere(rings: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices of a unit sphere and its triangles; the poles' are degenerate."""
    polar, around = np.meshgrid(np.linspace(0, math.pi, rings + 1), np.arange(2 * rings) * math.pi / rings, indexing="ij")
    vertices = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], -1)
    ring, step = np.meshgrid(np.arange(rings), np.arange(2 * rings), indexing="ij")
    a, b = ring * 2 * rings + step, ring * 2 * rings + (step + 1) % (2 * rings)
    triangles = np.concatenate([np.stack([a, a + 2 * rings, b], -1), np.stack([b, a + 2 * rings, b + 2 * rings], -1)])
    return vertices.reshape(-1, 3), triangles.reshape(-1, 3)


@pytest.mark.parametrize("device", DEVICES)
def test_smooth_surfaces(device: str) -> None:
    """A sphere of few faces, squeezed, turned and mirrored, is shaded as a round one by its normals."""
    vertices, triangles = sphere(24)
    matrix = tilted(30, 0, 0, 0)
    matrix[:3, :3] = matrix[:3, :3] @ np.diag([1.2, -0.8, 0.7])
    errors = []
    for normals in (vertices[triangles], None):
        scene = make([LIGHTS["sun"]])
        scene.add_mesh(vertices, triangles, matrix, albedo=0.5, normals=normals)
        found = combined(scene, frame(64, 3.0), device=device)
        x, y = floor_points(64, 3.0)[..., 0], floor_points(64, 3.0)[..., 1]
        # The ellipsoid p^T A p = 1 has the normal A p; z by the quadratic equation along the pixel's ray.
        inverse = np.linalg.inv(matrix[:3, :3])
        form = inverse.T @ inverse
        p = np.stack([x, y, np.zeros_like(x)], -1) @ form
        c = (p[..., :2] * np.stack([x, y], -1)).sum(-1) - 1
        root = np.sqrt(np.maximum(p[..., 2] ** 2 - form[2, 2] * c, 0))
        z = (-p[..., 2] + root) / form[2, 2]
        normal = np.stack([x, y, z], -1) @ form
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        expected = 0.5 / math.pi * 2.0 * np.maximum(normal @ LIGHTS["sun"]["matrix"][:3, 2], 0)
        inside = (root > 0.35) & (expected > 0.05)
        assert inside.mean() > 0.15
        errors.append(rms(found[inside][:, 0], expected[inside]))
    assert 2.5 * errors[0] < 0.015 < errors[1], errors


@pytest.mark.parametrize(
    ("look", "message"),
    [
        ({"albedo": 1.5}, "table: albedo 1.5 is not within 0..1"),
        ({"albedo": (0.1, math.nan, 0.1)}, "table: albedo nan is not within 0..1"),
        ({"emission": -1.0}, "table: emission -1 is not finite and at least 0"),
        ({"emission": math.inf}, "table: emission inf is not finite and at least 0"),
        ({"normals": np.full((2, 3, 3), math.nan)}, "table: normal of triangle 0 is not finite"),
        ({"normals": np.ones((1, 3, 3))}, "normals of 'table' has shape (1, 3, 3), expected (2, 3, 3)"),
        ({"albedo": (1, 1)}, "albedo of 'table' is (1, 1), expected a number or three"),
    ],
)
def test_wrong_looks_are_named(look: dict, message: str) -> None:
    with pytest.raises(core.FumaroleError) as raised:
        make([]).add_mesh(SQUARE, FACES, name="table", **look)
    assert message in str(raised.value)


def test_wrong_settings_are_named() -> None:
    with pytest.raises(core.FumaroleError, match="solids is 'GLASS', expected one of HOLDOUT, SHADED"):
        core.render(make([]), frame(8), core.Settings(solids="GLASS"))
    with pytest.raises(core.FumaroleError, match="solids is 'GLASS', expected one of HOLDOUT, SHADED"):
        core.render_reference(make([]), frame(8), solids="GLASS")
