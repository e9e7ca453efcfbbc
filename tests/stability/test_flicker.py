# SPDX-License-Identifier: GPL-3.0-or-later
"""What flickers: every case of the table keeps its bound."""

from __future__ import annotations

import animations
import numpy as np
import pytest
from cases import Case
from flicker import CASES


@pytest.mark.parametrize("case", [pytest.param(case, id=case.name) for case in CASES])
def test_stays_within_its_bound(case: Case) -> None:
    assert case.measure() <= case.bound


def test_names_are_unique() -> None:
    assert len({case.name for case in CASES}) == len(CASES)


def test_figures_are_those_of_known_errors() -> None:
    """Motion counts for nothing; noise of 1 % is grain of 1 %; one frame that is 3 % too bright is a jump of 3 %."""
    random = np.random.default_rng(1)
    truth = np.ones((30, 16, 16, 4)) * np.linspace(0.5, 1.5, 30)[:, None, None, None]
    rms = np.sqrt((truth**2).mean())
    still = animations.steadiness(truth * 1.0, truth)
    assert (still.grain, still.jump, still.brightness) == (0, 0, 0)
    noisy = animations.steadiness(truth + random.normal(0, 0.01 * rms, truth.shape), truth)
    assert 0.009 < noisy.grain < 0.011 and 0.013 < noisy.jump < 0.016 and noisy.brightness < 0.003
    bright = truth.copy()
    bright[10] += 0.03
    flash = animations.steadiness(bright, truth)
    assert abs(flash.jump - 0.03 / rms) < 1e-9 and abs(flash.brightness - 0.03) < 1e-9 and flash.grain < 0.01
