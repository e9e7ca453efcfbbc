# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures and light at points, as far as they can be told in closed form, and the manual's example."""

from __future__ import annotations

import dataclasses
import math
import textwrap
from pathlib import Path

import numpy as np
import pytest

from fumarole import core
from fumarole.core import _abi

BACK = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 10.0], [0, 0, 0, 1]])
VIEW = {"matrix": BACK, "type": "ORTHOGRAPHIC", "ortho_scale": 4.0, "width": 33, "height": 17}


def phi(x: float) -> float:
    return 0.5 * math.erfc(-x / math.sqrt(2))


def one_particle(**particle: object) -> core.Scene:
    scene = core.Scene(core.Context())
    scene.add_particles([(0, 0, 0)], **{"radius": 1.0, "density": 2.0} | particle)
    return scene


@pytest.mark.parametrize(
    ("point", "offset", "start", "end"),
    [
        ((0, 0, -8), 0.0, -4.0, 8.0),  # through the centre
        ((2, 0, -4), 1.0 / math.sqrt(17) * 4, None, None),  # beside it
        ((0, 0, 0), 0.0, -4.0, 0.0),  # ends at the centre
        ((0, 0, 0.5), 0.0, -4.0, -0.5),  # ends before it
    ],
)
def test_transmittance_of_one_particle(
    point: tuple[float, float, float], offset: float, start: float | None, end: float | None
) -> None:
    """tau = k sigma sqrt(2 pi) exp(-d^2 / (2 sigma^2)) (Phi(t1 / sigma) - Phi(t0 / sigma)), the light at z = 4."""
    sigma, peak = 0.5, 2.0
    lamp = np.array((0.0, 0.0, 4.0))
    way = np.subtract(point, lamp)
    way /= np.linalg.norm(way)
    nearest = -lamp @ way
    distance = np.linalg.norm(lamp + nearest * way)
    if start is not None:
        assert distance == pytest.approx(offset) and -nearest == pytest.approx(start)
    t0, t1 = -nearest, np.linalg.norm(np.subtract(point, lamp)) - nearest
    depth = peak * sigma * math.sqrt(2 * math.pi) * math.exp(-0.5 * (distance / sigma) ** 2)
    depth *= phi(t1 / sigma) - phi(t0 / sigma)
    scene = one_particle()
    lamp_matrix = np.eye(4)
    lamp_matrix[:3, 3] = lamp
    scene.add_light("POINT", matrix=lamp_matrix)
    found = core.transmittance(scene, [point], settings=core.Settings(tolerance=1e-3))
    assert found[0] == pytest.approx(math.exp(-depth), abs=1e-4)


def test_shadowing_density_multiplies_the_optical_depth() -> None:
    scene = one_particle()
    scene.add_light("SUN")
    once = core.transmittance(scene, [(0.3, 0, -5)], settings=core.Settings(tolerance=1e-3))[0]
    thrice = core.transmittance(scene, [(0.3, 0, -5)], settings=core.Settings(tolerance=1e-3, shadowing_density=3))[0]
    assert thrice == pytest.approx(once**3, abs=2e-4)


def test_opacity_of_one_particle() -> None:
    scene = one_particle()
    result = core.render(scene, core.Camera(**VIEW), core.Settings(tolerance=1e-4))
    picture = result["Combined"]
    assert picture.shape == (17, 33, 4) and picture.dtype == np.float32
    x = (np.arange(33) - 16) * 4 / 33
    y = (np.arange(17) - 8) * 4 / 33
    squared = x[None, :] ** 2 + y[:, None] ** 2
    depth = 2.0 * 0.5 * math.sqrt(2 * math.pi) * np.exp(-squared / (2 * 0.25))
    np.testing.assert_allclose(picture[..., 3], 1 - np.exp(-depth), atol=1e-4)
    assert not picture[..., :3].any()
    assert result["Depth"].shape == (17, 33, 1)


def test_depth_is_the_clip_end_where_nothing_is() -> None:
    scene = core.Scene(core.Context())
    result = core.render(scene, core.Camera(**VIEW, clip=(0.1, 77.0)))
    assert not result["Combined"].any()
    np.testing.assert_allclose(result["Depth"], 77.0)


def test_depth_of_a_solid() -> None:
    scene = core.Scene(core.Context())
    scene.add_mesh([(-9, -9, 1), (9, -9, 1), (9, 9, 1), (-9, 9, 1)], [(0, 1, 2), (0, 2, 3)])
    np.testing.assert_allclose(core.render(scene, core.Camera(**VIEW), passes=["Depth"])["Depth"], 9.0, rtol=1e-6)


def test_first_row_is_at_the_bottom() -> None:
    scene = core.Scene(core.Context())
    scene.add_particles([(0, -0.5, 0)], radius=0.4, density=5.0)
    alpha = core.render(scene, core.Camera(**VIEW))["Combined"][..., 3]
    assert alpha[:8].sum() > 10 * alpha[9:].sum()


def test_crop_draws_the_same_pixels() -> None:
    scene = one_particle()
    scene.add_light("SUN", power=3.0)
    camera = core.Camera(**VIEW)
    whole = core.render(scene, camera)
    part = core.render(scene, camera.crop(5, 3, 25, 15))
    for name in ("Combined", "Depth"):
        np.testing.assert_allclose(part[name], whole[name][3:15, 5:25], rtol=1e-3, atol=1e-5)


def test_only_the_passes_asked_for_are_there() -> None:
    scene = one_particle()
    result = core.render(scene, core.Camera(**VIEW), passes=("Depth",))
    assert list(result) == ["Depth"] and len(result) == 1
    with pytest.raises(core.FumaroleError, match="there is no pass 'Beauty'; passes are Combined, Depth"):
        core.render(scene, core.Camera(**VIEW), passes=("Beauty",))


def test_pass_table() -> None:
    combined, depth = core.PASSES["Combined"], core.PASSES["Depth"]
    assert (combined.channels, combined.kind) == ("RGBA", "COLOR")
    assert (depth.channels, depth.kind) == ("Z", "VALUE")
    assert list(core.PASSES)[:2] == ["Combined", "Depth"]
    assert sorted(item.number for item in core.PASSES.values()) == sorted(_abi.choices("FUM_PASS_").values())
    assert all(item.description for item in core.PASSES.values())


def test_stats_tell_what_was_done() -> None:
    fields = {name for name, *_ in _abi.fum_render_stats._fields_}
    assert {field.name for field in dataclasses.fields(core.Stats)} == fields - {"struct_size"}
    scene = one_particle()
    scene.add_mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    scene.add_light("SUN")
    stats = core.render(scene, core.Camera(**VIEW)).stats
    assert (stats.particle_count, stats.drawn_count, stats.triangle_count, stats.light_count) == (1, 1, 1, 1)
    assert stats.solver in ("EXACT",) and stats.device
    assert stats.total_s >= stats.build_s > 0
    assert core.render(scene, core.Camera(**VIEW)).stats.build_s == 0


def lit_cloud() -> core.Scene:
    scene = core.Scene(core.Context())
    scene.add_particles(np.random.default_rng(5).normal(0, 0.5, (2000, 3)), radius=0.3, density=1.0)
    scene.add_light("POINT", matrix=BACK, power=500)
    return scene


def test_accuracy_of_the_light_is_measured() -> None:
    """The picture's error is at most that of the light: hence the tolerance holds for both."""
    for tolerance in (0.02, 0.002):
        result = core.render(lit_cloud(), core.Camera(**VIEW), core.Settings(tolerance=tolerance))
        stats = result.stats
        assert 256 <= stats.accuracy_count <= 1024
        assert 0 < stats.accuracy_rms < min(tolerance, stats.accuracy_worst)
        assert 0 < stats.accuracy_p95 <= stats.accuracy_worst and abs(stats.accuracy_bias) <= stats.accuracy_rms
        assert stats.meter_s > 0 and stats.light_points > 0 and stats.slab_count > 0
        assert not result.warnings


def test_accuracy_of_particles_drawn_with_gl() -> None:
    stats = core.render(lit_cloud(), core.Camera(**VIEW), core.Settings(device="GL")).stats
    assert stats.light_points == 2000 and stats.accuracy_count == 1024
    assert 0 < stats.accuracy_rms <= stats.accuracy_worst < 1e-3


def test_nothing_is_measured_without_light() -> None:
    stats = core.render(one_particle(), core.Camera(**VIEW)).stats
    assert (stats.accuracy_count, stats.accuracy_rms, stats.accuracy_worst) == (0, 0, 0)


def test_bits_do_not_depend_on_threads() -> None:
    position = np.random.default_rng(2).normal(0, 0.5, (3000, 3))
    pictures = []
    for threads in (1, 2):
        with core.Context(threads=threads) as context:
            scene = core.Scene(context)
            scene.add_particles(position, radius=0.2, density=1.0)
            scene.add_light("POINT", matrix=BACK, power=500)
            pictures.append(core.render(scene, core.Camera(**VIEW)))
    for name in ("Combined", "Depth"):
        np.testing.assert_array_equal(pictures[0][name], pictures[1][name])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"solver": "FAST"}, "settings: solver is 'FAST', expected one of AUTOMATIC, EXACT, SWEEP"),
        ({"device": "CUDA"}, "settings: device is 'CUDA', expected one of AUTO, GL"),
        ({"leaf_size": 2.5}, "settings: leaf_size is 2.5, expected a whole number"),
        ({"leaf_size": 2**40}, "settings: leaf_size is 1099511627776, which is out of range"),
        ({"tolerance": "low"}, "settings: tolerance is 'low', expected a number"),
        ({"leaf_size": 0}, "leaf.?size.*0"),
        ({"light_samples": 1025}, "light.?samples.*1025"),
        ({"tolerance": 0.9}, "tolerance.*0.9"),
        ({"shadowing_density": -1.0}, "shadowing.?density.*-1"),
        ({"solid_shadow_intensity": 1.5}, "solid.?shadow.?intensity.*1.5"),
        ({"subsampling": 0.0}, "subsampling.*0"),
        ({"intersection_scale": 1000.0}, "intersection.?scale.*1000"),
    ],
)
def test_settings_out_of_range_are_named(settings: dict[str, object], message: str) -> None:
    with pytest.raises(core.FumaroleError, match=message) as caught:
        core.render(one_particle(), core.Camera(**VIEW), core.Settings(**settings))
    assert caught.value.code == core.ErrorCode.ARGUMENT


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ({"clip": (5.0, 1.0)}, "clip.*5.*1"),
        ({"clip": (-1.0, 1.0)}, "clip.*-1"),
        ({"width": 70000}, "70000"),
    ],
)
def test_cameras_out_of_range_are_named(camera: dict[str, object], message: str) -> None:
    with pytest.raises(core.FumaroleError, match=message) as caught:
        core.render(one_particle(), core.Camera(**VIEW | camera))
    assert caught.value.code == core.ErrorCode.ARGUMENT


def test_points_and_normals_have_shapes() -> None:
    scene = one_particle()
    scene.add_light("SUN")
    with pytest.raises(core.FumaroleError, match=r"points has shape \(3,\), expected \(n, 3\)"):
        core.transmittance(scene, (0, 0, 0))
    with pytest.raises(core.FumaroleError, match=r"normals has shape \(2, 3\), expected \(1, 3\)"):
        core.irradiance(scene, [(0, 0, 0)], normals=np.zeros((2, 3)))
    with pytest.raises(core.FumaroleError, match="light is 0.5, expected a whole number"):
        core.transmittance(scene, [(0, 0, 0)], light=0.5)
    assert core.transmittance(scene, np.zeros((0, 3))).shape == (0,)
    assert core.irradiance(scene, np.zeros((0, 3))).shape == (0, 3)


def test_normals_give_the_cosine() -> None:
    scene = core.Scene(core.Context())
    scene.add_light("SUN", power=3.0)
    points = [(0, 0, 0)] * 3
    normals = [(0, 0, 1), (0, 0.6, 0.8), (0, 0, -1)]
    np.testing.assert_allclose(core.irradiance(scene, points)[:, 0], 3.0, rtol=1e-6)
    np.testing.assert_allclose(core.irradiance(scene, points, normals=normals)[:, 1], [3.0, 2.4, 0.0], rtol=1e-6)


def test_example_of_the_manual(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paragraphs = core.__doc__.split("\n\n")
    first = next(index for index, text in enumerate(paragraphs) if "import numpy" in text)
    last = next(index for index, text in enumerate(paragraphs) if "write_exr" in text)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(textwrap.dedent("\n\n".join(paragraphs[first : last + 1])), names)  # noqa: S102
    assert names["result"]["Combined"][..., :3].max() > 0
    assert names["result"].warnings == []
    assert (tmp_path / "puff.exr").exists()


def test_version_is_the_header_s() -> None:
    parts = (_abi.FUM_VERSION_MAJOR, _abi.FUM_VERSION_MINOR, _abi.FUM_VERSION_PATCH)
    assert core.version() == ".".join(map(str, parts))
    assert core.version() in core.build_info() and "Embree 3" in core.build_info()
