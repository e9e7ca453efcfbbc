# SPDX-License-Identifier: GPL-3.0-or-later
"""What the meter of the light's accuracy decides."""

from __future__ import annotations

import numpy as np

from clouds import cloud, lit
from fumarole import core

SMOKE = cloud(20_000, 0.08, 0.2)  # optical depth 20


def stats_of(light_z: float, solver: str) -> core.Stats:
    light = np.eye(4)
    light[2, 3] = light_z
    view = np.eye(4)
    view[2, 3] = 6.0
    scene = lit(SMOKE, ({"type": "POINT", "matrix": light},))
    camera = core.Camera(matrix=view, width=64, height=64)
    return core.render(scene, camera, core.Settings(device="TILES", tolerance=0.005, solver=solver)).stats


def test_light_that_a_sweep_misses_is_solved_exactly() -> None:
    """Through all of the smoke hardly any light comes, of which a sweep loses too large a part; the meter says so."""
    assert stats_of(4.0, "AUTOMATIC").solver == "SWEEP"
    swept, chosen = stats_of(-4.0, "SWEEP"), stats_of(-4.0, "AUTOMATIC")
    assert (swept.solver, chosen.solver) == ("SWEEP", "EXACT")
    assert chosen.accuracy_rms < 0.5 * swept.accuracy_rms
