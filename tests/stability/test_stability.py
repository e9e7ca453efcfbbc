# SPDX-License-Identifier: GPL-3.0-or-later
"""Where methods fail: every case of the table keeps its bound."""

from __future__ import annotations

import pytest
from cases import CASES, Case


@pytest.mark.parametrize("case", [pytest.param(case, id=case.name) for case in CASES])
def test_stays_within_its_bound(case: Case) -> None:
    assert case.measure() <= case.bound


def test_names_are_unique_and_at_least_forty() -> None:
    names = {case.name for case in CASES}
    assert len(names) == len(CASES) >= 40
