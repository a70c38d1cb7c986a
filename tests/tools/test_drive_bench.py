"""Drives from end to end are found the same way each time, where the car fits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.costmap import UnknownSpace, costmap
from tools.drive_bench import Bench, Mapped


def mapped():
    """A free hall of 12 m x 6 m at 0.05 m, driven along its middle."""
    cells = np.full((120, 240), -5.0, np.float32)
    cells[[0, -1], :] = 5.0
    cells[:, [0, -1]] = 5.0
    driven = np.column_stack([np.arange(1.0, 11.0, 0.1), np.full(100, 3.0), np.zeros(100)])
    return Mapped(OccupancyGrid(cells, 0.05, np.zeros(3)), driven, np.array([1.0, 2.0, 0.3]))


@pytest.mark.parametrize("within_m", [0.8, math.inf])
def test_cases_are_repeatable_apart_and_as_near_to_the_mapping_drive_as_wanted(within_m):
    bench = Bench(mapped(), 5, within_m)
    cases = [bench.case(number) for number in (0, 1, 2, 0)]
    np.testing.assert_array_equal(cases[0].start, cases[3].start)
    assert not np.allclose(cases[0].start, cases[1].start)
    known = costmap(bench.mapped.grid, bench.vehicle, UnknownSpace.forbidden)
    for case in cases:
        assert 2.0 < np.hypot(*(case.goal - case.start)[:2]) < 8.0
        assert 0.0 < np.hypot(*se2.between(case.start, case.told)[:2]) < 0.3
        assert known.fits(case.start)
        assert known.fits(case.goal)
    beside = [abs(end[1] - 3.0) for case in cases for end in (case.start, case.goal)]
    assert (max(beside) <= 0.8) == (within_m == 0.8)


def test_the_truth_is_told_in_the_maps_frame():
    bench = Bench(mapped(), 5)
    case = bench.case(0)
    _, _, car = case.loop()
    car.world.advance(2_000_000_000)
    truth = case.truth(car)
    np.testing.assert_allclose(truth.in_map[-1], case.start, atol=1e-9)
    assert truth.stamps_s[0] == 1.0
