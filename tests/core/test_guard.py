# SPDX-License-Identifier: GPL-3.0-or-later
"""The guard against slower code: how counts are read and compared. Counting itself is `./run bench guard`."""

from __future__ import annotations

import json

import bench_guard
import pytest

ANNOTATED = """\
Events shown:     Ir
Ir
602,406,092 (100.0%)  PROGRAM TOTALS
Ir                    file:function
331,251,262 (54.99%)  ???:sum [/somewhere/libfumarole.so]
 11,911,200 ( 1.98%)  ./math/../sysdeps/ieee754/flt-32/e_exp2f.c:__exp2f_fma [/usr/lib/libm.so.6]
  4,409,103 ( 0.73%)  ???:merge_range'2 [/somewhere/libfumarole.so]
  4,000,000 ( 0.66%)  ???:merge_range [/somewhere/libfumarole.so]
  3,930,028 ( 0.65%)  ???:build._omp_fn.0
      1,000 ( 0.00%)  ???:tiny [/somewhere/libfumarole.so]
"""


def test_counts_are_read_by_function() -> None:
    found = bench_guard.read_functions(ANNOTATED)
    assert found.instructions == 602_406_092
    assert found.functions == {
        "sum": 331_251_262,
        "__exp2f_fma": 11_911_200,
        "merge_range": 8_409_103,
        "build._omp_fn.0": 3_930_028,
    }
    with pytest.raises(ValueError, match="no total"):
        bench_guard.read_functions("nothing")


@pytest.mark.parametrize(("instructions", "passes"), [(1000, True), (1030, True), (1031, False), (970, True), (969, False)])
def test_three_percent_either_way_is_named(
    instructions: int, passes: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    found = {"work": bench_guard.Count(instructions, {"sum": instructions - 100, "new": 100})}
    kept = {"work": {"instructions": 1000, "functions": {"sum": 900, "gone": 100}}}
    assert bench_guard.check(found, kept) == (not passes)
    out, err = capsys.readouterr()
    line = json.loads(out)
    assert line == {
        "workload": "work",
        "instructions": instructions,
        "kept": 1000,
        "change": pytest.approx(instructions / 1000 - 1),
        "pass": passes,
    }
    assert (err == "") == passes
    if not passes:
        assert ("more" if instructions > 1000 else "fewer") in err and "gone" in err and "new" in err


def test_a_workload_that_is_not_kept_does_not_pass(capsys: pytest.CaptureFixture[str]) -> None:
    assert bench_guard.check({"work": bench_guard.Count(10, {})}, {}) == 1
    out, err = capsys.readouterr()
    assert json.loads(out)["kept"] is None and "--keep" in err


def test_functions_that_changed_most_come_first() -> None:
    found, kept = {"same": 5, "grown": 9, "new": 2}, {"same": 5, "grown": 1, "gone": 3}
    assert bench_guard.changed_functions(found, kept) == [("grown", 9, 1), ("gone", 0, 3), ("new", 2, 0)]


def test_other_conditions_are_named() -> None:
    kept = {"compiler": "GCC 12", "c_library": "glibc 2.36"}
    (sentence,) = bench_guard.differences({"compiler": "GCC 13", "c_library": "glibc 2.36"}, kept)
    assert "GCC 12" in sentence and "GCC 13" in sentence


def test_every_workload_is_kept() -> None:
    kept = bench_guard.read_kept()
    assert set(kept["workloads"]) == set(bench_guard.WORKLOADS)
    assert set(kept["conditions"]) == {"compiler", "c_library", "instruction_set"}
    for counted in kept["workloads"].values():
        assert 0.9 * counted["instructions"] < sum(counted["functions"].values()) <= counted["instructions"]
