# SPDX-License-Identifier: GPL-3.0-or-later
"""Lights linked to what they shine on and to what blocks them: against scenes rendered apart and the reference."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from fumarole import core

VIEW = {"matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 9.0], [0, 0, 0, 1]], "lens": 50}
SIZE = 64

LEFT, RIGHT = (-1.4, 0.0, 0.0), (1.4, 0.2, 0.0)
RED = {"color": (1.0, 0.2, 0.1), "power": 900.0}
BLUE = {"color": (0.1, 0.3, 1.0), "power": 700.0}


def at(x: float, y: float, z: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def camera(size: int = SIZE) -> core.Camera:
    return core.Camera(**VIEW, width=size, height=size)


def puff(center: tuple, count: int, seed: int, **looks: object) -> dict:
    """Random particles around a centre, about 2 thick, that overlap enough to be smooth."""
    position = np.random.default_rng(seed).normal(0.0, 0.35, (count, 3)) + center
    radius = 0.9 * (40.0 / count) ** (1 / 3)
    density = 2.0 * (0.35**2 + radius**2 / 4) / (count * (radius / 2) ** 3) / (2 * np.pi) ** 0.5 * 1.2
    return {"position": position, "radius": radius, "density": density, **looks}


def build(puffs: list[dict], lights: list[dict], add: Callable[[core.Scene], None] | None = None) -> core.Scene:
    scene = core.Scene(core.Context())
    for item in puffs:
        scene.add_particles(**item)
    if add is not None:
        add(scene)
    for light in lights:
        scene.add_light(**{"type": "POINT"} | light)
    return scene


def combined(scene: core.Scene, size: int = SIZE, **settings: object) -> np.ndarray:
    return core.render(scene, camera(size), core.Settings(**settings), ["Combined"])["Combined"]


def relative_rms(found: np.ndarray, expected: np.ndarray) -> float:
    """Of the colours."""
    found, expected = found[..., :3], expected[..., :3]
    return float(np.sqrt(((found - expected) ** 2).mean() / (expected**2).mean()))


COUNTS = {"centres": 1000, "lattice": 60, "many": 12_000}
THIN = 0.02
EMISSION = 1e-4  # for each unit of density


def two_puffs(kind: str, is_uniform: bool) -> list[dict]:
    puffs = [puff(LEFT, COUNTS[kind], 1, name="left"), puff(RIGHT, COUNTS[kind], 2, name="right")]
    if kind == "centres":
        for item in puffs:
            item["density"] *= THIN
    if not is_uniform:
        puffs[1] |= {"anisotropy": 0.05 if kind == "centres" else 0.4, "albedo": (0.9, 0.6, 0.4), "emission": EMISSION * puffs[1]["density"]}
    return puffs


def linked(puffs: list[dict], place: tuple = (0.0, 6.0, 4.0)) -> core.Scene:
    """Each puff lit by a light of its own and casting shadows in that alone."""
    sets = [item | {"light_set": 3 * k + 1, "shadow_set": 7 * k + 2} for k, item in enumerate(puffs)]
    links = [{"light_sets": [3 * k + 1], "shadow_sets": [7 * k + 2]} for k in range(2)]
    lights = [RED | {"matrix": at(*place)}, BLUE | {"matrix": at(1.0, *place[1:])}]
    return build(sets, [light | link for light, link in zip(lights, links)])


def apart(puffs: list[dict], light: int, place: tuple = (0.0, 6.0, 4.0)) -> core.Scene:
    lights = [RED | {"matrix": at(*place)}, BLUE | {"matrix": at(1.0, *place[1:])}]
    return build([puffs[light]], [lights[light]])


@pytest.mark.parametrize("is_uniform", [True, False])
@pytest.mark.parametrize("device", ["TILES", "GL"])
@pytest.mark.parametrize("kind", COUNTS)
def test_two_puffs_with_a_light_each_are_two_pictures(kind: str, device: str, is_uniform: bool) -> None:
    puffs = two_puffs(kind, is_uniform)
    far = (0.0, 60.0, 40.0) if kind == "centres" else (0.0, 6.0, 4.0)
    result = core.render(linked(puffs, far), camera(), core.Settings(device=device), ["Combined"])
    expected = sum(combined(apart(puffs, light, far), device=device) for light in range(2))
    unlinked = [RED | {"matrix": at(*far)}, BLUE | {"matrix": at(1.0, *far[1:])}]
    # The puffs are far enough apart that hardly any pixel shows both.
    assert relative_rms(result["Combined"], expected) < 0.004
    assert relative_rms(combined(build(puffs, unlinked), device=device), expected) > 0.1
    is_lit_at_centres = result.stats.light_points == sum(len(item["position"]) for item in puffs)
    assert is_lit_at_centres == (device == "GL" or kind == "centres")


@pytest.mark.parametrize("is_uniform", [True, False])
def test_passes_of_linked_lights(is_uniform: bool) -> None:
    puffs = two_puffs("lattice", is_uniform)
    wanted = ["Combined", ("Light", 0), ("Light", 1), "Emit"]
    result = core.render(linked(puffs), camera(), passes=wanted)
    parts = sum(result[name] for name in wanted[1:])
    assert np.abs(parts - result["Combined"][..., :3]).max() < 1e-5 * result["Combined"].max()
    for light in range(2):
        alone = core.render(apart(puffs, light), camera(), passes=[("Light", 0)])["Light", 0]
        assert relative_rms(result["Light", light], alone) < 0.004


def test_sets_that_no_light_tells_apart_stay_one_look() -> None:
    """Many sets without linked lights: the same bits as one set, and no limit of looks is met."""
    puffs = [puff((0.1 * k, 0.0, 0.0), 8, k) for k in range(20)]
    light = [RED | {"matrix": at(0, 6, 4)}]
    plain = combined(build(puffs, light))
    np.testing.assert_array_equal(combined(build([item | {"light_set": k} for k, item in enumerate(puffs)], light)), plain)
    sets = {"light_sets": range(30), "shadow_sets": range(30)}
    many = [item | {"light_set": k, "shadow_set": k} for k, item in enumerate(puffs)]
    np.testing.assert_array_equal(combined(build(many, [light[0] | sets])), plain)


def test_too_many_looks_are_refused_by_name() -> None:
    puffs = [puff((0.1 * k, 0.0, 0.0), 2, k, light_set=k, name=f"puff {k}") for k in range(20)]
    lights = [RED | {"matrix": at(0, 6, 4), "light_sets": [k]} for k in range(20)]
    with pytest.raises(core.FumaroleError, match="puff 16: more than 16 different"):
        combined(build(puffs, lights))


ABOVE = {"matrix": at(0.0, 7.0, 0.0), "power": 2000.0}
BLOCKER = puff((0.0, 2.0, 0.0), 60, 3, shadow_set=5, name="blocker")
RECEIVER = puff((0.0, 0.0, 0.0), 60, 4, name="receiver")
POINTS = np.array([(0.0, 0.0, 0.0), (0.1, -0.3, 0.2), (0.0, 2.0, 0.0), (0.4, -5.0, 0.3)])


@pytest.mark.parametrize("solver", ["EXACT", "SWEEP"])
@pytest.mark.parametrize("subsampling", [1.0, 0.999])
def test_a_puff_that_does_not_block(solver: str, subsampling: float) -> None:
    """The share of light that passes is that of the scene without what the light isn't blocked by."""
    settings = core.Settings(solver=solver, subsampling=subsampling, tolerance=1e-3)
    big = puff((0.0, 2.0, 0.0), 12_000, 3, shadow_set=5)
    scene = build([big, RECEIVER], [ABOVE, ABOVE | {"shadow_sets": [0]}, ABOVE | {"shadow_sets": []}])
    blocked, linked, free = (core.transmittance(scene, POINTS, k, settings) for k in range(3))
    without = core.transmittance(build([RECEIVER], [ABOVE]), POINTS, 0, settings)
    both = core.transmittance(build([big, RECEIVER], [ABOVE]), POINTS, 0, settings)
    assert np.abs(linked - without).max() < 2e-3 and np.abs(blocked - both).max() < 2e-3
    assert (free == 1).all()
    assert blocked[0] < 0.5 * linked[0] and linked[0] < 0.99


def test_media_follow_the_lights() -> None:
    """What was built for other lights is of no harm to those that come after them."""
    scene = build([BLOCKER, RECEIVER], [ABOVE | {"shadow_sets": [0]}])
    shares = []
    for sets in ([0], None, [5], [], None, [0]):
        scene.clear_lights()
        scene.add_light(**{"type": "POINT"} | ABOVE, shadow_sets=sets)
        shares.append(float(core.transmittance(scene, POINTS[:1])[0]))
        fresh = build([BLOCKER, RECEIVER], [ABOVE | {"shadow_sets": sets}])
        assert shares[-1] == core.transmittance(fresh, POINTS[:1])[0]
    assert shares[0] == shares[5] and shares[1] == shares[4] and len(set(shares)) == 4


def wall(scene: core.Scene, z: float = 1.0, **sets: int) -> None:
    """A horizontal square, half a metre wide."""
    corners = [(-0.5, z, -0.5), (0.5, z, -0.5), (0.5, z, 0.5), (-0.5, z, 0.5)]
    scene.add_mesh(corners, [(0, 1, 2), (0, 2, 3)], **{"name": "wall"} | sets)


def test_solids_that_do_not_block() -> None:
    def add(scene: core.Scene) -> None:
        wall(scene, shadow_set=1)
        wall(scene, 1.5, shadow_set=2)

    sets = {"both": None, "one": [0, 2], "none": [0], "other": [0, 1]}
    scene = build([RECEIVER], [ABOVE | {"shadow_sets": chosen} for chosen in sets.values()], add)
    shares = dict(zip(sets, (core.transmittance(scene, POINTS[:1], k)[0] for k in range(4))))
    assert shares["both"] == shares["one"] == shares["other"] == 0
    assert shares["none"] == core.transmittance(build([RECEIVER], [ABOVE]), POINTS[:1])[0] > 0.1


SOFT = {"type": "AREA", "matrix": [[1, 0, 0, 0], [0, 0, 1, 5.0], [0, -1, 0, 0], [0, 0, 0, 1]], "size": 0.6, "power": 900.0}
SCENES = {
    "lit apart": [RED | {"matrix": at(-3, 5, 2), "light_sets": [1]}, BLUE | {"matrix": at(3, 4, 2)}],
    "blocked apart": [RED | {"matrix": at(0.3, 5, 1), "shadow_sets": [0, 2]}, BLUE | {"matrix": at(0, 6, 0)}],
    "solid lets through": [ABOVE | {"shadow_sets": [0, 1]}],
    "all at once": [ABOVE | {"shadow_sets": [2], "light_sets": [0]}, ABOVE | {"shadow_sets": [0], "light_sets": [1]}],
}


@pytest.mark.parametrize("name", SCENES)
def test_agrees_with_the_reference(name: str) -> None:
    """Two puffs one above the other, a solid between them."""
    lower = puff((0.0, -0.2, 0.0), 40, 5, name="lower")
    upper = puff((0.2, 1.9, 0.0), 40, 6, light_set=1, shadow_set=1, anisotropy=0.2, name="upper")

    def add(scene: core.Scene) -> None:
        wall(scene, shadow_set=2, visible_to_camera=False)

    scene = build([lower, upper], SCENES[name], add)
    expected = core.render_reference(scene, camera(16), tolerance=1e-3)["Combined"]
    found = combined(scene, 16)
    free = [{key: value for key, value in light.items() if key[-4:] != "sets"} for light in SCENES[name]]
    assert relative_rms(found, expected) < 0.01
    assert relative_rms(combined(build([lower, upper], free, add), 16), expected) > 0.03


def test_soft_light_linked_to_solids_and_smoke() -> None:
    lower = puff((0.0, -0.2, 0.0), 40, 5, name="lower")
    upper = puff((0.2, 1.9, 0.0), 40, 6, light_set=1, shadow_set=1, name="upper")
    light = SOFT | {"shadow_sets": [0, 2], "light_sets": [0]}
    scene = build([lower, upper], [light], lambda scene: wall(scene, shadow_set=2, visible_to_camera=False))
    expected = core.render_reference(scene, camera(12), tolerance=3e-3, light_samples=256)["Combined"]
    assert relative_rms(combined(scene, 12, light_samples=64), expected) < 0.03


@pytest.mark.parametrize("device", ["TILES", "GL"])
def test_smoke_that_the_camera_does_not_see(device: str) -> None:
    """It blocks light, and nothing else is seen of it."""
    hidden = BLOCKER | {"visible_to_camera": False}
    light = [ABOVE]
    result = core.render(build([hidden, RECEIVER], light), camera(), core.Settings(device=device))
    alone = core.render(build([RECEIVER], light), camera(), core.Settings(device=device))
    seen = combined(build([BLOCKER, RECEIVER], light), device=device)
    assert np.abs(result["Combined"][..., 3] - alone["Combined"][..., 3]).max() < 2e-3
    np.testing.assert_allclose(result["Depth"], alone["Depth"], rtol=1e-3)
    below = slice(0, SIZE // 2)  # of the picture, where the blocker isn't
    assert relative_rms(result["Combined"][below], seen[below]) < 0.004
    assert relative_rms(result["Combined"], alone["Combined"]) > 0.2
    assert (combined(build([hidden], light), device=device) == 0).all()


def test_hidden_smoke_agrees_with_the_reference() -> None:
    scene = build([BLOCKER | {"visible_to_camera": False}, RECEIVER], [ABOVE])
    expected = core.render_reference(scene, camera(16), tolerance=1e-3)["Combined"]
    assert relative_rms(combined(scene, 16), expected) < 0.01


def test_dust_shades_itself_only_where_it_blocks() -> None:
    """Particles thinner than a pixel, dense enough to shade themselves."""
    dust = {"position": np.random.default_rng(2).normal(0, 0.5, (200, 3)), "radius": 0.01, "density": 150.0, "shadow_set": 4}
    light = {"type": "SUN", "power": 3.0}
    free = combined(build([dust], [light | {"casts_shadows": False}]))
    np.testing.assert_allclose(combined(build([dust], [light | {"shadow_sets": [0]}])), free, rtol=1e-3, atol=1e-6)
    assert combined(build([dust], [light]))[..., :3].sum() < 0.8 * free[..., :3].sum()


def floor_scene(light_set: int, links: list[dict]) -> core.Scene:
    """A puff above a floor seen from above, two suns aslant."""
    tilts = [[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], [[0.8, 0, 0.6, 0], [0, 1, 0, 0], [-0.6, 0, 0.8, 0], [0, 0, 0, 1]]]
    corners = [(-9, -9, -1), (9, -9, -1), (9, 9, -1), (-9, 9, -1)]
    lights = [{"type": "SUN", "matrix": tilt, **link} for tilt, link in zip(tilts, links)]
    return build([RECEIVER], lights, lambda scene: scene.add_mesh(corners, [(0, 1, 2), (0, 2, 3)], light_set=light_set))


def test_shadows_on_a_floor_come_from_lights_that_light_it() -> None:
    links = [{"light_sets": [0, 3]}, {"light_sets": [0]}]
    passes = ["Shadow", ("Light Shadow", 0), ("Light Shadow", 1)]
    result = core.render(floor_scene(3, links), camera(), passes=passes)
    plain = core.render(floor_scene(0, links), camera(), passes=passes)
    np.testing.assert_allclose(result["Light Shadow", 0], plain["Light Shadow", 0], atol=2e-3)
    np.testing.assert_array_equal(result["Shadow"], result["Light Shadow", 0])
    assert (result["Light Shadow", 1] == 1).all()
    assert plain["Light Shadow", 1].min() < 0.7 and np.abs(plain["Shadow"] - result["Shadow"]).max() > 0.1


BAD = {
    "light_set": ({"light_set": 64}, "bad: light_set 64 is not within 0..63"),
    "shadow_set": ({"shadow_set": 64}, "bad: shadow_set 64 is not within -?[01]..63"),
    "negative": ({"light_set": -1}, "bad: light_set -1 is not within 0..63"),
    "light_set text": ({"light_set": "1"}, "light_set of 'bad'"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_sets_are_refused_by_name(name: str) -> None:
    keywords, message = BAD[name]
    scene = core.Scene(core.Context())
    with pytest.raises(core.FumaroleError, match=message):
        scene.add_particles([(0, 0, 0)], name="bad", **keywords)
    with pytest.raises(core.FumaroleError, match=message):
        scene.add_mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)], name="bad", **keywords)


def test_smoke_that_blocks_no_light() -> None:
    """Set -1 is of no light, whatever sets it is blocked by; solids are in a set always."""
    scene = build([BLOCKER | {"shadow_set": -1}, RECEIVER], [ABOVE])
    alone = core.transmittance(build([RECEIVER], [ABOVE]), POINTS)
    assert core.transmittance(scene, POINTS) == pytest.approx(alone, abs=1e-3)
    expected = core.render_reference(scene, camera(12), tolerance=1e-3)["Combined"]
    assert relative_rms(combined(scene, 12), expected) < 0.01
    with pytest.raises(core.FumaroleError, match="wall: shadow_set -1 is not within 0..63"):
        wall(scene, shadow_set=-1)


@pytest.mark.parametrize("field", ["light_sets", "shadow_sets"])
def test_bad_sets_of_lights_are_refused_by_name(field: str) -> None:
    scene = core.Scene(core.Context())
    for sets, value in (([0, 64], "64"), ([-1], "-1")):
        with pytest.raises(core.FumaroleError, match=f"{field} of 'lamp' holds {value}, expected 0 to 63"):
            scene.add_light("POINT", name="lamp", **{field: sets})


def test_what_is_built_again_for_other_lights() -> None:
    """Nothing, unless a light is blocked by a choice of sets that no light was blocked by before."""
    scene = build([BLOCKER, RECEIVER], [ABOVE])
    built = []
    for sets in (None, None, [0, 5], [0], [0]):
        scene.clear_lights()
        scene.add_light(**{"type": "POINT"} | ABOVE, shadow_sets=sets)
        built.append(core.render(scene, camera(8), passes=["Combined"]).stats.build_s > 0)
    assert built == [True, False, False, True, False]
