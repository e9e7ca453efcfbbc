# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion blur and depth of field by samples."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from fumarole import core
from fumarole.core import blur

SIZE = 64


def camera(x: float = 0.0, **changes: object) -> core.Camera:
    matrix = [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 6], [0, 0, 0, 1]]
    return core.Camera(**{"matrix": matrix, "lens": 50.0, "width": SIZE, "height": SIZE} | changes)


def puff(place: tuple[float, float, float] = (0, 0, 0), density: float = 0.1, **settings: object) -> core.Scene:
    scene = core.Scene()
    scene.add_particles([place], radius=0.4, density=density, **{"emission": 1.0} | settings)
    return scene


def moments(image: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Sum, mean place and covariance of an image in pixels."""
    y, x = np.mgrid[: image.shape[0], : image.shape[1]] + 0.5
    places = np.stack((x.ravel(), y.ravel()), -1)
    weights = image.ravel().astype(float)
    mean = weights @ places / weights.sum()
    return weights.sum(), mean, np.cov(places.T, aweights=weights, bias=True)


@pytest.mark.parametrize("blades", [0, 3, 4, 5, 8])
@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 16, 64, 256])
def test_cells_make_up_the_aperture(blades: int, count: int) -> None:
    """With what each cell spreads by itself, they spread as the aperture does."""
    aperture = core.Aperture(0.3, blades=blades)
    cells = blur.aperture_cells(aperture, count)
    assert cells.shape == (count, 2) and np.abs(cells.mean(0)).max() < 1e-12
    # Of a polygon of the circumradius 1, by its triangles; of a disc 1/4.
    expected = 0.3**2 * (0.25 if blades == 0 else (2 + math.cos(2 * math.pi / blades)) / 12)
    one = core.BlurSample(0.0, 0, count).camera(camera().blurred(aperture=aperture)).aperture
    own = expected if count == 1 else one.radius**2 / 4
    assert own == pytest.approx(expected / count)
    covariance = cells.T @ cells / count + own * np.eye(2)
    assert np.trace(covariance) == pytest.approx(2 * expected)
    if count != 2:
        assert covariance == pytest.approx(expected * np.eye(2), abs=1e-12)


@pytest.mark.parametrize("blades", [0, 3, 5, 6])
def test_cells_lie_evenly_within_the_aperture(blades: int) -> None:
    cells = blur.aperture_cells(core.Aperture(1.0, blades=blades), 256)
    corners = np.exp(2j * np.pi * np.arange(blades or 720) / (blades or 720))
    sides = np.roll(corners, -1) - corners
    outward = -1j * sides / np.abs(sides)
    beyond = (cells[:, 0] + 1j * cells[:, 1])[:, None] - corners
    assert (beyond * outward.conj()).real.max() < 0.01
    # Every quarter of the area, as seen from the middle, has a quarter of the cells.
    order = np.sort(np.angle(cells[:, 0] + 1j * cells[:, 1]))
    if blades == 0:
        assert np.abs(order - (np.arange(256) + 0.5) / 256 * 2 * np.pi + np.pi).max() < 0.15
    nearest = np.abs((cells[:, None] - cells) @ (1, 1j)) + 9 * np.eye(256)
    area = 0.5 * (blades or 720) * math.sin(2 * math.pi / (blades or 720))
    assert nearest.min() > 0.5 * math.sqrt(area / 256)


def test_aperture_is_turned_and_narrowed() -> None:
    plain = blur.aperture_cells(core.Aperture(1.0, blades=3), 16)
    turned = blur.aperture_cells(core.Aperture(1.0, blades=3, rotation=math.pi / 2), 16)
    assert turned == pytest.approx(np.stack((-plain[:, 1], plain[:, 0]), -1))
    narrow = blur.aperture_cells(core.Aperture(1.0, blades=3, rotation=math.pi / 2, ratio=2.0), 16)
    assert narrow == pytest.approx(turned * (0.5, 1))


@pytest.mark.parametrize("count", [5, 8, 12, 16, 33, 64, 256])
def test_place_and_time_are_not_correlated(count: int) -> None:
    cells = blur.aperture_cells(core.Aperture(1.0), count)
    times = [sample.time for sample in blur.blur_samples((-0.5, 0.5), count)]
    for values in (cells[:, 0], cells[:, 1], np.hypot(*cells.T)):
        assert abs(np.corrcoef(values, times)[0, 1]) < (0.35 if count < 16 else 0.1)


def test_parts_of_the_shutter_join() -> None:
    view = camera().blurred((-0.25, 0.75))
    parts = [(sample.time, sample.camera(view).shutter) for sample in blur.blur_samples(view.shutter, 5)]
    ends = [(time + open, time + close) for time, (open, close) in parts]
    assert ends[0][0] == pytest.approx(-0.25) and ends[-1][1] == pytest.approx(0.75)
    assert [end for _, end in ends[:-1]] == pytest.approx([start for start, _ in ends[1:]])


@pytest.mark.parametrize("type", ["PERSPECTIVE", "ORTHOGRAPHIC"])
def test_what_is_in_focus_stays(type: str) -> None:
    """Off the picture's middle, too; elsewhere it moves by its distance from the plane in focus."""
    view = camera(type=type, ortho_scale=4.0).blurred(aperture=core.Aperture(0.5, focus=6.0))
    places = np.array(((1.0, -0.7, 0.0), (0.0, 0.0, 0.0), (-1.0, 0.4, 0.0), (0.3, 0.2, 1.0)))
    expected, _ = view.project(places)
    shifts = []
    for sample in blur.blur_samples((0, 0), 16):
        found, depth = sample.camera(view).project(places)
        limit = 1e-9 if type == "PERSPECTIVE" else SIZE / 2 * (0.5 / 6) ** 2 / 4 + 1e-9
        assert np.abs(found - expected)[:3].max() < limit
        shifts.append(found[3] - expected[3])
    per_metre = SIZE / 4.0 / 6.0 if type == "ORTHOGRAPHIC" else SIZE / 36 * 50 * (1 / 5 - 1 / 6)
    cells = blur.aperture_cells(view.aperture, 16)
    assert np.abs(shifts + cells * per_metre).max() < (1e-9 if type == "PERSPECTIVE" else 0.02)


def test_moving_camera_is_seen_through_the_lens_too() -> None:
    view = camera().moving(camera(-1.0), camera(1.0)).blurred((0, 0.5), core.Aperture(0.2, focus=4.0))
    sample = blur.blur_samples((0, 0.5), 4)[1]
    part = sample.camera(view)
    for motion, still in zip(part.motion, (camera(-1.0), camera(1.0))):
        expected = sample.camera(still.blurred((0, 0.5), view.aperture))
        assert motion.window == expected.window and np.array_equal(motion.matrix, expected.matrix)


@pytest.mark.parametrize("samples", [16, 64])
def test_thin_smoke_spreads_by_the_circle_of_confusion(samples: int) -> None:
    """The sum stays, the variance grows by that of the aperture's image."""
    aperture = core.Aperture(0.5, focus=4.0, blades=5, ratio=1.5, rotation=0.3)
    scene, view = puff(), camera()
    settings = core.Settings(tolerance=1e-3)  # where a sharp footprint ends counts less then than what blur adds
    sharp = core.render(scene, view, settings, passes=["Combined"])["Combined"][..., 0]
    result = core.render_blurred(lambda time: (scene, view.blurred(aperture=aperture)), settings, ["Combined"], samples)
    assert result.samples == samples
    total, place, spread = moments(sharp)
    blurred_total, blurred_place, blurred_spread = moments(result["Combined"][..., 0])
    assert blurred_total == pytest.approx(total, rel=0.005)
    assert blurred_place == pytest.approx(place, abs=0.02)
    scale = SIZE / 36 * 50 * (1 / 4 - 1 / 6) * 0.5
    expected = scale**2 * (2 + math.cos(0.4 * math.pi)) / 12 * np.diag((1 / 1.5**2, 1))
    assert np.abs(blurred_spread - spread - expected).max() < 0.08 * expected.max()


def test_a_moving_puff_spreads_along_its_way() -> None:
    times = []

    def at(time: float) -> tuple[core.Scene, core.Camera]:
        times.append(time)
        return puff((1.2 * time, 0, 0), velocity=(1.2, 0, 0)), camera().blurred((-0.25, 0.75))

    scene, view = at(0.25)
    sharp = core.render(scene, view.blurred(), passes=["Combined"])["Combined"][..., 0]
    times.clear()
    result = core.render_blurred(at, None, ["Combined", "Depth"], 16)
    assert times == pytest.approx([0.0, *(-0.25 + (np.arange(16) + 0.5) / 16)])
    total, place, spread = moments(sharp)
    blurred_total, blurred_place, blurred_spread = moments(result["Combined"][..., 0])
    assert blurred_total == pytest.approx(total, rel=0.005)
    assert blurred_place == pytest.approx(place, abs=0.02)
    way = 1.2 * SIZE / 36 * 50 / 6
    assert np.abs(blurred_spread - spread - np.diag((way**2 / 12, 0))).max() < 0.02 * way**2 / 12


def test_steady_passes_are_those_of_now() -> None:
    def at(time: float) -> tuple[core.Scene, core.Camera]:
        return puff((time, 0, 0), density=9.0, velocity=(1, 0, 0)), camera().blurred((0, 1), core.Aperture(0.5, 2.0))

    passes = ["Combined", "Depth", "Depth Front", "Depth Back", "Position", "Vector", "Opacity"]
    expected = core.render(puff(density=9.0, velocity=(1, 0, 0)), camera(), passes=passes)
    result = core.render_blurred(at, None, passes, 4)
    assert list(result) == passes
    for name in passes[1:-1]:
        assert np.array_equal(result[name], expected[name])
    for name in ("Combined", "Opacity"):
        assert np.abs(result[name] - expected[name]).max() > 0.1
    assert result["Opacity"][..., 0] == pytest.approx(result["Combined"][..., 3], abs=1e-6)


def test_mean_of_the_same_is_the_same() -> None:
    """Bit by bit, of every pass."""
    scene = puff(density=9.0)
    scene.add_light("SUN", power=2.0)
    scene.add_mesh([(-9, -9, -1), (9, -9, -1), (0, 9, -1)], [(0, 1, 2)])
    passes = [
        *("Combined", "Opacity", "Emit", "Shadow", "Albedo", "Holdout", "Solid Shadow", "Error", "Depth"),
        *(("Light", 0), ("Light Shadow", 0), ("CryptoObject", 0), ("CryptoObject", 1)),
    ]
    expected = core.render(scene, camera(), passes=passes)
    draws = []

    def draw(sample: core.BlurSample, wanted: list) -> core.Result:
        draws.append(sample)
        return core.render(scene, camera(), passes=wanted)

    names = {key: key if isinstance(key, str) else key[0] for key in passes}
    result = core.average(draw, names, (0, 0), 3)
    assert [sample.count for sample in draws] == [0, 3, 3, 3]
    for name in passes:
        assert np.array_equal(result[name], expected[name], equal_nan=True), name
    assert result.stats.accuracy_rms == expected.stats.accuracy_rms
    assert result.stats.particle_count == 1


def fake(pixels: np.ndarray, **stats: object) -> core.Result:
    """A result of nothing but one pass, of one that was rendered."""
    return core.Result({"Combined": pixels}, dataclasses.replace(core.render(puff(), camera()).stats, **stats), [])


@pytest.mark.parametrize(
    ("shutter", "count", "expected"),
    [((0, 0.5), 1, 1), ((0, 0.5), 7, 7), ((0, 1.5), 1, 2), ((-4, 4), 1, 4), ((-4, 4), 3, 4), ((-4, 4), 5, 5)],
)
def test_parts_of_a_long_shutter_are_short_enough(shutter: tuple[float, float], count: int, expected: int) -> None:
    drawn: list[core.BlurSample] = []

    def draw(sample: core.BlurSample, _wanted: list) -> core.Result:
        drawn.append(sample)
        core.render(puff(), sample.camera(camera().blurred(shutter)), passes=["Opacity"])  # the library takes it
        return base

    base = fake(np.ones((2, 2, 4), np.float32))
    result = core.average(draw, {"Combined": "Combined"}, shutter, count)
    assert (result.samples, len(drawn)) == (expected, expected)
    assert np.array_equal(result["Combined"], base["Combined"])


def test_number_of_samples_is_what_the_meter_says() -> None:
    """Of a shutter that is longer than the library takes, in proportion."""
    scene = puff(density=20.0, velocity=(0.8, 0, 0))
    for shutter, times in (((-0.5, 0.5), 1.0), ((-3.0, 3.0), 3.0)):
        view = camera().blurred(shutter)
        measured = core.measure_blur(scene, view.blurred((max(shutter[0], -1), min(shutter[1], 1)))).samples
        assert measured > 2
        assert core.needed_samples(scene, view) == math.ceil(measured * times)
        result = core.render_blurred(lambda time: (scene, view), None, ["Combined"])
        assert result.samples == core.needed_samples(scene, view)
    assert core.needed_samples(scene, camera()) == 1
    assert core.render_blurred(lambda time: (scene, camera()), None, ["Combined"]).samples == 1


def test_stats_are_joined() -> None:
    one = np.ones((2, 2, 4), np.float32)
    results = [
        fake(one, light_s=1.0, memory_bytes=5, accuracy_count=3, accuracy_rms=0.2, accuracy_bias=-0.2),
        fake(one, light_s=2.0, memory_bytes=9, accuracy_count=4, accuracy_rms=0.1, accuracy_bias=0.1),
    ]
    drawn = iter(results)
    stats = core.average(lambda sample, wanted: next(drawn), {"Combined": "Combined"}, (0, 0), 2).stats
    assert (stats.light_s, stats.memory_bytes) == (3.0, 9)
    assert (stats.accuracy_count, stats.accuracy_rms, stats.accuracy_bias) == (3, 0.2, -0.2)


def test_mattes_are_summed_and_ranked_anew() -> None:
    """Two puffs that change places: each covers as much as the mean of its alpha."""

    def at(time: float) -> tuple[core.Scene, core.Camera]:
        scene = core.Scene()
        for side, name in ((-1, "Left"), (1, "Right"), (0, "Middle")):
            place = (side * (1 - 2 * time), 0, 0.1 * side)
            scene.add_particles([place], radius=0.6, density=4.0, name=name, albedo=0.0)
        return scene, camera().blurred((0, 1))

    pairs = [("CryptoObject", 0), ("CryptoObject", 1)]
    result = core.render_blurred(at, None, ["Combined", *pairs], 8)
    ranks = np.concatenate([result[pair] for pair in pairs], -1).reshape(SIZE, SIZE, 4, 2)
    coverage = ranks[..., 1]
    assert (np.diff(coverage, axis=-1) <= 0).all()
    assert coverage.sum(-1) == pytest.approx(result["Combined"][..., 3], abs=2e-3)
    ids = np.ascontiguousarray(ranks[..., 0]).view(np.uint32)
    for name in ("Left", "Right", "Middle"):
        of_name = np.where(ids == core.crypto_hash(name), coverage, 0)
        assert (np.count_nonzero(of_name, -1) <= 1).all()
        expected = np.mean(
            [
                np.where(np.ascontiguousarray(part[..., ::2]).view(np.uint32) == core.crypto_hash(name), part[..., 1::2], 0)
                for sample in blur.blur_samples((0, 1), 8)
                for part in [np.concatenate([r for r in _mattes(at, sample, pairs)], -1)]
            ],
            axis=0,
        ).sum(-1)
        assert of_name.sum(-1) == pytest.approx(expected, abs=1e-6)
        assert of_name.max() > 0.1


def _mattes(at: object, sample: core.BlurSample, pairs: list) -> list[np.ndarray]:
    scene, view = at(sample.time)
    result = core.render(scene, sample.camera(view), None, pairs)
    return [result[pair] for pair in pairs]


@pytest.mark.parametrize(
    ("samples", "shutter", "message"),
    [
        (-1, (0, 0), "-1 samples"),
        (257, (0, 0), "257 samples"),
        (4, (1, 0), "shutter from 1 to 0"),
        (4, (0, 600), "to 600 frames takes 300 samples"),
    ],
)
def test_wrong_values_are_named(samples: int, shutter: tuple[float, float], message: str) -> None:
    with pytest.raises(core.FumaroleError, match=message):
        core.render_blurred(lambda time: (puff(), camera().blurred(shutter)), None, ["Combined"], samples)


def test_an_error_in_a_sample_arrives() -> None:
    def at(time: float) -> tuple[core.Scene, core.Camera]:
        if time > 0.5:
            raise ValueError("no such time")
        return puff(), camera().blurred((0, 1))

    with pytest.raises(ValueError, match="no such time"):
        core.render_blurred(at, None, ["Combined"], 4)


@pytest.mark.parametrize("blades", [0, 5])
def test_sharp_samples_spread_as_the_aperture_does(blades: int) -> None:
    view = camera(type="ORTHOGRAPHIC", ortho_scale=6.0).blurred((-0.5, 0.5), core.Aperture(0.01, 3.0, blades))
    samples = blur.blur_samples(view.shutter, 24, True)
    parts = [sample.camera(view) for sample in samples]
    assert all(part.shutter == (0, 0) and part.aperture.radius == 0 for part in parts)
    places = np.array([part.matrix[:2, 3] for part in parts])
    variance = 0.01**2 * (0.25 if blades == 0 else (2 + math.cos(2 * math.pi / blades)) / 12)
    assert places.T @ places / 24 == pytest.approx(variance * np.eye(2), abs=1e-9)


@pytest.mark.parametrize("density", [0.2, 8.0])
@pytest.mark.parametrize("blur_of", ["motion", "lens"])
def test_as_many_as_it_takes_are_right(density: float, blur_of: str) -> None:
    """Few, dense particles too, which one pass would light wrongly."""
    random = np.random.default_rng(3)
    places = random.normal(0, 0.4, (60, 3))
    speeds = np.stack((-places[:, 1], places[:, 0], np.zeros(60)), -1) + (0.6, 0, 0)
    view = camera(width=40, height=40)
    view = view.blurred((-0.25, 0.25)) if blur_of == "motion" else view.blurred(aperture=core.Aperture(0.4, 4.8))

    def at(time: float) -> tuple[core.Scene, core.Camera]:
        scene = core.Scene()
        scene.add_particles(places + time * speeds, radius=0.3, density=density, velocity=speeds)
        scene.add_light("SUN", [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], 3.0)
        return scene, view

    expected = np.mean(
        [
            core.render(at(sample.time)[0], sample.camera(view), passes=["Combined"])["Combined"].astype(float)
            for sample in blur.blur_samples(view.shutter, 48, True)
        ],
        axis=0,
    )
    found = core.render_blurred(at, None, ["Combined"])["Combined"]
    assert np.sqrt(((found - expected) ** 2).mean() / (expected**2).mean()) < 0.015
    sharp = core.render(at(0)[0], view.blurred(), passes=["Combined"])["Combined"]
    assert np.sqrt(((sharp - expected) ** 2).mean() / (expected**2).mean()) > 0.015
