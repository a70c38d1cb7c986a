"""What the checks before a search say, against a search of the whole map."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.costmap import Costmap, UnknownSpace, costmap
from planning.ends import Ends, GoalTolerance, PlanError, check_ends
from planning.vehicle import Vehicle

QCAR = Vehicle()
EXACT = GoalTolerance()
HOME = (1.0, 1.0, 0.0)


@pytest.fixture(scope="module")
def costs(rooms) -> Costmap:
    return costmap(rooms, QCAR, UnknownSpace.forbidden)


@pytest.fixture(scope="module")
def shut(rooms) -> Costmap:
    cells = rooms.log_odds.copy()
    cells[:, 80] = 5.0
    return costmap(OccupancyGrid(cells, rooms.resolution_m, rooms.origin), QCAR, UnknownSpace.forbidden)


def check(costs: Costmap, start: tuple[float, ...], goal: tuple[float, ...], tolerance: GoalTolerance = EXACT) -> Ends:
    """Check local poses."""
    return check_ends(costs, costs.world(np.array(start)), costs.world(np.array(goal)), tolerance)


def nearest_by_brute_force_m(costs: Costmap, wanted: np.ndarray, region: int) -> float:
    """Distance from a local place to the nearest of its lattice, of one cell, where the car fits in a region."""
    cell_m, (width_m, height_m) = costs.grid.resolution_m, costs.size_m
    anchor = np.clip(wanted[:2], 0.0, [width_m, height_m])
    steps = np.arange(-200, 201) * cell_m
    x, y = anchor[0] + steps, anchor[1] + steps
    places = np.array([[a, b] for a in x for b in y if 0 <= a < width_m and 0 <= b < height_m])
    away = np.hypot(*(places - wanted[:2]).T)
    for place, distance_m in sorted(zip(places.tolist(), away.tolist(), strict=True), key=lambda pair: pair[1]):
        row, col = int(place[1] / cell_m), int(place[0] / cell_m)
        if costs.region[row, col] == 0 or (region and costs.region[row, col] != region):
            continue
        if any(costs.fits(costs.world(np.array([*place, wanted[2] + turn]))) for turn in np.arange(16) * np.pi / 8):
            return distance_m
    return np.inf


def test_good_ends_are_left_as_they_are(costs):
    ends = check(costs, HOME, (6.5, 1.5, 1.0))
    assert ends.error is None
    assert ends.reason == ""
    np.testing.assert_allclose(costs.local(ends.goal), (6.5, 1.5, 1.0))


@pytest.mark.parametrize(
    ("end", "name", "words"),
    [
        ((-1.0, 1.0, 0.0), "outside_map", "outside the map"),
        ((1e300, 1e300, 0.0), "outside_map", "outside the map"),
        ((0.02, 1.0, 0.0), "occupied", "over the map's edge"),
        ((4.02, 1.0, 0.0), "occupied", "stands on an occupied cell"),
        ((3.8, 1.0, 0.0), "occupied", "occupied cell"),
        ((7.2, 5.2, 0.0), "in_unknown_space", "unknown space"),
    ],
)
@pytest.mark.parametrize("which", ["start", "goal"])
def test_an_end_that_cannot_be_is_named_with_the_nearest_pose_that_can(costs, end, name, words, which):
    ends = check(costs, end, HOME) if which == "start" else check(costs, HOME, end)
    assert ends.error is PlanError[f"{which}_{name}"]
    assert ends.reason.startswith(which)
    assert words in ends.reason
    assert ends.advice is not None
    assert costs.fits(ends.advice)
    if abs(end[0]) < 1e3:
        away_m = float(np.hypot(*(costs.local(ends.advice) - np.array(end))[:2]))
        assert away_m == pytest.approx(nearest_by_brute_force_m(costs, np.array(end), 0), abs=1e-6)


@pytest.mark.parametrize("goal", [(4.3, 2.0, 0.0), (6.5, 1.5, 1.0), (3.99, 3.0, 2.0)])
def test_a_room_without_a_door_has_no_way_in_and_the_advice_stays_outside(shut, goal):
    ends = check(shut, HOME, goal)
    assert ends.error is (PlanError.no_valid_path if shut.fits(shut.world(np.array(goal))) else PlanError.goal_occupied)
    assert ends.advice is not None
    region = int(shut.region[20, 20])
    assert shut.region[shut.cell(ends.advice)] == region
    away_m = float(np.hypot(*(shut.local(ends.advice) - np.array(goal))[:2]))
    # Far away the middles of cells are tried, where the other search steps by cells from the wanted place.
    assert away_m == pytest.approx(nearest_by_brute_force_m(shut, np.array(goal), region), abs=0.036)


@given(st.floats(0.05, 7.95), st.floats(0.05, 5.95), st.floats(-3.0, 3.0), st.floats(0.0, 0.4), st.floats(0.0, 0.6))
@settings(max_examples=60, deadline=None)
def test_a_goal_is_moved_only_if_it_must_and_never_beyond_its_tolerance(costs, x, y, yaw, distance_m, turn_rad):
    goal = np.array([x, y, yaw])
    ends = check(costs, HOME, (x, y, yaw), GoalTolerance(distance_m, turn_rad))
    moved = costs.local(ends.goal)
    away_m, turned_rad = float(np.hypot(*(moved - goal)[:2])), abs(float(se2.wrap_angle(moved[2] - yaw)))
    if ends.error is None:
        assert costs.fits(ends.goal)
        assert away_m <= distance_m + 1e-6
        assert turned_rad <= turn_rad + 1e-6
        assert costs.region[costs.cell(ends.goal)] == costs.region[20, 20]
        assert ("moved" in ends.reason) == (away_m > 1e-9 or turned_rad > 1e-9)
    else:
        np.testing.assert_allclose(moved, goal, atol=1e-9)
    if costs.fits(costs.world(goal)):
        assert ends.error is None
        np.testing.assert_allclose(moved, goal, atol=1e-9)


def test_a_goal_against_the_wall_is_moved_off_it_and_the_result_says_so(costs):
    goal = (3.7, 1.0, 0.0)  # 4 cm too far
    assert check(costs, HOME, goal, GoalTolerance(0.03)).error is PlanError.goal_occupied
    ends = check(costs, HOME, goal, GoalTolerance(0.08))
    assert ends.error is None
    assert "moved by 0.0" in ends.reason
    assert costs.local(ends.goal)[0] < 3.7
    turned = check(costs, HOME, (0.5, 0.18, 0.1), GoalTolerance(0.0, 0.3))
    assert turned.error is None
    np.testing.assert_allclose(costs.local(turned.goal)[:2], (0.5, 0.18))


def test_a_goal_in_another_room_within_the_tolerance_of_this_one_is_moved_here(shut):
    ends = check(shut, HOME, (4.3, 2.0, np.pi / 2), GoalTolerance(0.5))
    assert ends.error is None
    assert shut.local(ends.goal)[0] < 4.0


@pytest.mark.parametrize("value", [0.0, 5.0])
def test_a_map_without_free_space_has_no_advice(value):
    costs = costmap(OccupancyGrid(np.full((9, 7), value, np.float32), 0.05, np.zeros(3)), QCAR, UnknownSpace.forbidden)
    ends = check(costs, (0.2, 0.2, 0.0), (0.2, 0.2, 0.0))
    assert ends.error is not None
    assert ends.error.nav2_name == "START_OCCUPIED"
    assert ends.advice is None
