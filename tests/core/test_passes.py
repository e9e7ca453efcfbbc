# SPDX-License-Identifier: GPL-3.0-or-later
"""The passes beside Combined: parts of it that add up, and shadows of smoke on solids against closed forms."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from exr_reader import read_exr

from fumarole import core

DOWN = {"matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 6.0], [0, 0, 0, 1]], "type": "ORTHOGRAPHIC"}
PARTICLE = {"position": [(0.3, 0.2, 1.5)], "radius": 1.0, "density": 1.2}
SIGMA = 0.5


def at(x: float, y: float, z: float) -> list[list[float]]:
    return [[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z], [0, 0, 0, 1]]


def floor(scene: core.Scene, half: float = 10.0, z: float = 0.0) -> None:
    corners = [(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)]
    scene.add_mesh(corners, [(0, 1, 2), (0, 2, 3)])


def make(lights: list[dict], particles: dict = PARTICLE, has_floor: bool = True, threads: int = 0) -> core.Scene:
    scene = core.Scene(core.Context(threads=threads))
    scene.add_particles(**particles)
    if has_floor:
        floor(scene)
    for light in lights:
        scene.add_light(**light)
    return scene


def frame(size: int = 96, scale: float = 4.0) -> core.Camera:
    return core.Camera(**DOWN, ortho_scale=scale, width=size, height=size)


def floor_points(size: int = 96, scale: float = 4.0) -> np.ndarray:
    """Places on the floor at the pixels' centres, (size, size, 3)."""
    axis = (np.arange(size) + 0.5) / size * scale - scale / 2
    x, y = np.meshgrid(axis, axis)
    return np.stack([x, y, np.zeros_like(x)], -1)


def depth_between(points: np.ndarray, light: np.ndarray, particles: dict = PARTICLE) -> np.ndarray:
    """Optical depth of the particles on the segments from points to a light, in closed form (DESIGN.md, section 1)."""
    line = light - points
    length = np.linalg.norm(line, axis=-1)
    direction = line / length[..., None]
    total = np.zeros(length.shape)
    for center in np.asarray(particles["position"], float):
        offset = center - points
        along = (offset * direction).sum(-1)
        squared = (offset**2).sum(-1) - along**2
        sigma = particles["radius"] / 2
        phi = np.vectorize(lambda z: 0.5 * math.erfc(-z / math.sqrt(2)))
        share = phi((length - along) / sigma) - phi(-along / sigma)
        total += particles["density"] * sigma * math.sqrt(2 * math.pi) * np.exp(-squared / (2 * sigma**2)) * share
    return total


LIGHTS = {
    "point": {"type": "POINT", "power": 100.0, "matrix": at(1.0, -0.5, 4.0)},
    "sun": {"type": "SUN", "power": 2.0},
    "spot": {"type": "SPOT", "power": 100.0, "matrix": at(0.2, 0.1, 5.0), "spot_angle": 1.5},
    "area": {"type": "AREA", "power": 50.0, "matrix": at(0.5, 0.0, 4.5), "size": 0.02},
}


@pytest.mark.parametrize("kind", LIGHTS)
def test_shadow_of_one_particle_on_a_floor(kind: str) -> None:
    light = LIGHTS[kind]
    scene = make([light])
    shadow = core.render(scene, frame(), passes=["Shadow"])["Shadow"]
    position = np.array(light.get("matrix", at(0, 0, 1e4)))[:3, 3]
    points = floor_points()
    source = points + (0, 0, 1e4) if kind == "sun" else position
    expected = np.exp(-depth_between(points, source))
    assert shadow.min() < 0.5, "there is a shadow"
    assert np.abs(shadow - expected[..., None]).max() < 2e-3


def test_shadow_of_two_lights_weighs_them_by_what_they_send() -> None:
    lights = [LIGHTS["point"], LIGHTS["point"] | {"matrix": at(-2.0, 1.0, 3.0), "power": 40.0}]
    result = core.render(make(lights), frame(), passes=["Shadow", ("Light Shadow", 0), ("Light Shadow", 1)])
    points = floor_points()
    smoky = np.zeros(points.shape[:2])
    clear = np.zeros_like(smoky)
    for number, light in enumerate(lights):
        position = np.array(light["matrix"])[:3, 3]
        line = position - points
        sent = light["power"] * line[..., 2] / np.linalg.norm(line, axis=-1) ** 3
        share = np.exp(-depth_between(points, position))
        assert np.abs(result["Light Shadow", number] - share[..., None]).max() < 2e-3
        smoky += sent * share
        clear += sent
    assert np.abs(result["Shadow"] - (smoky / clear)[..., None]).max() < 2e-3


def test_shadow_on_a_floor_within_smoke() -> None:
    """Smoke behind the floor casts no shadow on it, that in front does."""
    particles = {"position": [(0.0, 0.0, 0.1)], "radius": 1.0, "density": 2.0}
    scene = make([LIGHTS["point"]], particles)
    shadow = core.render(scene, frame(), passes=["Shadow"])["Shadow"]
    expected = np.exp(-depth_between(floor_points(), np.array([1.0, -0.5, 4.0]), particles))
    assert np.abs(shadow - expected[..., None]).max() < 2e-3


def test_shadow_is_1_without_solid_light_or_smoke() -> None:
    assert (core.render(make([LIGHTS["point"]], has_floor=False), frame(), passes=["Shadow"])["Shadow"] == 1).all()
    assert (core.render(make([]), frame(), passes=["Shadow"])["Shadow"] == 1).all()
    thin = PARTICLE | {"density": 0.0}
    assert (core.render(make([LIGHTS["point"]], thin), frame(), passes=["Shadow"])["Shadow"] == 1).all()


def test_shadow_counts_what_solids_leave() -> None:
    """Of two lights one is behind a wall for half of the floor: there the other one alone decides."""
    lights = [LIGHTS["sun"], {"type": "POINT", "power": 400.0, "matrix": at(-4.0, 0.0, 0.5)}]
    scene = make(lights)
    scene.add_mesh([(0, -9, -1), (0, 9, -1), (0, 9, 3), (0, -9, 3)], [(0, 1, 2), (0, 2, 3)], visible_to_camera=False)
    shadow = core.render(scene, frame(), passes=["Shadow"])["Shadow"]
    points = floor_points()
    alone = np.exp(-depth_between(points, points + (0, 0, 1e4)))
    hidden = points[..., 0] > 0.1
    assert np.abs(shadow[hidden] - alone[hidden][..., None]).max() < 2e-3
    assert np.abs(shadow[~hidden] - alone[~hidden][..., None]).max() > 0.05


def test_shadow_is_antialiased_whatever_the_frame_size() -> None:
    """A picture without smoke times the pass is the picture with smoke, in pixels through which edges run as well."""
    lights = [LIGHTS["sun"], {"type": "POINT", "power": 300.0, "matrix": at(0.0, 0.0, 5.0)}]
    fine, corners = 384, [(-0.31, -0.47, 4), (0.52, -0.29, 4), (0.43, 0.61, 4)]

    def irradiance(particles: dict) -> np.ndarray:
        scene = make(lights, particles)
        scene.add_mesh(corners, [(0, 1, 2)], visible_to_camera=False)
        points = floor_points(fine).reshape(-1, 3) + (0, 0, 1e-4)
        total = sum(core.irradiance(scene, points, number, (0.0, 0.0, 1.0)) for number in range(len(lights)))
        return total.reshape(fine, fine, 3).astype(float)

    smoky, clear = irradiance(PARTICLE), irradiance(PARTICLE | {"density": 0.0})
    scene = make(lights)
    scene.add_mesh(corners, [(0, 1, 2)], visible_to_camera=False)
    for size in (12, 24, 96):
        pool = (size, fine // size, size, fine // size, 3)
        expected, without = smoky.reshape(pool).mean((1, 3)), clear.reshape(pool).mean((1, 3))
        composed = core.render(scene, frame(size), passes=["Shadow"])["Shadow"] * without
        errors = np.abs(composed - expected) / clear.max()
        assert errors.max() < 0.08
        assert np.sqrt((errors**2).mean()) < 0.004


def test_lights_and_emission_add_up_to_combined() -> None:
    random = np.random.default_rng(1)
    particles = {
        "position": random.normal(0, 0.5, (500, 3)),
        "radius": 0.4,
        "density": 1.5,
        "albedo": random.uniform(0.2, 0.9, (500, 3)),
        "emission": random.uniform(0.0, 0.1, (500, 3)),
        "anisotropy": 0.3,
    }
    lights = list(LIGHTS.values())
    parts = [("Light", number) for number in range(len(lights))]
    scene = make(lights, particles, has_floor=False)
    result = core.render(scene, frame(40), passes=["Combined", "Emit", *parts])
    total = result["Emit"] + sum(result[part] for part in parts)
    assert np.abs(total - result["Combined"][..., :3]).max() <= 1e-6 * result["Combined"].max()
    assert all(result[part].max() > 1e-3 for part in [*parts, "Emit"])
    for number, light in enumerate(lights):
        alone = core.render(make([light], particles | {"emission": 0.0}, has_floor=False), frame(40))["Combined"]
        difference = result["Light", number] - alone[..., :3]
        assert np.sqrt((difference**2).mean()) < 0.004 * np.sqrt((alone[..., :3] ** 2).mean())
    same = core.render(scene, frame(40), passes=["Combined"])["Combined"]
    assert np.allclose(same, result["Combined"], rtol=2e-5, atol=1e-7), "parts don't change the whole"


def test_position_is_on_the_pixels_ray_at_its_depth() -> None:
    scene = make([], PARTICLE | {"density": 40.0})
    camera = core.Camera(matrix=at(0.5, 0.3, 5.0), lens=30.0, width=24, height=20, clip=(0.1, 40.0))
    result = core.render(scene, camera, passes=["Position", "Depth"])
    depth = result["Depth"][..., 0]
    assert np.allclose(result["Position"][..., 2], 5.0 - depth, atol=1e-5)
    floor_seen = np.abs(result["Position"][..., 2]) < 1e-4
    assert 0 < floor_seen.sum() < floor_seen.size
    middle = core.render(scene, frame(25), passes=["Position"])["Position"]
    assert np.allclose(middle[..., :2], floor_points(25)[..., :2], atol=1e-5)
    empty = core.render(core.Scene(core.Context()), camera, passes=["Position"])["Position"]
    assert (empty == 0).all()


def test_depth_range_holds_nine_tenths_of_the_opacity() -> None:
    """One particle straight ahead: its optical depth up to z is a normal distribution."""
    particle = {"position": [(0.0, 0.0, 2.0)], "radius": 1.0, "density": 1.5}
    names = ["Opacity", "Depth Front", "Depth", "Depth Back", "Combined"]
    result = core.render(make([], particle, has_floor=False), frame(25), passes=names)
    total = 1.5 * SIGMA * math.sqrt(2 * math.pi)
    opacity = 1 - math.exp(-total)
    assert (result["Opacity"][..., 0] == result["Combined"][..., 3]).all()
    assert result["Opacity"][12, 12, 0] == pytest.approx(opacity, rel=0.01)
    for name, share in (("Depth Front", 0.05), ("Depth Back", 0.95)):
        place = (result[name][12, 12, 0] - 4.0) / SIGMA  # of the particle's centre, 4 m from the camera
        passed = total * 0.5 * math.erfc(-place / math.sqrt(2))
        assert 1 - math.exp(-passed) == pytest.approx(share * opacity, abs=2e-3)
    front, middle, back = (result[name][12, 12, 0] for name in ("Depth Front", "Depth", "Depth Back"))
    assert front < middle < back
    far = core.Camera(**DOWN).clip[1]
    assert (result["Depth Front"][0, 0] == far).all() and (result["Depth Back"][0, 0] == far).all()


def test_depth_range_ends_at_solids() -> None:
    result = core.render(make([], PARTICLE), frame(24), passes=["Depth Front", "Depth Back"])
    assert np.allclose(result["Depth Front"][0, 0], 6.0) and np.allclose(result["Depth Back"][0, 0], 6.0)
    assert (result["Depth Back"] <= 6.0 + 1e-5).all()


@pytest.mark.parametrize(
    ("wanted", "device", "words"),
    [
        ([("Light", 1)], "AUTO", "number 1 is not one of 1 lights of the scene"),
        ([("Light", -1)], "AUTO", "number -1 is not one of 1 lights of the scene"),
        (["Light"], "AUTO", "there are several passes 'Light'"),
        ([("Combined", 0)], "AUTO", "there is one pass 'Combined'"),
        (["Nonsense"], "AUTO", "no pass 'Nonsense'"),
        ([("Light", 0)], "GL", "OpenGL draws all light at once"),
        (["Emit"], "GL", "OpenGL draws all light at once"),
    ],
)
def test_passes_that_cannot_be_had_say_why(wanted: list, device: str, words: str) -> None:
    with pytest.raises(core.FumaroleError, match=words):
        core.render(make([LIGHTS["sun"]]), frame(), core.Settings(device=device), wanted)


def test_a_result_with_passes_of_lights_is_written_to_a_file(tmp_path: Path) -> None:
    result = core.render(make([LIGHTS["sun"], LIGHTS["point"]]), frame(16), passes=["Combined", ("Light", 1), "Shadow"])
    core.write_exr(tmp_path / "passes.exr", result)
    channels = read_exr(tmp_path / "passes.exr")
    assert set(channels) == {*"RGBA", *(f"{name}.{letter}" for name in ("Light 1", "Shadow") for letter in "RGB")}
    assert np.array_equal(channels["Light 1.G"], result["Light", 1][..., 1])


def test_any_number_of_threads_gives_the_same_bits() -> None:
    wanted = ["Shadow", ("Light Shadow", 1), ("Light", 0), "Emit", "Position"]
    lights = [LIGHTS["point"], LIGHTS["area"] | {"size": 2.0}]
    first, *others = [core.render(make(lights, threads=n), frame(), passes=wanted) for n in (1, 2, 3)]
    for other in others:
        assert all((first[name] == other[name]).all() for name in wanted)


def test_a_light_without_shadows_passes_smoke_and_solids() -> None:
    """In the smoke, against the reference, and on the floor."""
    random = np.random.default_rng(2)
    particles = {"position": random.normal(0, 0.4, (200, 3)) + (0, 0, 0.8), "radius": 0.5, "density": 2.0}
    light = LIGHTS["point"] | {"casts_shadows": False}
    scene = make([light, LIGHTS["sun"]], particles)
    scene.add_mesh([(-9, -9, 3), (9, -9, 3), (9, 9, 3), (-9, 9, 3)], [(0, 1, 2), (0, 2, 3)], visible_to_camera=False)
    result = core.render(scene, frame(24), passes=["Combined", ("Light", 0), ("Light", 1), ("Light Shadow", 0)])
    assert (result["Light Shadow", 0] == 1).all()
    assert result["Light", 1].max() < 0.01 * result["Light", 0].max(), "the sun is behind the ceiling"
    truth = core.render_reference(scene, frame(24))["Combined"][..., :3]
    difference = result["Combined"][..., :3] - truth
    assert np.sqrt((difference**2).mean()) < 0.005 * np.sqrt((truth**2).mean())


def test_edges_of_solids_are_antialiased() -> None:
    """A slanted wall in front of half of the smoke: a coarse picture is the mean of a fine one."""

    def picture(size: int) -> dict:
        particles = {"position": [(0.0, 0.0, 0.0), (0.4, 0.3, 0.5)], "radius": 2.5, "density": 0.8, "emission": 0.2}
        scene = make([LIGHTS["sun"]], particles, has_floor=False)
        corners = [(-3.0, -3.0, 2.5), (0.13, -3.0, 2.5), (0.61, 3.0, 2.5), (-3.0, 3.0, 2.5)]
        scene.add_mesh(corners, [(0, 1, 2), (0, 2, 3)], visible_to_shadow=False)
        return core.render(scene, frame(size), passes=["Combined", ("Light", 0), "Emit"])

    fine, coarse = picture(256), picture(32)
    for name in ("Combined", ("Light", 0), "Emit"):
        expected = fine[name].astype(float).reshape(32, 8, 32, 8, -1).mean((1, 3))
        errors = np.abs(coarse[name] - expected)
        assert errors.max() < 0.06 * expected.max(), "a sixteenth of the step at the edge"
        assert np.sqrt((errors**2).mean()) < 0.008 * expected.max()


def test_readme_lists_every_pass_of_the_table() -> None:
    text = (Path(__file__).resolve().parents[2] / "README.md").read_text(encoding="utf-8")
    for item in core.PASSES.values():
        name = f'"{item.name}"' if item.per == "PICTURE" else f'("{item.name}", number)'
        assert f"`{name}`" in text, f"README has no pass {name}"
