"""The shortest words forwards against OMPL's distance, and against words that were driven."""

from __future__ import annotations

import numpy as np
import ompl.base as ob
import pytest

from mapping import se2
from planning import dubins, reeds_shepp

Pose = tuple[float, float, float]
Pair = tuple[float, float, float, float, float, float]
RADIUS_M = 0.576
KINDS = [(1, 0, 1), (-1, 0, -1), (1, 0, -1), (-1, 0, 1), (1, -1, 1), (-1, 1, -1)]


def random_pairs(scale_m: float, count: int) -> list[Pair]:
    pairs = np.random.default_rng(7).uniform(-1.0, 1.0, (count, 6)) * np.array([scale_m, scale_m, np.pi] * 2)
    pairs[::10, 5] = pairs[::10, 2]
    pairs[1::10, 5] = se2.wrap_angle(pairs[1::10, 2] + np.pi)
    return [(a, b, c, d, e, f) for a, b, c, d, e, f in pairs.tolist()]


def driven(start: Pose, lengths: np.ndarray, turns: np.ndarray) -> Pose:
    pose = start
    for length_m, turn in zip(lengths.tolist(), turns.tolist(), strict=True):
        pose = reeds_shepp.drive(*pose, length_m, turn, RADIUS_M)
    return pose


@pytest.mark.parametrize("scale_m", [0.2, 1.0, 4.0, 40.0])
def test_it_is_the_distance_of_ompl_and_ends_at_the_goal(scale_m):
    space = ob.DubinsStateSpace(RADIUS_M)
    bounds = ob.RealVectorBounds(2)
    bounds.setLow(-100.0)
    bounds.setHigh(100.0)
    space.setBounds(bounds)
    information = ob.SpaceInformation(space)
    first, second = information.allocState(), information.allocState()
    for pair in random_pairs(scale_m, 1000):
        for state, (x, y, yaw) in ((first, pair[:3]), (second, pair[3:])):
            state.setX(x)
            state.setY(y)
            state.setYaw(yaw)
        lengths, turns, cost = dubins.shortest(*pair, RADIUS_M, 1.5, 0.3)
        assert cost == pytest.approx(space.distance(first, second), abs=1e-6)  # OMPL rounds angles to 1e-6
        assert cost == dubins.shortest(*pair, RADIUS_M, 1.0, 0.0)[2]
        assert lengths.min() >= 0.0
        assert lengths.sum() == pytest.approx(cost, abs=1e-9)
        error = np.subtract(driven(pair[:3], lengths, turns), pair[3:])
        error[2] = se2.wrap_angle(error[2])
        assert np.abs(error).max() < 1e-8


def test_nothing_that_can_be_driven_forwards_is_shorter():
    random, start = np.random.default_rng(5), (0.3, -0.2, 1.1)
    for turns in KINDS * 200:
        lengths = random.uniform(0.0, 2.0 * np.pi, 3) * RADIUS_M
        goal = driven(start, lengths, np.array(turns))
        assert dubins.shortest(*start, *goal, RADIUS_M, 1.0, 0.0)[2] <= lengths.sum() + 1e-8


@pytest.mark.parametrize("yaw", [0.0, 0.7, -3.0])
def test_straight_ahead_is_straight_however_it_rounds(yaw):
    goal = (1.0 + 5.0 * np.cos(yaw), 2.0 + 5.0 * np.sin(yaw), yaw)
    assert dubins.shortest(1.0, 2.0, yaw, *goal, RADIUS_M, 1.0, 0.0)[2] == pytest.approx(5.0, abs=1e-9)
