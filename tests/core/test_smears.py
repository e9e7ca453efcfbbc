# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion blur and depth of field by the shape of the billboard, against the mean of many sharp pictures."""

from __future__ import annotations

import dataclasses
import numpy as np
import pytest
from numpy.typing import NDArray

from fumarole import core

Picture = NDArray[np.float64]
SIZE = 64
#: Tolerances of the renders: what is compared are footprints, not how coarsely light is found.
FINE = core.Settings(device="TILES", tolerance=1e-3)


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> NDArray[np.float64]:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def turned(angle: float, z: float = 6.0) -> NDArray[np.float64]:
    """A camera on the z axis that looks a little aside."""
    matrix = at(0, 0, z)
    matrix[0, 0] = matrix[2, 2] = np.cos(angle)
    matrix[0, 2], matrix[2, 0] = np.sin(angle), -np.sin(angle)
    return matrix


def camera(**changes: object) -> core.Camera:
    return core.Camera(**{"matrix": at(z=6), "lens": 50.0, "width": SIZE, "height": SIZE} | changes)


def cloud(count: int = 40, depth: float = 0.1, seed: int = 1, size: float = 1.0) -> dict[str, object]:
    """Particles in the frame; `depth` is the optical depth through the middle of all, about."""
    rng = np.random.default_rng(seed)
    radii = rng.uniform(0.2, 0.4, count) * size
    sigma = radii / 2
    area = np.pi * 1.0**2
    density = np.full(count, depth * area / np.sum(sigma**3 * (2 * np.pi) ** 1.5))
    return {
        "positions": rng.uniform(-1, 1, (count, 3)),
        "radius": radii,
        "density": density,
        "emission": rng.uniform(0.1, 1.0, (count, 3)) * density[:, None],
        "albedo": 0.0,
    }


def scene_of(particles: dict[str, object], shift: float = 0.0) -> core.Scene:
    """Particles where they are `shift` frames later."""
    described = dict(particles)
    velocity = described.pop("velocity", 0.0)
    position = np.asarray(described.pop("positions"), float)
    described["velocity"] = np.broadcast_to(velocity, position.shape)
    scene = core.Scene(core.Context())
    scene.add_particles(position + shift * described["velocity"], **described)
    return scene


def draw(scene: core.Scene, view: core.Camera, settings: core.Settings = FINE) -> Picture:
    return core.render(scene, view, settings)["Combined"].astype(float)


def sharp(view: core.Camera) -> core.Camera:
    return view.blurred()


def instants(shutter: tuple[float, float], count: int) -> NDArray[np.float64]:
    return shutter[0] + (np.arange(count) + 0.5) / count * (shutter[1] - shutter[0])


def mean_over_shutter(particles: dict[str, object], view: core.Camera, count: int = 48) -> Picture:
    """Particles moved, the camera still."""
    times = instants(view.shutter, count)
    return sum(draw(scene_of(particles, t), sharp(view)) for t in times) / count


def lens_points(aperture: core.Aperture, count: int) -> NDArray[np.float64]:
    """[count, 2] points spread evenly over the aperture, m (Roberts' R2 sequence)."""
    index = np.arange(count)[:, None]
    a, b = ((0.5 + index * np.array([0.7548776662466927, 0.5698402909980532])) % 1).T
    if aperture.blades == 0:
        radius, angle = np.sqrt(a), 2 * np.pi * b
        points = np.stack((radius * np.cos(angle), radius * np.sin(angle)), 1)
    else:
        # Triangles between the centre and two corners each, each a part of the sequence.
        corner = np.floor(a * aperture.blades)
        a = np.sqrt(a * aperture.blades - corner)
        angles = aperture.rotation + 2 * np.pi / aperture.blades * np.stack((corner, corner + 1))
        first, second = np.stack((np.cos(angles), np.sin(angles)), -1)
        points = a[:, None] * (first + b[:, None] * (second - first))
    return points * aperture.radius * (1 / aperture.ratio, 1)


def seen_from(view: core.Camera, x: float, y: float) -> core.Camera:
    """The camera from a point of its lens: what lies in the plane of focus stays where it is in the picture."""
    matrix = view.matrix.copy()
    matrix[:3, 3] += matrix[:3, 0] * x + matrix[:3, 1] * y
    left, right, bottom, top = view.window
    if view.type == "PERSPECTIVE":
        x, y = x / view.aperture.focus, y / view.aperture.focus
    window = (left - x, right - x, bottom - y, top - y)
    return core.Camera.from_window(matrix, window, view.width, view.height, view.type, view.clip)


def mean_over_lens(particles: dict[str, object], view: core.Camera, count: int = 500) -> Picture:
    scene = scene_of(particles)
    pictures = [draw(scene, seen_from(view, x, y)) for x, y in lens_points(view.aperture, count)]
    return sum(pictures) / len(pictures)


def depth_of(picture: Picture) -> Picture:
    """Optical depth."""
    return -np.log1p(-picture[..., 3])


def differ(found: Picture, expected: Picture) -> float:
    """Largest difference over the largest value."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


MOTIONS = {
    "across": (0.8, 0.3, 0.0),
    "short": (0.1, -0.05, 0.0),
    "along the view": (0.0, 0.0, 2.0),
    "aslant": (0.7, -0.4, 1.5),
    "long": (5.0, 1.0, 0.0),
}


@pytest.mark.parametrize("type", ["PERSPECTIVE", "ORTHOGRAPHIC"])
@pytest.mark.parametrize("motion", MOTIONS)
def test_motion_is_the_mean_over_the_shutter(motion: str, type: str) -> None:
    particles = cloud(depth=0.005) | {"velocity": MOTIONS[motion]}
    view = camera(type=type, ortho_scale=4.0).blurred((-0.25, 0.25))
    found, expected = draw(scene_of(particles), view), mean_over_shutter(particles, view)
    assert differ(found, expected) < 3e-3
    assert depth_of(found).sum() == pytest.approx(depth_of(expected).sum(), rel=1e-3)


def test_shutter_beside_the_frame() -> None:
    """It opens now, or at the frame's end: particles are seen where they are then."""
    particles = cloud(depth=0.005) | {"velocity": (0.8, 0.3, 0.5)}
    for shutter in ((0.0, 0.5), (0.5, 0.6), (-1.0, 0.0)):
        view = camera().blurred(shutter)
        assert differ(draw(scene_of(particles), view), mean_over_shutter(particles, view)) < 3e-3


def test_every_particle_has_its_own_motion() -> None:
    particles = cloud(depth=0.005)
    particles["velocity"] = np.random.default_rng(2).normal(0, 1, (40, 3))
    view = camera().blurred((-0.5, 0.5))
    assert differ(draw(scene_of(particles), view), mean_over_shutter(particles, view)) < 3e-3


def test_camera_motion_is_particle_motion_the_other_way_round() -> None:
    step = np.array((0.5, -0.3, 0.4))
    particles = cloud(depth=0.005)
    moved = particles | {"velocity": -step}
    still = camera().blurred((-0.25, 0.25))
    before, after = camera(matrix=at(*(np.array((0, 0, 6)) - step))), camera(matrix=at(*(np.array((0, 0, 6)) + step)))
    found = draw(scene_of(particles), still.moving(before, after))
    assert differ(found, draw(scene_of(moved), still)) < 1e-5
    assert differ(found, mean_over_shutter(moved, still)) < 3e-3
    # What moves with the camera stays where it is in the picture.
    along = draw(scene_of(particles | {"velocity": step}), still.moving(before, after))
    assert differ(along, draw(scene_of(particles), camera())) < 1e-5


@pytest.mark.parametrize("change", ["turn", "zoom"])
def test_turning_and_zooming_cameras(change: str) -> None:
    particles = cloud(depth=0.005)

    def then(t: float) -> core.Camera:
        return camera(matrix=turned(0.1 * t)) if change == "turn" else camera(lens=50.0 * (1 - 0.1 * t))

    def between(t: float) -> core.Camera:
        if change == "turn":
            return then(t)
        window = (1 - abs(t)) * np.array(then(0).window) + abs(t) * np.array(then(np.sign(t)).window)
        return core.Camera.from_window(at(z=6), tuple(window), SIZE, SIZE)

    view = camera().moving(then(-1), then(1)).blurred((-0.25, 0.25))
    expected = sum(draw(scene_of(particles), between(t)) for t in instants(view.shutter, 32)) / 32
    assert differ(draw(scene_of(particles), view), expected) < 5e-3


def test_thin_smoke_is_linear_in_density() -> None:
    view = camera().blurred((-0.25, 0.25), core.Aperture(0.2, 5.0, 5))
    motion = {"velocity": (0.8, 0.3, 0.0)}
    thin, thinner = (depth_of(draw(scene_of(cloud(depth=d) | motion), view)) / d for d in (1e-3, 1e-4))
    assert differ(thin, thinner) < 2e-3


def test_smears_at_the_edge_of_the_frame_and_of_the_clip_range() -> None:
    """Smoke that moves into the frame, through the near plane and past the camera."""
    into = cloud(depth=0.005)
    into["positions"] = np.asarray(into["positions"]) + (2.6, 0, 0)
    into["velocity"] = (-3.0, 0, 0)
    view = camera().blurred((0.0, 0.5))
    assert differ(draw(scene_of(into), view), mean_over_shutter(into, view)) < 3e-3
    past = {"positions": [(0.5, 0.2, 5.0)], "radius": 0.2, "density": 0.05, "emission": 0.05, "velocity": (0, 0, 4.0)}
    view = camera(clip=(0.5, 100.0)).blurred((-0.5, 0.5))
    found, expected = draw(scene_of(past), view), mean_over_shutter(past, view, 96)
    assert np.isfinite(found).all() and found.min() >= 0
    assert depth_of(found).sum() == pytest.approx(depth_of(expected).sum(), rel=0.05)


APERTURES = {
    "round": core.Aperture(0.3),
    "triangle": core.Aperture(0.3, blades=3, rotation=0.3),
    "pentagon": core.Aperture(0.3, blades=5, rotation=1.0),
    "narrow": core.Aperture(0.3, ratio=2.0),
    "narrow and turned": core.Aperture(0.3, blades=4, rotation=0.4, ratio=0.6),
}


@pytest.mark.parametrize(
    ("aperture", "focus"),
    [("round", 3.0), ("round", 12.0), ("triangle", 3.0), ("triangle", 12.0), ("pentagon", 5.7), ("narrow", 12.0)]
    + [("narrow and turned", 3.0)],
)
def test_depth_of_field_is_the_mean_over_the_lens(aperture: str, focus: float) -> None:
    """Before the focus the aperture's image is upside down, behind it as the aperture is."""
    view = camera().blurred(aperture=dataclasses.replace(APERTURES[aperture], focus=focus))
    particles = cloud(20, depth=0.005)
    found, expected = draw(scene_of(particles), view), mean_over_lens(particles, view)
    assert differ(found, expected) < 1.8e-2  # half of it is what 500 points are off by
    assert depth_of(found).sum() == pytest.approx(depth_of(expected).sum(), rel=1.5e-3)


def test_depth_of_field_of_an_orthographic_camera() -> None:
    """Rays through a point of the lens and the plane of focus: smoke is shifted by what it is behind that."""
    view = camera(type="ORTHOGRAPHIC", ortho_scale=4.0).blurred(aperture=core.Aperture(0.4, 5.0, 3, 0.2))
    particles = cloud(20, depth=0.005)
    positions = np.asarray(particles["positions"])
    expected = np.zeros((SIZE, SIZE, 4))
    points = lens_points(view.aperture, 600)
    for point in points:
        shifted = positions.copy()
        shifted[:, :2] += point * ((6 - positions[:, 2:]) / view.aperture.focus - 1)
        expected += draw(scene_of(particles | {"positions": shifted}), sharp(view)) / len(points)
    assert differ(draw(scene_of(particles), view), expected) < 1.2e-2


def test_what_is_in_focus_is_sharp() -> None:
    particles = cloud(depth=1.0)
    particles["positions"] = np.asarray(particles["positions"]) * (1, 1, 0)
    view = camera().blurred(aperture=core.Aperture(0.05, 6.0))
    assert differ(draw(scene_of(particles), view), draw(scene_of(particles), camera())) < 5e-3


def test_bokeh_of_a_spark_has_the_shape_of_the_aperture() -> None:
    """A small bright particle far out of focus: an even triangle, and as much light as there was."""
    spark = {"positions": [(0, 0, 0)], "radius": 0.02, "density": 200.0, "emission": 4000.0, "albedo": 0.0}
    view = camera(width=128, height=128).blurred(aperture=core.Aperture(1.0, 3.0, 3))
    found, sharp_one = draw(scene_of(spark), view)[..., 0], draw(scene_of(spark), sharp(view))[..., 0]
    assert found.sum() == pytest.approx(sharp_one.sum(), rel=0.02)
    y, x = np.mgrid[:128, :128] + 0.5
    corners = 128 / 36 * 50 / 6  # pixels from the middle: 1 m times (6 - 3) / 3
    inside, outside = np.ones(x.shape, bool), np.zeros(x.shape, bool)
    for k in range(3):
        edge = (x - 64) * np.cos((2 * k + 1) * np.pi / 3) + (y - 64) * np.sin((2 * k + 1) * np.pi / 3)
        inside &= edge < corners / 2 - 2
        outside |= edge > corners / 2 + 2
    assert inside.sum() > 50
    assert found[outside].max() < 0.02 * found.max()
    assert found[inside].std() < 0.03 * found[inside].mean()


@pytest.mark.parametrize("focus", [4.0, 5.5])
def test_both_blurs_at_once(focus: float) -> None:
    particles = cloud(20, depth=0.005) | {"velocity": (1.0, 0.5, 0.5)}
    view = camera().blurred((-0.25, 0.25), core.Aperture(0.3, focus, 5))
    expected = np.zeros((SIZE, SIZE, 4))
    times, points = instants(view.shutter, 24), lens_points(view.aperture, 24 * 24)
    for k, t in enumerate(times):
        scene = scene_of(particles, t)
        expected += sum(draw(scene, seen_from(view, x, y)) for x, y in points[k::24]) / len(points)
    assert differ(draw(scene_of(particles), view), expected) < 1.2e-2


def lit_cloud(count: int, depth: float, velocity: tuple[float, float, float] = (0, 0, 0)) -> core.Scene:
    scene = scene_of(cloud(count, depth) | {"velocity": velocity, "albedo": 0.8})
    scene.add_light("SUN", power=2.0)
    return scene


BLURRED = camera().blurred((-0.25, 0.25), core.Aperture(0.15, 5.0, 6))


def test_threads_change_no_bit() -> None:
    pictures = []
    for threads in (1, 3):
        context = core.Context(threads=threads)
        particles = cloud(300, 2.0) | {"albedo": 0.8}
        scene = core.Scene(context)
        scene.add_particles(particles.pop("positions"), velocity=(1.0, 0.2, 0), **particles)
        scene.add_light("SUN", power=2.0)
        pictures.append(core.render(scene, BLURRED)["Combined"])
    assert (pictures[0] == pictures[1]).all()


def test_nothing_that_blurs_changes_no_bit() -> None:
    """A shutter without motion and a lens in focus to within a hair; the shutter of no length even less."""
    scene = lit_cloud(100, 1.0, (1.0, 0, 0))
    plain = core.render(scene, camera())["Combined"]
    assert (core.render(scene, camera().blurred((0.3, 0.3)))["Combined"] == plain).all()
    still = lit_cloud(100, 1.0)
    blurred = camera().blurred((-0.25, 0.25))
    assert differ(core.render(still, blurred)["Combined"], core.render(still, camera())["Combined"]) < 1e-5


def test_slight_blur_is_lit_as_sharp_smoke() -> None:
    """Light inside of thick particles, which their centres know nothing of."""
    particles = {"positions": [(0, 0, 0)], "radius": 1.5, "density": 3.0, "velocity": (0.1, 0, 0)}
    scene = scene_of(particles)
    scene.add_light("SUN", matrix=turned(1.0), power=2.0)
    found, plain = (core.render(scene, v)["Combined"] for v in (camera().blurred((-0.25, 0.25)), camera()))
    assert differ(found, plain) < 0.02


def test_attributes_have_the_same_footprints() -> None:
    scene = core.Scene()
    scene.add_particles([(-0.5, 0, 0)], radius=0.3, density=3.0, albedo=(0.9, 0.5, 0.1), velocity=(1.0, 0, 0))
    result = core.render(scene, BLURRED, passes=("Combined", "Albedo", ("CryptoObject", 0)))
    assert result["Albedo"] == pytest.approx(result["Combined"][..., 3:] * np.float32((0.9, 0.5, 0.1)), abs=1e-4)


def test_solids_cut_smears() -> None:
    """A wall hides the part of the motion that is behind it."""
    particles = {"positions": [(0, 0, 0)], "radius": 0.3, "density": 0.05, "emission": 0.05, "velocity": (0.5, 0, 4.0)}
    corners = [(-5, -5, 0), (5, -5, 0), (5, 5, 0), (-5, 5, 0)]

    def walled(shift: float = 0.0) -> core.Scene:
        scene = scene_of(particles, shift)
        scene.add_mesh(corners, [(0, 1, 2), (0, 2, 3)], name="wall")
        return scene

    view = camera().blurred((-0.5, 0.5))
    expected = sum(draw(walled(t), sharp(view)) for t in instants(view.shutter, 64)) / 64
    found = draw(walled(), view)
    assert depth_of(found).sum() == pytest.approx(depth_of(expected).sum(), rel=0.03)


def test_parts_of_combined() -> None:
    """What each light makes and what the smoke emits add up to the whole."""
    scene = scene_of(cloud(50, 0.5) | {"velocity": (2.0, 0, 0), "albedo": 0.8})
    scene.add_light("SUN", power=2.0, color=(1, 0.2, 0.1))
    scene.add_light("POINT", matrix=at(3, 3, 3), power=500.0)
    result = core.render(scene, BLURRED, passes=("Combined", "Emit", ("Light", 0), ("Light", 1)))
    parts = [result[name] for name in ("Emit", ("Light", 0), ("Light", 1))]
    assert min(part.max() for part in parts) > 0.05 * result["Combined"].max()
    assert sum(parts) == pytest.approx(result["Combined"][..., :3], abs=1e-5)
    dark = scene_of(cloud(50, 0.5) | {"velocity": (2.0, 0, 0)})
    assert parts[0] == pytest.approx(core.render(dark, BLURRED)["Combined"][..., :3], abs=1e-5)


def test_passes_that_need_light_at_the_pixels_say_so() -> None:
    scene = lit_cloud(50, 1.0, (2.0, 0, 0))
    for name in ("Error", "Solid Shadow"):
        with pytest.raises(core.FumaroleError, match="motion blur"):
            core.render(scene, BLURRED, passes=("Combined", name))


def test_maps_are_not_seen_in_smears() -> None:
    """A warning names the object; the pass Albedo, drawn anew, is drawn without them as well."""
    described = cloud(20, 0.5) | {"velocity": (2.0, 0, 0), "map": np.full((4, 4, 4), 0.5), "name": "leaves"}
    for device in ("TILES", "GL"):
        result = core.render(scene_of(described), BLURRED, core.Settings(device=device), ("Combined", "Albedo"))
        assert any("leaves" in warning and "map" in warning for warning in result.warnings)


@pytest.mark.parametrize("type", ["PERSPECTIVE", "ORTHOGRAPHIC"])
@pytest.mark.parametrize("blur", ["motion", "long motion", "lens", "both"])
def test_opengl_draws_what_tiles_draw(blur: str, type: str) -> None:
    velocity = {"motion": (0.8, 0.3, 0.5), "long motion": (5.0, 1.0, 0), "lens": (0, 0, 0), "both": (1.0, 0.5, 0.5)}[blur]
    shutter = (0, 0) if blur == "lens" else (-0.25, 0.25)
    aperture = core.Aperture(0.3, 4.0, 5, 0.3, 1.5) if blur in ("lens", "both") else core.Aperture()
    view = camera(type=type, ortho_scale=4.0).blurred(shutter, aperture)
    scene = scene_of(cloud(20, 0.005) | {"velocity": velocity})
    found = draw(scene, view, dataclasses.replace(FINE, device="GL"))
    assert differ(found, draw(scene, view)) < 1e-3


def test_opengl_draws_tiles_and_batches_of_smears() -> None:
    """A wide picture of many particles, passes drawn anew, and sharp pictures before and after."""
    settings = core.Settings(device="GL")
    scene = lit_cloud(2000, 0.02, (1.0, 0.5, 0))
    sharp_one = core.render(scene, camera(), settings)["Combined"]
    view = camera(width=300, height=200).blurred((-0.25, 0.25), core.Aperture(0.1, 5.0, 6))
    result = core.render(scene, view, settings, ("Combined", "Albedo"))
    expected = core.render(scene, view, core.Settings(device="TILES"), ("Combined", "Albedo"))
    for name in ("Combined", "Albedo"):
        assert differ(result[name], expected[name]) < 5e-3
    assert (core.render(scene, camera(), settings)["Combined"] == sharp_one).all()


def test_maps_that_smears_do_not_have_are_named() -> None:
    white = np.ones((4, 4, 4))
    white[..., 3] = np.linspace(0.5, 1.0, 4)
    scene = core.Scene(core.Context())
    scene.add_particles([(0, 0, 0)], radius=0.5, density=1.0, emission=1.0, velocity=(1.0, 0, 0), map=white)
    assert not core.render(scene, camera()).warnings
    assert "its map isn't seen" in core.render(scene, camera().blurred((-0.25, 0.25))).warnings[0]
