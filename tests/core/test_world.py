# SPDX-License-Identifier: GPL-3.0-or-later
"""Light from all around: closed forms, single pixels that are suns, and the reference."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fumarole import core

FRONT = np.array([[1, 0, 0, 0], [0, 0, -1, -6.0], [0, 1, 0, 0], [0, 0, 0, 1]])
COLOR = np.array([0.5, 1.0, 2.0])


def camera(size: int = 24, **settings) -> core.Camera:
    return core.Camera(**{"matrix": FRONT, "lens": 60, "width": size, "height": size} | settings)


def ball(count: int, depth: float, seed: int = 1, **more) -> dict:
    """Random particles in a ball of radius 1, overlapping (n sigma^3 = 0.5), `depth` thick across."""
    rng = np.random.default_rng(seed)
    position = rng.normal(size=(count, 3))
    position *= rng.random((count, 1)) ** (1 / 3) / np.linalg.norm(position, axis=1, keepdims=True)
    sigma = (0.5 * 4 / 3 * math.pi / count) ** (1 / 3)
    return {"position": position, "radius": 2 * sigma, "density": depth / ((2 * math.pi) ** 1.5), "albedo": 0.9} | more


def scene_of(*particles: dict, threads: int = 0) -> core.Scene:
    scene = core.Scene(core.Context(threads=threads))
    for item in particles:
        scene.add_particles(**item)
    return scene


def relative_rms(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.sqrt(((found - expected) ** 2).mean() / (expected**2).mean()))


def directions(height: int, width: int) -> np.ndarray:
    """Unit directions (height, width, 3) of an equirectangular picture's pixels."""
    up = math.pi * ((np.arange(height) + 0.5) / height - 0.5)[:, None]
    around = math.pi - 2 * math.pi * ((np.arange(width) + 0.5) / width)[None, :]
    return np.stack(np.broadcast_arrays(np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)), -1)


def solid_angles(height: int, width: int) -> np.ndarray:
    """Solid angle (height, 1) of the pixels in each row."""
    edges = np.sin(math.pi * (np.arange(height + 1) / height - 0.5))
    return 2 * math.pi / width * np.diff(edges)[:, None]


def facing(direction: np.ndarray) -> np.ndarray:
    """The matrix of a sun that shines from a direction."""
    z = np.asarray(direction, float) / np.linalg.norm(direction)
    x = np.cross(np.eye(3)[np.argmin(abs(z))], z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([x, np.cross(z, x), z], -1)
    return matrix


def turned(seed: int = 3) -> np.ndarray:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    matrix = np.eye(4)
    matrix[:3, :3] = q * np.linalg.det(q)
    return matrix


def sky(height: int = 16, width: int = 32) -> np.ndarray:
    """A smooth blue sky above brown ground, with a bright spot."""
    d = directions(height, width)
    up = np.clip(d[..., 2:], 0, None)
    picture = 0.3 * up * np.array([0.3, 0.6, 1.5]) + 0.1 * (d[..., 2:] < 0) * np.array([1.0, 0.7, 0.4])
    spot = np.exp(40 * (d @ (np.array([1, -1, 1.2]) / math.sqrt(3.44)) - 1))[..., None]
    return (picture + 5 * spot * np.array([1.0, 0.9, 0.7])).astype(np.float32)


@pytest.mark.parametrize("anisotropy", [0.0, 0.6, -0.9])
@pytest.mark.parametrize("device", ["TILES", "GL"])
def test_a_thin_puff_shows_albedo_times_radiance_times_opacity(anisotropy: float, device: str) -> None:
    if device == "GL" and abs(anisotropy) > 0.6:
        pytest.skip("lit from single directions, each with its phase function")
    scene = scene_of({"position": [(0, 0, 0)], "radius": 2.0, "density": 1e-3, "albedo": 0.7, "anisotropy": anisotropy})
    scene.add_world(COLOR)
    combined = core.render(scene, camera(), core.Settings(device=device))["Combined"]
    alpha = combined[..., 3:]
    assert alpha.max() > 1e-3
    seen = alpha[..., 0] > 0.1 * alpha.max()
    assert combined[seen][:, :3] == pytest.approx(0.7 * COLOR * combined[seen][:, 3:], rel=0.01)


def thick_scenes() -> dict[str, tuple[list[dict], dict]]:
    return {
        "white": ([ball(300, 10)], {"color": COLOR}),
        "white forward": ([ball(300, 10, anisotropy=0.6)], {"color": COLOR}),
        "few large": ([ball(40, 4)], {"color": COLOR}),
        "sky": ([ball(300, 10)], {"pixels": sky(8, 16), "matrix": turned()}),
        "sky forward": ([ball(300, 10, anisotropy=0.6)], {"pixels": sky(8, 16), "matrix": turned()}),
        "two anisotropies": (
            [ball(100, 5, anisotropy=0.4), ball(100, 5, seed=2, albedo=(0.9, 0.5, 0.2), anisotropy=-0.3)],
            {"pixels": sky(8, 16)},
        ),
    }


@pytest.mark.parametrize("name", thick_scenes())
def test_thick_smoke_is_lit_as_in_the_reference(name: str) -> None:
    particles, world = thick_scenes()[name]
    scene = scene_of(*particles)
    scene.add_world(**world)
    view = camera(8, lens=160)
    samples = 256 if "pixels" in world else 484 if "forward" in name else 144  # all pixels; or evenly spread
    truth = core.render_reference(scene, view, tolerance=1e-2, light_samples=samples)["Combined"]
    found = core.render(scene, view, core.Settings(device="TILES"))
    assert relative_rms(found["Combined"][..., :3], truth[..., :3]) < 0.01
    assert found.stats.accuracy_count > 100 and found.stats.accuracy_rms < 0.01


def bright_pixel(factor: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A black picture with one bright pixel, the irradiance (3,) of its light and the direction it comes from."""
    picture = np.zeros((16, 32, 3), np.float32)
    picture[12, 21] = factor * COLOR * 40
    return picture, picture[12, 21] * solid_angles(16, 32)[12, 0], directions(16, 32)[12, 21]


def floor(scene: core.Scene, z: float = -1.5, half: float = 6.0) -> None:
    corners = [(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)]
    scene.add_mesh(corners, [(0, 1, 2), (0, 2, 3)], name="floor")


@pytest.mark.parametrize("anisotropy", [0.0, 0.7])
def test_one_bright_pixel_is_a_sun(anisotropy: float) -> None:
    picture, irradiance, direction = bright_pixel()
    spin = turned()
    names = ["Combined", "Shadow", ("Light", 0), ("Light Shadow", 0)]
    results = {}
    for kind in ("world", "sun"):
        scene = scene_of(ball(500, 5, anisotropy=anisotropy))
        floor(scene)
        if kind == "world":
            scene.add_world(2.0, picture, spin)
        else:
            matrix = facing(spin[:3, :3] @ direction)
            scene.add_light("SUN", matrix, power=1.0, color=2 * irradiance)
        results[kind] = core.render(scene, camera(32, lens=35), core.Settings(device="TILES"), names)
    for name in results["sun"]:
        world, sun = results["world"][name], results["sun"][name]
        assert np.abs(sun - sun.flat[0]).max() > 0.1 * sun.max() > 0
        # Shadows' edges on smoke are those of a sun where a ray is shot for each pixel.
        allowed = 1e-3 if "Shadow" in str(name) else 0.05
        assert relative_rms(world, sun) < allowed, name
    bare = {}
    for kind in ("world", "sun"):
        scene = scene_of(ball(500, 5, anisotropy=anisotropy))
        if kind == "world":
            scene.add_world(2.0, picture, spin)
        else:
            scene.add_light("SUN", facing(spin[:3, :3] @ direction), power=1.0, color=2 * irradiance)
        bare[kind] = core.render(scene, camera(32, lens=60))["Combined"]
    assert relative_rms(bare["world"], bare["sun"]) < 1e-3


def test_halves_add_up_and_keep_their_colours() -> None:
    """Red light from the left and blue from the right, together and one by one."""
    left = directions(16, 32)[..., :1] < 0
    red, blue = np.array([1.0, 0.1, 0]), np.array([0, 0.2, 2.0])
    pictures = {"left": left * red, "right": ~left * blue, "both": np.where(left, red, blue)}
    found = {}
    for name, picture in pictures.items():
        scene = scene_of(ball(300, 8))
        scene.add_world(1.0, picture)
        found[name] = core.render(scene, camera(24), core.Settings(light_samples=32))["Combined"][..., :3]
    assert relative_rms(found["left"] + found["right"], found["both"]) < 0.01
    middle = found["both"][8:16]
    assert middle[:, 2:8, 0].mean() > 2 * middle[:, 16:22, 0].mean()
    assert middle[:, 16:22, 2].mean() > 2 * middle[:, 2:8, 2].mean()
    assert not found["left"][..., 2].any() and not found["right"][..., 0].any()


def box(scene: core.Scene, half: float) -> None:
    corners = half * (np.array([(i & 1, i >> 1 & 1, i >> 2) for i in range(8)]) * 2.0 - 1)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    scene.add_mesh(corners, triangles, name="box", visible_to_camera=False)


@pytest.mark.parametrize("device", ["TILES", "GL"])
def test_a_closed_box_is_black_and_a_half_space_half_as_bright(device: str) -> None:
    puff = {"position": [(0, 0, 0)], "radius": 1.0, "density": 1e-3}
    pictures = {}
    for solid in ("none", "box", "plane"):
        scene = scene_of(puff)
        scene.add_world(COLOR)
        if solid == "box":
            box(scene, 4.0)
        if solid == "plane":
            floor(scene, -2.0, 2000.0)
        result = core.render(scene, camera(), core.Settings(light_samples=64, device=device))
        pictures[solid] = result["Combined"][..., :3]
    assert pictures["none"].max() > 1e-4
    assert not pictures["box"].max() > 1e-6 * pictures["none"].max()
    assert relative_rms(pictures["plane"], 0.5 * pictures["none"]) < 0.01


def test_irradiance_of_planes_and_points() -> None:
    scene = scene_of()
    even = scene.add_world(COLOR)
    picture = sky()
    drawn = scene.add_world(1.5, picture, turned())
    points = np.zeros((4, 3))
    normals = np.array([(0, 0, 1), (0, 0, -1), (0.6, 0, 0.8), (0, 1, 0)])
    assert core.irradiance(scene, points, even, normals) == pytest.approx(np.tile(math.pi * COLOR, (4, 1)), rel=0.015)
    assert core.irradiance(scene, points, even) == pytest.approx(np.tile(4 * math.pi * COLOR, (4, 1)), rel=1e-5)
    energy = 1.5 * picture * solid_angles(16, 32)[..., None]
    assert core.irradiance(scene, points, drawn) == pytest.approx(np.tile(energy.sum((0, 1)), (4, 1)), rel=1e-5)
    cosines = np.clip(normals @ turned()[:3, :3] @ directions(16, 32).reshape(-1, 3).T, 0, None)
    assert core.irradiance(scene, points, drawn, normals) == pytest.approx(cosines @ energy.reshape(-1, 3), rel=0.05)


def test_transmittance_is_the_mean_over_directions() -> None:
    scene = scene_of({"position": [(0, 0, 0)], "radius": 2.0, "density": 1.0})
    world = scene.add_world(COLOR)
    found = core.transmittance(scene, [(0, 0, 0), (0, 0, 50.0)], world)
    assert found[0] == pytest.approx(math.exp(-math.sqrt(math.pi / 2)), rel=1e-3)  # the same from everywhere
    assert found[1] == pytest.approx(1.0, abs=1e-3)


def test_lights_and_world_add_up_in_passes() -> None:
    scene = scene_of(ball(300, 5), ball(100, 2, seed=4, anisotropy=0.5, albedo=(1, 0.5, 0.2)))
    floor(scene)
    sun = scene.add_light("SUN", facing((1, -1, 1)), power=2.0)
    world = scene.add_world(0.5, sky())
    lamp = scene.add_light("POINT", [[1, 0, 0, 3], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]], power=50.0)
    names = ["Combined", "Shadow", *[("Light", index) for index in (sun, world, lamp)], ("Light Shadow", world)]
    together = core.render(scene, camera(32), core.Settings(device="TILES"), names)
    parts = sum(together["Light", index] for index in (sun, world, lamp))
    assert parts == pytest.approx(together["Combined"][..., :3], rel=1e-4, abs=1e-6)
    alone = scene_of(ball(300, 5), ball(100, 2, seed=4, anisotropy=0.5, albedo=(1, 0.5, 0.2)))
    floor(alone)
    alone.add_world(0.5, sky())
    single = core.render(alone, camera(32), core.Settings(device="TILES"), ["Combined", "Shadow"])
    # Alone the world is of more directions.
    assert relative_rms(together["Light", world], single["Combined"][..., :3]) < 0.05
    assert relative_rms(together["Light Shadow", world], single["Shadow"]) < 0.02
    assert single["Shadow"].min() < 0.9 and np.ptp(single["Shadow"], axis=-1).max() > 1e-3
    assert relative_rms(together["Shadow"], single["Shadow"]) > 1e-3


def test_shadow_pass_is_light_through_smoke_over_light_without() -> None:
    found = {}
    for density in (0.0, 1.5):
        scene = scene_of({"position": [(0.3, 0.2, 0.4)], "radius": 1.2, "density": density})
        floor(scene)
        world = scene.add_world(1.0, sky())
        view = core.Camera(
            matrix=[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 8.0], [0, 0, 0, 1]], type="ORTHOGRAPHIC", ortho_scale=4, width=8, height=8
        )
        shadow = core.render(scene, view, passes=["Shadow"])["Shadow"]
        axis = (np.arange(8) + 0.5) / 2 - 2
        x, y = np.meshgrid(axis, axis)
        points = np.stack([x, y, np.full_like(x, -1.499)], -1).reshape(-1, 3)
        found[density] = core.irradiance(scene, points, world, np.tile((0, 0, 1.0), (64, 1))).reshape(8, 8, 3)
    assert shadow == pytest.approx(found[1.5] / found[0.0], abs=0.02)  # of the pixel, not of its middle
    assert shadow.min() < 0.8


def test_any_number_of_threads_gives_the_same_bits() -> None:
    pictures = []
    for threads in (1, 3):
        scene = scene_of(ball(500, 5, anisotropy=0.3), threads=threads)
        floor(scene)
        scene.add_world(1.0, sky())
        pictures.append(core.render(scene, camera(), passes=["Combined", "Shadow"]))
    assert all(np.array_equal(pictures[0][name], pictures[1][name]) for name in ("Combined", "Shadow"))


def test_what_shines_nowhere_is_black_and_no_error() -> None:
    scene = scene_of(ball(50, 2))
    scene.add_world(0.0)
    scene.add_world(1.0, np.zeros((4, 8, 3)))
    result = core.render(scene, camera(8), passes=["Combined", ("Light", 1)])
    assert not result["Combined"][..., :3].any() and result["Combined"][..., 3].max() > 0.1
    assert not result["Light", 1].any()
    assert not core.render_reference(scene, camera(4))["Combined"][..., :3].any()


def test_a_world_without_shadows_passes_everything() -> None:
    scene = scene_of(ball(100, 5))
    box(scene, 4.0)
    scene.add_world(COLOR, casts_shadows=False)
    found = core.render(scene, camera(), core.Settings(device="TILES"))["Combined"]
    assert relative_rms(found[..., :3], 0.9 * COLOR * found[..., 3:]) < 0.01


@pytest.mark.parametrize(
    ("world", "words"),
    [
        ({"color": (1, -1, 1)}, "sky: intensity -1"),
        ({"color": float("nan")}, "intensity"),
        ({"pixels": np.zeros((4, 4))}, r"pixels of 'sky' has shape \(4, 4\)"),
        ({"pixels": np.zeros((0, 4, 3))}, "4 x 0 pixels"),
        ({"pixels": np.where(np.arange(96).reshape(4, 8, 3) == 70, -2.0, 1.0)}, "pixel 7, 2 holds -2"),
        ({"pixels": np.full((2, 2, 3), np.inf)}, "pixel 0, 0 holds inf"),
        ({"matrix": np.zeros((4, 4))}, "no scale along axis 0"),
    ],
)
def test_wrong_values_are_named(world: dict, words: str) -> None:
    with pytest.raises(core.FumaroleError, match=words):
        scene_of().add_world(**{"name": "sky"} | world)


def test_a_world_is_no_lamp() -> None:
    with pytest.raises(core.FumaroleError, match="'ENVIRONMENT', expected one of POINT"):
        scene_of().add_light("ENVIRONMENT")


def test_error_pass_knows_the_world() -> None:
    scene = scene_of(ball(300, 8, anisotropy=0.3))
    scene.add_world(1.0, sky())
    result = core.render(scene, camera(), core.Settings(device="TILES"), ["Combined", "Error"])
    assert result["Combined"].max() > 0.1
    assert 1e-6 < np.abs(result["Error"]).max() < 0.02


def test_shaded_solids_are_lit_by_the_world() -> None:
    """A white floor under an even sky is as bright as the sky, and a smoky one no brighter than its shadow says."""
    scene = scene_of({"position": [(0, 0, 40.0)], "radius": 0.1})
    corners = [(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)]
    scene.add_mesh(corners, [(0, 1, 2), (0, 2, 3)], albedo=(0.5, 0.5, 0.5))
    world = scene.add_world(COLOR)
    view = core.Camera(matrix=[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 8.0], [0, 0, 0, 1]], width=8, height=8)
    result = core.render(scene, view, core.Settings(solids="SHADED"), ["Combined", ("Light", world)])
    assert result["Combined"][..., :3] == pytest.approx(np.tile(0.5 * COLOR, (8, 8, 1)), rel=0.01)
    assert result["Light", world] == pytest.approx(result["Combined"][..., :3], rel=1e-5)


def test_smoke_before_a_solid_in_it_is_lit_up_to_its_surface() -> None:
    """No light gets into the solid; what is interpolated near its surface mustn't know of that."""
    solid = scene_of(ball(300, 1.5))
    corners = 0.3 * (np.array([(i & 1, i >> 1 & 1, i >> 2) for i in range(8)]) * 2.0 - 1)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    solid.add_mesh(corners, [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    solid.add_world(COLOR)
    view = camera(4, lens=600)  # the middle of the cube's front
    truth = core.render_reference(solid, view, tolerance=1e-2, light_samples=144)["Combined"][..., :3]
    found = core.render(solid, view, core.Settings(device="TILES"))["Combined"][..., :3]
    assert truth.min() > 0.05
    assert relative_rms(found, truth) < 0.015


def test_a_dim_world_beside_a_lamp_takes_fewer_directions() -> None:
    """And the picture is that of many within half the tolerance."""
    pictures, counts = {}, {}
    for radiance in (0.0, 0.02, 0.2):
        for samples in (16, 128):
            scene = scene_of(ball(500, 6.0))
            scene.add_light("SUN", facing([0.3, -0.5, 1.0]), power=3.0)
            if radiance > 0:
                scene.add_world((radiance, radiance, 1.5 * radiance))
            result = core.render(scene, camera(32), core.Settings(light_samples=samples), ["Combined"])
            pictures[radiance, samples] = result["Combined"][..., :3]
            counts[radiance, samples] = result.stats.light_sample_count - 1
    assert counts[0.0, 16] == 0 < counts[0.02, 16] < counts[0.2, 16] < 48
    for radiance in (0.02, 0.2):
        assert relative_rms(pictures[radiance, 16], pictures[radiance, 128]) < 5e-3
        assert relative_rms(pictures[radiance, 16], pictures[0.0, 16]) > 5e-3
