# SPDX-License-Identifier: GPL-3.0-or-later
"""The smoke in depth: its samples over one another are Combined, and what is put between them looks as if it were in the
scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from exr_reader import read_deep

from fumarole import core

SIZE = 72
FROM_ABOVE = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]
CORNERS = np.array([(-9, -9), (9, -9), (9, 9), (-9, 9)], float)


def puff(
    scene: core.Scene, count: int, depth: float, radius: float | None = None, seed: int = 1, **look: object
) -> None:
    """A ball of radius 1 with about that optical depth."""
    random = np.random.default_rng(seed)
    places = random.normal(size=(count, 3))
    places *= (random.uniform(size=count) ** (1 / 3) / np.linalg.norm(places, axis=1))[:, None]
    radius = radius or 2 * (0.7 / count) ** (1 / 3)
    density = depth / 2 * (4 / 3 * np.pi) / (count * (2 * np.pi) ** 1.5 * (radius / 2) ** 3)
    scene.add_particles(places, radius=radius, density=density, **{"albedo": (0.9, 0.8, 0.6), **look})


def thin(scene: core.Scene) -> None:
    puff(scene, 500, 0.2)


def thick(scene: core.Scene) -> None:
    puff(scene, 1000, 12.0)


def few(scene: core.Scene) -> None:
    puff(scene, 20, 3.0)


def glowing(scene: core.Scene) -> None:
    puff(scene, 300, 0.5, emission=(0.6, 0.2, 0.05))


def flame(scene: core.Scene) -> None:
    """It glows and absorbs nothing; smoke is around it."""
    puff(scene, 100, 1e-9, radius=0.5, emission=(0.6, 0.2, 0.05))
    puff(scene, 200, 1.0, seed=2)


def two_materials(scene: core.Scene) -> None:
    puff(scene, 500, 1.5, anisotropy=0.6)
    puff(scene, 300, 1.0, seed=2, anisotropy=-0.3, albedo=(0.2, 0.4, 0.9))


def tinted(scene: core.Scene) -> None:
    """Red, green and blue are weakened by different shares; grey smoke is around it."""
    puff(scene, 300, 2.0, extinction_color=(0.4, 1.0, 2.0))
    puff(scene, 300, 1.0, seed=2)


def dust(scene: core.Scene) -> None:
    """Thinner than pixels, lit at their centres."""
    puff(scene, 4000, 0.3, radius=0.01)


PUFFS = [thin, thick, few, glowing, flame, two_materials, tinted, dust]


def make(
    furnish: object, card: float | None = None, has_bar: bool = False, context: core.Context | None = None
) -> core.Scene:
    """A lit puff. card: a wall across it at that height, which casts no shadow. has_bar: a slanted bar amid it."""
    scene = core.Scene(context)
    furnish(scene)
    scene.add_light("POINT", matrix=[[1, 0, 0, 3], [0, 1, 0, 2], [0, 0, 1, 2], [0, 0, 0, 1]], power=1000.0)
    if card is not None:
        scene.add_mesh(np.c_[CORNERS, np.full(4, card)], [(0, 1, 2), (0, 2, 3)], visible_to_shadow=False)
    if has_bar:
        scene.add_mesh([(-3, -0.5, 0.1), (3, 0.2, 0.3), (3, 0.5, 0.3), (-3, -0.2, 0.1)], [(0, 1, 2), (0, 2, 3)])
    return scene


CAMERAS = {
    "perspective": core.Camera(matrix=FROM_ABOVE, lens=50, width=SIZE, height=SIZE),
    "orthographic": core.Camera(matrix=FROM_ABOVE, type="ORTHOGRAPHIC", ortho_scale=2.6, width=SIZE, height=SIZE),
    "near plane": core.Camera(matrix=FROM_ABOVE, lens=50, clip=(3.8, 100.0), width=SIZE, height=SIZE),
    "amid": core.Camera(
        matrix=[[1, 0, 0, 0.1], [0, 1, 0, 0], [0, 0, 1, 0.2], [0, 0, 0, 1]],
        lens=20,
        clip=(0.01, 100.0),
        width=SIZE,
        height=SIZE,
    ),
}


def flatten(counts: np.ndarray, samples: np.ndarray, depth: float = np.inf) -> np.ndarray:
    """What is in front of a depth, (height, width, 4): a sample that holds the depth is cut as the header says."""
    samples = samples.astype(float)
    counts, shape = counts.astype(int), counts.shape
    share = np.clip((depth - samples[:, 4]) / (samples[:, 5] - samples[:, 4]), 0, 1)
    whole = samples[:, 3]
    part = -np.expm1(share * np.log1p(-whole))
    with np.errstate(invalid="ignore"):
        colors = samples[:, :3] * np.where(whole > 0, part / whole, share)[:, None]
    first = np.cumsum(counts.ravel()) - counts.ravel()
    result = np.zeros((counts.size, 4))
    left = np.ones(counts.size)
    for layer in range(counts.max(initial=0)):
        pixels = np.flatnonzero(counts.ravel() > layer)
        sample = first[pixels] + layer
        result[pixels, :3] += left[pixels, None] * colors[sample]
        left[pixels] *= 1 - part[sample]
    result[:, 3] = 1 - left
    return result.reshape(*shape, 4)


def check_order(counts: np.ndarray, samples: np.ndarray, camera: core.Camera) -> None:
    front, back = samples[:, 4], samples[:, 5]
    pixel = np.repeat(np.arange(counts.size), counts.ravel())
    is_same = pixel[1:] == pixel[:-1]
    assert (front < back).all()
    assert (front[1:] >= back[:-1])[is_same].all()
    assert (front >= np.float32(camera.clip[0]) * (1 - 1e-6)).all()
    assert (samples[:, :4] >= 0).all() and (samples[:, 3] < 1).all()


@pytest.mark.parametrize("view", CAMERAS)
@pytest.mark.parametrize("furnish", PUFFS, ids=lambda furnish: furnish.__name__)
def test_samples_make_combined(furnish: object, view: str) -> None:
    for has_bar in (False, True):
        scene = make(furnish, has_bar=has_bar, context=core.Context())
        result = core.render(scene, CAMERAS[view], passes=["Combined"], deep=True)
        assert result.warnings == []
        counts, samples = result.deep.counts, result.deep.samples
        combined = result["Combined"]
        assert combined[..., 3].max() > (0.05 if furnish is not flame else 0.0)
        assert abs(flatten(counts, samples) - combined).max() < 1e-4 * max(1.0, combined.max())
        check_order(counts, samples, CAMERAS[view])


def test_edges_of_solids_are_mixed() -> None:
    """Where the bar's edge runs through a pixel, samples go on behind it, with less of the pixel."""
    result = core.render(make(thick, has_bar=True), CAMERAS["perspective"], passes=["Combined", "Depth"], deep=True)
    counts, samples = result.deep.counts, result.deep.samples
    last = samples[np.cumsum(counts.ravel()).astype(int) - 1, 5].reshape(counts.shape)
    column = last[20:52, SIZE // 2]
    # in front of the bar smoke ends at it, 3.8 m from the camera; it is a few pixels wide
    inside = np.flatnonzero(column < 3.9)
    assert 4 < len(inside) < 12 and np.ptp(inside) == len(inside) - 1
    assert abs(column[inside] - 3.8).max() < 0.05


def test_depths_are_along_the_axis() -> None:
    """A particle in the corner of a wide view, where distance is 1.2 times as much: half of its opacity lies in front of its
    own depth. The nearer half looks a little larger."""
    scene = core.Scene()
    scene.add_particles([(2.0, 2.0, 0.0)], radius=0.2, density=0.5)
    camera = core.Camera(matrix=FROM_ABOVE, lens=25, width=SIZE, height=SIZE)
    deep = core.render(scene, camera, core.Settings(tolerance=0.001), passes=[], deep=True).deep
    front, whole = flatten(deep.counts, deep.samples, 4.0)[..., 3], flatten(deep.counts, deep.samples)[..., 3]
    assert front.sum() == pytest.approx(0.51 * whole.sum(), rel=0.05)
    assert whole.sum() > 0.1


@pytest.mark.parametrize("furnish", [thin, thick, few, two_materials, tinted, flame], ids=lambda furnish: furnish.__name__)
def test_a_card_between_samples_is_one_in_the_scene(furnish: object) -> None:
    """Composited into the smoke at a depth, an opaque card hides what the same card as a holdout hides."""
    tolerance = 0.01
    result = core.render(make(furnish), CAMERAS["perspective"], passes=["Combined"], deep=True)
    counts, samples, combined = result.deep.counts, result.deep.samples, result["Combined"]
    least = np.maximum(combined[..., 3], 0.25)
    hidden = []
    for height in (0.6, 0.15, -0.4):
        with_card = core.render(make(furnish, card=height), CAMERAS["perspective"], passes=["Combined"])["Combined"]
        error = flatten(counts, samples, 4 - height) - with_card
        # opacity by pixel: the limit that the header gives, and what cutting slabs is off by
        assert (abs(error[..., 3]) < (1.1 * tolerance + 0.007) * least).all()
        scale = combined[..., :3].max() * (least.max() / combined[..., 3].max() if furnish is not flame else 1.0)
        assert np.sqrt((error[..., :3] ** 2).mean()) < 0.5 * tolerance * scale
        assert abs(error[..., :3]).max() < 2 * tolerance * scale
        hidden.append((combined - with_card)[..., :3].max() / scale)
    # ...and that is much less than what the card hides
    assert max(hidden) > 20 * tolerance


def test_a_solid_card_over_a_bright_background() -> None:
    """The whole composite, with light that comes from the card itself."""
    result = core.render(make(few), CAMERAS["perspective"], passes=["Combined"], deep=True)
    front = flatten(result.deep.counts, result.deep.samples, 3.8)
    card = np.array([0.9, 0.5, 0.2])
    composite = front[..., :3] + (1 - front[..., 3:]) * card
    scene_card = core.render(make(few, card=0.2), CAMERAS["perspective"], passes=["Combined"])["Combined"]
    truth = scene_card[..., :3] + (1 - scene_card[..., 3:]) * card
    assert np.sqrt(((composite - truth) ** 2).mean() / (truth**2).mean()) < 0.01


def test_tighter_tolerance_takes_more_samples() -> None:
    numbers = []
    for tolerance in (0.05, 0.01, 0.002):
        settings = core.Settings(tolerance=tolerance)
        numbers.append(
            len(core.render(make(few), CAMERAS["perspective"], settings, passes=[], deep=True).deep.samples)
        )
    assert numbers[0] < 0.7 * numbers[1] < 0.5 * numbers[2]


def test_few_samples_for_many_particles() -> None:
    scene = make(lambda scene: puff(scene, 100_000, 8.0))
    counts = core.render(scene, CAMERAS["perspective"], passes=[], deep=True).deep.counts
    assert 4 < counts[counts > 0].mean() < 16
    assert counts.max() < 40


def test_pictures_do_not_change() -> None:
    """The same bits with and without, and with passes of their own for lights."""
    plain = core.render(make(two_materials), CAMERAS["perspective"], passes=["Combined"])["Combined"]
    with_deep = core.render(make(two_materials), CAMERAS["perspective"], passes=["Combined"], deep=True)
    np.testing.assert_array_equal(with_deep["Combined"], plain)
    wanted = ["Combined", ("Light", 0), "Emit", "Albedo", "Solid Shadow", "Vector"]
    parts = core.render(make(glowing, has_bar=True), CAMERAS["perspective"], passes=wanted, deep=True)
    assert abs(flatten(parts.deep.counts, parts.deep.samples) - parts["Combined"]).max() < 1e-4


def test_threads_change_no_bit_of_joined_channels() -> None:
    found = []
    for threads in (1, 3):
        with core.Context(threads) as context:
            scene = make(tinted, has_bar=True, context=context)
            found.append(core.render(scene, CAMERAS["perspective"], passes=[], deep=True).deep.samples)
    np.testing.assert_array_equal(found[0], found[1])


def test_joining_channels_is_cancelled() -> None:
    def cancel(_stage: str, _fraction: float, message: str) -> bool:
        return message == "Joining channels"

    with core.Context(progress=cancel) as context, pytest.raises(core.Cancelled):
        core.render(make(tinted, context=context), CAMERAS["perspective"], passes=[], deep=True)


def test_file_holds_what_memory_does(tmp_path: Path) -> None:
    deep = core.render(make(few, has_bar=True), CAMERAS["perspective"], passes=[], deep=True).deep
    path = tmp_path / "Rauchsäule 煙.exr"
    deep.write(path)
    counts, samples = read_deep(path)
    np.testing.assert_array_equal(counts, deep.counts)
    np.testing.assert_array_equal(samples, deep.samples)
    deep.write(path, (200, 100, 60, 7))
    np.testing.assert_array_equal(read_deep(path)[1], deep.samples)


def test_missing_folder_is_a_file_error_that_names_the_path(tmp_path: Path) -> None:
    deep = core.render(make(few), CAMERAS["perspective"], passes=[], deep=True).deep
    path = tmp_path / "nowhere" / "deep.exr"
    with pytest.raises(core.FumaroleError, match=str(path)) as caught:
        deep.write(path)
    assert caught.value.code == core.ErrorCode.FILE
    assert not list(tmp_path.iterdir())


def test_opengl_is_refused() -> None:
    with pytest.raises(core.FumaroleError, match="deep pixels: OpenGL keeps no depths; use the device tiles"):
        core.render(make(few), CAMERAS["perspective"], core.Settings(device="GL"), deep=True)


def test_closed_deep_pixels_say_so() -> None:
    with core.Context() as context:
        scene = core.Scene(context)
        thin(scene)
        deep = core.render(scene, CAMERAS["perspective"], passes=[], deep=True).deep
        assert len(deep.samples) == deep.counts.sum() > 0
    with pytest.raises(core.FumaroleError, match="the deep pixels are closed"):
        deep.counts
    assert core.render(make(thin), CAMERAS["perspective"]).deep is None
