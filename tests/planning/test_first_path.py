"""First paths: along routes that can be followed, around places that cannot, and not beyond the deadline."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from planning.costmap import Costmap, UnknownSpace, costmap
from planning.first_path import Deadline, first_path, shortest_way
from planning.ompl_planners import Limits
from planning.vehicle import Vehicle

ENDS = np.array([[1.0, 1.0, 0.0], [6.5, 1.5, np.pi / 2]])


@pytest.fixture(scope="module")
def known(rooms) -> Costmap:
    return costmap(rooms, Vehicle(), UnknownSpace.forbidden)


def deadline(**given) -> Deadline:
    return Deadline(Limits(**{"clock": lambda: 0.0, "cancelled": lambda: False, **given}), 0.0)


def test_both_ways_are_free_from_end_to_end(known):
    for path in (
        first_path(known, ENDS, 0, deadline(), routes=4, bridges=2),
        shortest_way(known, ENDS, 0, deadline(), bridges=2),
    ):
        assert path is not None
        poses, _ = path.sampled(known.vehicle.turning_radius_m)
        np.testing.assert_allclose(poses[[0, -1]], ENDS, atol=1e-9)
        assert known.all_fit(known.world(poses))


def test_nothing_is_found_when_cancelled_or_too_late(known):
    assert first_path(known, ENDS, 0, deadline(cancelled=lambda: True), routes=4, bridges=2) is None
    assert first_path(known, ENDS, 0, deadline(time_limit_s=0.0), routes=4, bridges=2) is None


def test_a_deadline_counts_from_its_start():
    ticks = itertools.count(10.0)
    late = Deadline(Limits(clock=lambda: next(ticks), cancelled=lambda: False, time_limit_s=3.0), 10.0)
    assert [late.left_s, late.left_s] == [3.0, 2.0]
    assert late.rest().time_limit_s == 1.0
    assert late.is_over()
