"""Pure pursuit against geometry: circles, lines, and what the follower would command at each step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planning.pursuit import WAY_STEP_M, PursuitRule, Stretch, curvature_1pm, regulated_mps, spot_of, way_on

RULE = PursuitRule(0.6, 0.2, 0.9, 0.9, 0.15, 0.05, 0.005, 2.255, 0.3, 1.0, 0.5)
LENGTH_M = 2.0
MARKS = np.linspace(0.0, LENGTH_M, 201)
LINE = np.column_stack([MARKS, np.zeros((201, 2))])
WHOLE = Stretch(0, 200, 1)


def circle(radius_m, gear=1):
    """An arc of 2 m to the left, from the origin along x."""
    turn = gear * MARKS / radius_m
    return np.column_stack([radius_m * np.sin(turn), radius_m * (1.0 - np.cos(turn)), turn])


def test_the_car_is_found_between_the_poses_of_its_path():
    spot = spot_of(LINE, MARKS, WHOLE, 0.9, RULE, np.array([1.004, 0.1, 0.2]))
    np.testing.assert_allclose(spot[:3], [1.004, 0.1, 0.2], atol=1e-12)
    assert not spot.at_end


def test_it_is_never_found_behind_where_it_was_and_not_beyond_its_window():
    assert spot_of(LINE, MARKS, WHOLE, 1.2, RULE, np.array([1.0, 0.0, 0.0])).along_m == 1.2
    assert spot_of(LINE, MARKS, WHOLE, 0.2, RULE, np.array([1.9, 0.0, 0.0])).along_m <= 1.9
    doubled = np.vstack([LINE, LINE[::-1]])  # passes each place twice
    marks = np.concatenate([MARKS, MARKS + 2.01])
    assert spot_of(doubled, marks, Stretch(0, 401, 1), 0.5, RULE, np.array([0.6, 0.0, 0.0])).along_m < 1.0


@pytest.mark.parametrize(("x", "at_end"), [(1.99, False), (1.996, True), (2.3, True)])
def test_the_end_is_reached_a_little_before_it_and_beyond(x, at_end):
    assert spot_of(LINE, MARKS, WHOLE, 1.9, RULE, np.array([x, 0.02, 0.0])).at_end is at_end


@pytest.mark.parametrize("radius_m", [0.6, -0.6, 3.0])
@pytest.mark.parametrize("gear", [1, -1])
def test_on_a_circle_the_curvature_is_that_of_the_circle(radius_m, gear):
    path, n = circle(radius_m, gear), 60
    found = curvature_1pm(path, MARKS, Stretch(0, 200, gear), MARKS[n], 0.5, RULE, path[n])
    assert found == pytest.approx(1.0 / radius_m, rel=2e-3)


def test_beyond_the_end_it_steers_along_the_line_that_goes_on():
    found = curvature_1pm(LINE, MARKS, WHOLE, 1.95, 0.0, RULE, np.array([1.95, 0.02, 0.0]))
    assert found == pytest.approx(-2.0 * 0.02 / (0.2**2 + 0.02**2))
    far = curvature_1pm(LINE, MARKS, WHOLE, 1.95, 0.0, RULE, np.array([1.95, 0.1, 0.0]))
    assert far == -RULE.curvature_limit_1pm


def test_the_speed_is_the_paths_less_in_curves_and_near_things_and_never_none():
    speeds = np.linspace(0.1, 0.5, 201)
    for along_m in (0.0, 0.333, 1.0, 2.0):
        exact = float(np.interp(along_m, MARKS, speeds))
        assert regulated_mps(MARKS, speeds, along_m, 0.0, math.inf, RULE) == pytest.approx(exact)
    assert regulated_mps(MARKS, speeds, 1.0, 2.0, math.inf, RULE) == pytest.approx(0.3 / 1.8)
    assert regulated_mps(MARKS, speeds, 1.0, 0.0, 0.05, RULE) == pytest.approx(0.1)
    assert regulated_mps(MARKS, speeds, 1.0, 0.0, 0.0, RULE) == RULE.least_mps


@pytest.mark.parametrize("gear", [1, -1])
def test_the_way_on_from_a_path_is_the_path(gear):
    path = circle(0.8, gear)
    arguments = ((path, MARKS, np.full(201, 0.4)), Stretch(0, 200, gear), 0.5, RULE, path[50], (0.4, 1.0, math.inf))
    way = way_on(*arguments)
    assert len(way) == 51
    center = np.array([0.0, 0.8])
    np.testing.assert_allclose(np.hypot(*(way[:, :2] - center).T), 0.8, atol=2e-3)
    np.testing.assert_allclose(np.hypot(*np.diff(way[:, :2], axis=0).T), WAY_STEP_M, atol=1e-6)
    assert np.sign(way[10, 2] - way[0, 2]) == gear


def test_the_way_ends_with_the_path_and_where_that_is_lost():
    path = (LINE, MARKS, np.full(201, 0.4))
    way = way_on(path, WHOLE, 1.5, RULE, LINE[150], (0.4, 5.0, math.inf))
    assert way[-1, 0] == pytest.approx(LENGTH_M, abs=WAY_STEP_M)
    assert len(way_on(path, WHOLE, 1.5, RULE, np.array([1.5, 0.35, 0.0]), (0.4, 1.0, math.inf))) == 1
