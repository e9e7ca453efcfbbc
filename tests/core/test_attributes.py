# SPDX-License-Identifier: GPL-3.0-or-later
"""Passes that show what particles are: Albedo, Vector and Cryptomatte, on both devices."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from fumarole import core

DEVICES = ("TILES", "GL")
LEFT, RIGHT = (-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)


def at(x: float, y: float, z: float) -> list[list[float]]:
    return [[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z], [0, 0, 0, 1]]


def camera(x: float = 0.0, **changes: object) -> core.Camera:
    return core.Camera(**{"matrix": at(x, 0, 6), "lens": 50.0, "width": 64, "height": 64} | changes)


def two_puffs() -> core.Scene:
    scene = core.Scene()
    scene.add_particles([LEFT], radius=0.5, density=5.0, albedo=(0.9, 0.5, 0.1), name="Left")
    scene.add_particles([RIGHT], radius=0.5, density=5.0, albedo=(0.2, 0.4, 0.8), name="Right", matte_name="Matte")
    scene.add_light("SUN", power=2.0)
    return scene


@pytest.mark.parametrize("device", DEVICES)
def test_albedo_is_colour_times_opacity(device: str) -> None:
    result = core.render(two_puffs(), camera(), core.Settings(device=device), ("Combined", "Albedo"))
    albedo, alpha = result["Albedo"], result["Combined"][..., 3:]
    assert alpha.max() > 0.7
    assert np.abs(albedo[:, :30] - alpha[:, :30] * np.float32((0.9, 0.5, 0.1))).max() < 2e-3
    assert np.abs(albedo[:, 34:] - alpha[:, 34:] * np.float32((0.2, 0.4, 0.8))).max() < 2e-3


def test_albedo_per_particle_and_of_smoke_behind_smoke() -> None:
    """The one behind shows through the one in front."""
    scene = core.Scene()
    scene.add_particles([(0, 0, 1), (0, 0, -1)], radius=0.5, density=[2.0, 9.0], albedo=[(1, 0, 0), (0, 1, 0)])
    albedo = core.render(scene, camera(type="ORTHOGRAPHIC", width=65, height=65), passes=["Albedo"])["Albedo"][32, 32]
    front, behind = np.exp(-np.array([2.0, 9.0]) * 0.25 * np.sqrt(2 * np.pi))
    assert albedo == pytest.approx([1 - front, front * (1 - behind), 0], abs=2e-3)


@pytest.mark.parametrize("device", DEVICES)
def test_vector_of_moving_particles(device: str) -> None:
    scene = core.Scene()
    scene.add_particles([LEFT], radius=0.5, density=2.0, velocity=(0.3, -0.2, 0.0))
    scene.add_particles([RIGHT], radius=0.5, density=2.0)
    result = core.render(scene, camera(), core.Settings(device=device), ("Combined", "Vector"))
    vector, alpha = result["Vector"], result["Combined"][..., 3]
    per_metre = 64 / 36 * 50 / 6
    left, right = alpha.copy(), alpha.copy()
    left[:, 32:], right[:, :32] = 0, 0
    # The frame before less this one, this one less the one after: both against the motion.
    expected = np.array([-0.3, 0.2, -0.3, 0.2]) * per_metre
    assert np.abs(vector[left > 1e-2] - expected).max() < 0.02 * per_metre
    assert np.abs(vector[right > 1e-2]).max() < 1e-4
    assert np.abs(vector[alpha == 0]).max() == 0


def test_vector_of_a_moving_camera() -> None:
    scene = core.Scene()
    scene.add_particles([(0.0, 0.0, 0.0)], radius=0.5, density=2.0)
    moving = camera().moving(camera(-0.1), camera(0.2))
    vector = core.render(scene, moving, passes=["Vector"])["Vector"][32, 32]
    per_metre = 64 / 36 * 50 / 6
    assert vector == pytest.approx(np.array([0.1, 0, 0.2, 0]) * per_metre, abs=1e-3)
    part = core.render(scene, moving.crop(20, 20, 50, 50), passes=["Vector"])["Vector"][12, 12]
    assert part == pytest.approx(vector, abs=1e-3)
    zoomed = camera().moving(camera(lens=25.0), camera())
    assert core.render(scene, zoomed, passes=["Vector"])["Vector"][32, 32] == pytest.approx([0, 0, 0, 0], abs=1e-3)


def test_vector_in_an_orthographic_view() -> None:
    scene = core.Scene()
    scene.add_particles([(0.0, 0.0, 0.0)], radius=0.5, density=2.0, velocity=(0.0, 0.5, 3.0))
    view = camera(type="ORTHOGRAPHIC", ortho_scale=8.0)
    vector = core.render(scene, view, passes=["Vector"])["Vector"][32, 32]
    assert vector == pytest.approx([0, -4, 0, -4], abs=1e-3)


def test_vector_weighs_what_adds_to_opacity() -> None:
    scene = core.Scene()
    scene.add_particles([(0, 0, 1)], radius=0.5, density=2.0, velocity=(0.1, 0, 0))
    scene.add_particles([(0, 0, -1)], radius=0.5, density=9.0, velocity=(-0.2, 0, 0))
    view = camera(type="ORTHOGRAPHIC", ortho_scale=6.5, width=65, height=65)
    result = core.render(scene, view, passes=("Combined", "Vector"))
    front, behind = np.exp(-np.array([2.0, 9.0]) * 0.25 * np.sqrt(2 * np.pi))
    shares = np.array([1 - front, front * (1 - behind)])
    expected = -(shares * (1.0, -2.0)).sum() / shares.sum()
    assert result["Vector"][32, 32, 0] == pytest.approx(expected, abs=5e-3)


def test_cameras_of_a_motion_are_alike() -> None:
    with pytest.raises(core.FumaroleError, match="moves from PERSPECTIVE 32 x 64"):
        camera().moving(camera(width=32), camera())


def test_crypto_hash_is_that_of_the_specification() -> None:
    """Names and ids of the public specification and of Blender's own files."""
    assert f"{core.crypto_hash('hello'):08x}" == "248bfa47"
    assert f"{core.crypto_hash('hello, world'):08x}" == "149bbb7f"
    assert f"{core.crypto_hash('The quick brown fox jumps over the lazy dog'):08x}" == "2e4ff723"


def test_crypto_ids_are_numbers() -> None:
    for number in range(3000):
        (value,) = struct.unpack("f", struct.pack("I", core.crypto_hash(f"Object.{number:03}")))
        assert np.isfinite(value)
        assert abs(value) >= np.finfo(np.float32).tiny


def coverage(pairs: list[np.ndarray], name: str) -> np.ndarray:
    """The matte of a name, (height, width)."""
    ids = np.concatenate([pair[..., 0::2] for pair in pairs], axis=-1)
    shares = np.concatenate([pair[..., 1::2] for pair in pairs], axis=-1)
    wanted = np.uint32(core.crypto_hash(name))
    return np.where(np.ascontiguousarray(ids).view(np.uint32) == wanted, shares, 0).sum(-1)


@pytest.mark.parametrize("device", DEVICES)
def test_mattes_of_two_puffs(device: str) -> None:
    wanted = ["Combined", ("CryptoObject", 0)]
    result = core.render(two_puffs(), camera(), core.Settings(device=device), wanted)
    pairs, alpha = [result["CryptoObject", 0]], result["Combined"][..., 3]
    left, right = coverage(pairs, "Left"), coverage(pairs, "Matte")
    assert np.abs(left + right - alpha).max() < 2e-3
    assert np.abs(left[:, :30] - alpha[:, :30]).max() < 2e-3
    assert np.abs(right[:, 34:] - alpha[:, 34:]).max() < 2e-3
    assert (pairs[0][..., 1] >= pairs[0][..., 3]).all()


def test_mattes_of_many_names_are_ranked() -> None:
    """Seven puffs behind one another, two of one name; what comes after the last rank is left out."""
    scene = core.Scene()
    depths = [0.2, 0.9, 0.4, 1.3, 0.3, 0.6, 0.5]
    for number, depth in enumerate(depths):
        density = depth / (0.05 * np.sqrt(2 * np.pi))
        scene.add_particles([(0, 0, 3 - number)], radius=0.1, density=density, matte_name=f"Puff {min(number, 5)}")
    view = camera(type="ORTHOGRAPHIC", ortho_scale=0.2, width=33, height=33)
    result = core.render(scene, view, passes=[("CryptoObject", 0), ("CryptoObject", 1), ("CryptoObject", 3)])
    in_front = np.exp(-np.concatenate([[0], np.cumsum(depths)[:-1]]))
    shares = in_front * -np.expm1(-np.array(depths))
    expected = {f"Puff {number}": share for number, share in enumerate([*shares[:5], shares[5] + shares[6]])}
    ranks = sorted(expected, key=expected.get, reverse=True)
    for pair, names in ((0, ranks[:2]), (1, ranks[2:4])):
        for place, name in enumerate(names):
            entry = result["CryptoObject", pair][16, 16, 2 * place : 2 * place + 2]
            assert np.ascontiguousarray(entry).view(np.uint32)[0] == core.crypto_hash(name)
            assert entry[1] == pytest.approx(expected[name], abs=2e-3)
    assert (result["CryptoObject", 3] == 0).all()


def test_passes_that_are_not_there() -> None:
    with pytest.raises(core.FumaroleError, match="number 8 is not one of 8 that there are"):
        core.render(two_puffs(), camera(), passes=[("CryptoObject", 8)])
    with pytest.raises(core.FumaroleError, match="several passes 'CryptoObject'"):
        core.render(two_puffs(), camera(), passes=["CryptoObject"])


def test_nothing_to_show() -> None:
    scene = core.Scene()
    scene.add_light("SUN")
    for device in DEVICES:
        passes = ("Albedo", "Vector", ("CryptoObject", 0))
        result = core.render(scene, camera(), core.Settings(device=device), passes)
        assert all((result[name] == 0).all() for name in passes)


def test_combined_is_the_same_with_them() -> None:
    plain = core.render(two_puffs(), camera(), passes=["Combined"])
    result = core.render(two_puffs(), camera(), passes=["Combined", "Albedo", "Vector", ("CryptoObject", 0)])
    assert (plain["Combined"] == result["Combined"]).all()


def test_passes_of_smoke_that_tints_light() -> None:
    """Red, green and blue see other opacities: mattes and motion are the mean of them, as opacity is."""
    scene = core.Scene()
    red = {"extinction_color": (2.0, 0.6, 0.4)}
    scene.add_particles([(0, 0, 1)], radius=0.5, density=2.0, name="Front", velocity=(0.1, 0, 0), **red)
    scene.add_particles([(0, 0, -1)], radius=0.5, density=4.0, name="Behind", albedo=(0.9, 0.5, 0.1))
    view = camera(type="ORTHOGRAPHIC", ortho_scale=6.5, width=65, height=65)
    result = core.render(scene, view, passes=("Combined", "Albedo", "Vector", ("CryptoObject", 0)))
    front = np.exp(-2.0 * np.array(red["extinction_color"]) * 0.25 * np.sqrt(2 * np.pi))
    behind = np.exp(-4.0 * 0.25 * np.sqrt(2 * np.pi))
    pairs = [result["CryptoObject", 0]]
    assert coverage(pairs, "Front")[32, 32] == pytest.approx((1 - front).mean(), abs=2e-3)
    assert coverage(pairs, "Behind")[32, 32] == pytest.approx((front * (1 - behind)).mean(), abs=2e-3)
    total = coverage(pairs, "Front") + coverage(pairs, "Behind")
    assert np.abs(total - result["Combined"][..., 3]).max() < 2e-3
    assert (pairs[0][..., 1] >= pairs[0][..., 3]).all()
    albedo = (1 - front) * 0.8 + front * (1 - behind) * (0.9, 0.5, 0.1)
    assert result["Albedo"][32, 32] == pytest.approx(albedo, abs=2e-3)
    shares = np.array([1 - front, front * (1 - behind)])
    assert result["Vector"][32, 32, 0] == pytest.approx((-shares[0] / shares.sum(0)).mean(), abs=5e-3)
