# SPDX-License-Identifier: GPL-3.0-or-later
"""The smoke that Fumarole and Cycles are compared on, and the tables of documents."""

from __future__ import annotations

import math

import doc_tables
import numpy as np
import pytest
import speed_match


def test_plume_has_the_depth_it_is_asked_for() -> None:
    """Extinction in its middle: the optical depth over the diameter there."""
    smoke = speed_match.plume(4_000, depth=6.0, overlap=2.0)
    inside = smoke.positions[np.abs(smoke.positions[:, 2] - 1.5) < 0.4]
    axis = inside[np.hypot(inside[:, 0] - inside[:, 0].mean(), inside[:, 1] - inside[:, 1].mean()) < 0.15]
    densities, nearest = speed_match.measure(smoke, axis)
    assert densities.mean() == pytest.approx(6.0 / (speed_match.LOW + speed_match.HIGH), rel=0.2)
    assert nearest.max() == 0.0


def test_places_are_measured_by_their_gaussians() -> None:
    smoke = speed_match.Smoke(np.array([[0.0, 0, 0], [2.0, 0, 0]]), 0.5, 3.0)
    densities, nearest = speed_match.measure(smoke, np.array([[0.0, 0, 0], [1.0, 0, 0]]))
    assert densities == pytest.approx([3.0 * (1 + math.exp(-8.0)), 6.0 * math.exp(-2.0)])
    assert nearest == pytest.approx([0.0, 1.0])


def test_spheres_keep_the_total() -> None:
    """One particle: the sphere's mass is that of the Gaussian, within what random places tell."""
    smoke = speed_match.Smoke(np.zeros((1, 3)), 0.5, 1.0)
    spheres = speed_match.fit(smoke, samples=20_000)
    inner = spheres.radius - spheres.voxel  # density rises over a voxel
    shells = np.linspace(0.0, spheres.radius, 2001)
    shape = np.clip((spheres.radius - shells) / spheres.voxel, 0.0, 1.0)
    mass = spheres.density * (shape * 4.0 * math.pi * shells**2).sum() * (shells[1] - shells[0])
    assert inner >= 0.0 and 0.0 < spheres.left < 0.5
    assert mass == pytest.approx((2.0 * math.pi) ** 1.5 * 0.5**3, rel=0.1)


def test_a_table_takes_the_place_of_its_name() -> None:
    table = doc_tables.markdown(("a", "b"), [(1, "\\2"), (3, 4)])
    text = "x\n<!-- table one -->\nold\n<!-- end -->\n<!-- table two -->\nkept\n<!-- end -->\n"
    found = doc_tables.put(text, "one", table)
    assert found == text.replace("old", "| a | b |\n| --- | --- |\n| 1 | \\2 |\n| 3 | 4 |")
    assert doc_tables.put(text, "three", table) == text


def test_numbers_are_short() -> None:
    assert [doc_tables.seconds(value) for value in (123.4, 12.34, 1.234, 0.01234)] == ["123", "12.3", "1.23", "0.012"]
    assert [doc_tables.error(value) for value in (0.00011, 0.012, 0)] == ["1.1e-4", "1.2e-2", "0"]
