"""The search of last resort: a way, a proof that there is none, or neither in time."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from planning.both_ends import Unreachable, search_from_both_ends
from planning.costmap import Costmap, UnknownSpace, costmap
from planning.first_path import Deadline
from planning.ompl_planners import Limits
from planning.pieces import Pieces
from planning.vehicle import Vehicle

ENDS = np.array([[1.0, 1.0, 0.0], [6.5, 1.5, np.pi / 2]])
APART = np.array([[0.8, 0.4, 0.0], [2.2, 0.5, 0.0]])  # on both sides of the walls


@pytest.fixture(scope="module")
def known(rooms) -> Costmap:
    return costmap(rooms, Vehicle(), UnknownSpace.forbidden)


@pytest.fixture(scope="module")
def split(passage) -> Costmap:
    return costmap(passage, Vehicle(), UnknownSpace.forbidden)


def deadline(**given) -> Deadline:
    return Deadline(Limits(**{"clock": lambda: 0.0, "cancelled": lambda: False, **given}), 0.0)


def test_a_way_is_found_and_the_same_each_time(known):
    one, other = (search_from_both_ends(known, ENDS, deadline()) for _ in "ab")
    assert isinstance(one, Pieces)
    assert isinstance(other, Pieces)
    np.testing.assert_array_equal(one.starts, other.starts)
    poses, _ = one.sampled(known.vehicle.turning_radius_m)
    assert known.all_fit(known.world(poses))


def test_no_way_is_told_with_the_nearest_pose_that_can_be_reached(split):
    region = [split.region[split.cell(end)] for end in APART]
    assert region[0] == region[1], "for the rear axle alone there is a way"
    found = search_from_both_ends(split, APART, deadline())
    assert isinstance(found, Unreachable)
    assert split.fits(found.nearest)
    assert found.nearest[0] > APART[0, 0] + 0.05, "as far as the wall the car does get"


def test_nothing_is_said_when_cancelled_or_too_late(split):
    ticks = itertools.count()
    assert search_from_both_ends(split, APART, deadline(cancelled=lambda: True)) is None
    assert search_from_both_ends(split, APART, deadline(clock=lambda: next(ticks) * 0.1, time_limit_s=1.0)) is None
