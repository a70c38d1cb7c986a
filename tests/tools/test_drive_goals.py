from __future__ import annotations

import math

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from tools.config import Config, parse
from tools.drive_goals import check_goals
from tools.errors import ToolError, UsageError


@pytest.fixture(scope="module")
def grid():
    """Two rooms of 3 m x 4 m at 0.05 m, with no way between them, at (10, 20)."""
    cells = np.full((80, 120), -5.0, np.float32)
    cells[[0, -1], :] = 5.0
    cells[:, [0, 59, -1]] = 5.0
    return OccupancyGrid(cells, 0.05, np.array([10.0, 20.0, 0.0]))


def test_goals_in_one_room_are_fine_with_and_without_a_start(grid):
    goals = [(11.0, 21.0, 0.0), (11.5, 22.5, 1.0)]
    check_goals(grid, Config(), goals, None)
    check_goals(grid, Config(), goals, (10.6, 21.0, 0.1))


def test_a_start_that_is_only_about_right_may_touch_a_wall(grid):
    check_goals(grid, Config(), [(11.0, 21.0, 0.0)], (10.04, 21.0, 0.0))


def advice_of(error):
    words = str(error).split("--goal ")[-1].split()
    return tuple(float(word) for word in words)


@pytest.mark.parametrize(
    ("goal", "words"),
    [((12.97, 22.0, 0.0), "on an occupied cell"), ((5.0, 22.0, 0.0), "is outside the map")],
)
def test_a_goal_in_a_wall_or_outside_is_refused_in_a_line_with_a_pose_that_would_do(grid, goal, words):
    with pytest.raises(ToolError, match=words) as caught:
        check_goals(grid, Config(), [goal], None)
    assert "\n" not in str(caught.value)
    check_goals(grid, Config(), [advice_of(caught.value)], None)


def test_the_other_room_is_no_goal_after_one_in_this_room(grid):
    with pytest.raises(ToolError, match="--goal 15 22 0: no way from goal 1") as caught:
        check_goals(grid, Config(), [(11.0, 21.0, 0.0), (15.0, 22.0, 0.0)], None)
    assert advice_of(caught.value)[0] < 13.0
    with pytest.raises(ToolError, match="--goal 15 22 0: no way from start"):
        check_goals(grid, Config(), [(15.0, 22.0, 0.0)], (11.0, 21.0, 0.0))


def test_a_start_outside_the_map_and_what_is_no_number_are_refused(grid):
    with pytest.raises(ToolError, match="--start 0 0 0: is outside the map"):
        check_goals(grid, Config(), [(11.0, 21.0, 0.0)], (0.0, 0.0, 0.0))
    with pytest.raises(UsageError, match="--goal 11 nan 0: expected finite"):
        check_goals(grid, Config(), [(11.0, math.nan, 0.0)], None)


def test_plans_tighter_than_the_steering_are_refused(grid):
    config = parse({"planning": {"turning_radius_m": 0.4}}, "test")
    with pytest.raises(UsageError, match=r"turning_radius_m 0.4: the car turns on 0.443 m"):
        check_goals(grid, config, [(11.0, 21.0, 0.0)], None)
