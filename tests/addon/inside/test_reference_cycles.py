# SPDX-License-Identifier: GPL-3.0-or-later
"""The reference against Cycles of this Blender: a small version of scripts/compare_cycles.py."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "scripts"))

import compare_cycles  # noqa: E402


def test_single_scattering_is_that_of_cycles(scene: bpy.types.Scene) -> None:
    """Gaussians in shader nodes, a point light, an area light and a wall that shades part of the smoke."""
    size = 16
    compare_cycles.build_blender_scene(size, step=0.08)
    renders = np.stack([compare_cycles.render_cycles(64, 1001 * run) for run in range(10)])
    reference = compare_cycles.render_reference(size)
    found = compare_cycles.compare(renders, reference)
    ratio, error = np.array(found["mean_ratio"]), np.array(found["mean_error"])
    assert (np.abs(ratio - 1.0) < 0.005 + 2.5 * error).all() and error.max() < 0.01, found
    assert found["z_blocks"] < 2.0, found
    # without the wall it is brighter by far more than that
    bpy.data.objects.remove(bpy.data.objects["Wall"])
    assert compare_cycles.render_cycles(64, 0)[..., :3].mean() > 1.1 * reference[..., :3].mean()
