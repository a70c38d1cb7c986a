"""What happens between two paths, with searches that answer as the test wants them to."""

from __future__ import annotations

import numpy as np
import pytest

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.relocalisation import Located
from planning.ends import PlanError
from planning.path import path_along
from planning.plan import PlanResult
from planning.vehicle import Vehicle
from tools.drive_planning import DrivePlanning
from tools.drive_settings import AutopilotSettings
from tools.map_of_today import Place, near_costmap
from tools.path_search import PathAnswer, PathSearchHere, PathWanted

HERE, GOAL = np.array([2.0, 2.0, 0.0]), np.array([4.0, 2.0, 0.0])
RULE = AutopilotSettings(margins_m=(0.02,))
TICK_S = 0.1


def room(wall=None):
    """6 m x 4 m at 0.05 m, free but for some cells."""
    cells = np.full((80, 120), -5.0, np.float32)
    if wall is not None:
        cells[wall] = 5.0
    return OccupancyGrid(cells, 0.05, np.zeros(3))


def place_at(now_s, grid):
    located = Located(round(now_s * 1e9), HERE, se2.IDENTITY, np.eye(3) * 1e-4, 0.9, "")
    return Place(located, near_costmap(grid, HERE, Vehicle(margin_m=0.0), RULE), grid)


class Stage:
    """A standing car whose searches are answered by a function of (start, goal)."""

    def __init__(self, answer, late=0, grid=None):
        self.notes: list[tuple[float, str]] = []
        self.starts: list[np.ndarray] = []
        self.now_s = 0.0
        self.grid = room() if grid is None else grid

        def plan_path(_, start, goal):
            self.starts.append(start)
            return answer(start, goal)

        self.planning = DrivePlanning(PathSearchHere(plan_path, late), Vehicle(), RULE, self.notes)
        self.planning.begin(GOAL, "set out")

    def stand(self, seconds, pose=HERE, speed_mps=0.0):
        """Return the first path, and leave the time at which it came in now_s."""
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            found = self.planning.step(place_at(self.now_s, self.grid), pose, speed_mps, self.now_s)
            if found is not None:
                return found
        return None


def straight(start, goal):
    x = np.arange(start[0], goal[0], 0.01)
    return PlanResult(path_along(np.column_stack([x, np.full(len(x), start[1]), np.zeros(len(x))])), None, "")


def nothing(start, goal):
    return PlanResult(None, PlanError.no_valid_path, "walled in")


def test_it_plans_once_it_has_stood_for_a_while():
    stage = Stage(straight)
    assert stage.stand(1.0, speed_mps=0.3) is None
    assert stage.starts == []
    found = stage.stand(2.0)
    assert stage.now_s == pytest.approx(1.0 + RULE.pause_s, abs=2.1 * TICK_S)
    assert found.reason == "set out"
    assert not found.backs_off
    np.testing.assert_array_equal(stage.starts[0], HERE)


def test_without_a_new_scan_since_it_stands_it_does_not_plan():
    stage = Stage(straight)
    old = place_at(-1.0, stage.grid)
    assert all(stage.planning.step(old, HERE, 0.0, 0.1 * n) is None for n in range(30))
    assert stage.starts == []


def test_while_the_search_goes_on_it_stands_and_says_so():
    stage = Stage(straight, late=20)
    assert stage.stand(2.0) is None
    assert "looking for a path, for 1." in stage.planning.words
    assert stage.stand(2.0) is not None
    assert len(stage.starts) == 1


def test_a_plan_for_where_the_car_is_no_more_is_thrown_away():
    stage = Stage(straight, late=20)
    assert stage.stand(2.0) is None
    pushed = HERE + np.array([RULE.moved_m + 0.01, 0.0, 0.0])
    found = stage.stand(6.0, pose=pushed)
    assert "moved" in stage.notes[0][1]
    np.testing.assert_array_equal(found.path.poses[0], pushed)
    assert len(stage.starts) == 2


def test_a_goal_that_will_not_do_is_given_up_where_it_stands():
    stage = Stage(lambda *_: PlanResult(None, PlanError.goal_occupied, "the goal stands on an occupied cell"))
    assert stage.stand(10.0) is None
    assert len(stage.starts) == RULE.tries
    assert stage.planning.given_up == "the goal stands on an occupied cell"
    assert len(stage.notes) == RULE.tries


def test_it_backs_off_where_a_path_leads_on_from_there():
    def from_behind(start, goal):
        return straight(start, goal) if start[0] < HERE[0] - 0.3 else nothing(start, goal)

    stage = Stage(from_behind)
    found = stage.stand(10.0)
    assert found.backs_off
    assert (found.path.direction == -1).all()
    np.testing.assert_allclose(found.path.poses[-1], HERE - [RULE.back_m, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(stage.starts[-1], found.path.poses[-1])
    stage.planning.again("backed off")
    found = stage.stand(5.0, pose=found.path.poses[-1])
    assert not found.backs_off
    assert found.reason == "backed off"


def test_where_no_path_leads_on_from_there_either_it_stays():
    stage = Stage(nothing)
    assert stage.stand(10.0) is None
    assert len(stage.starts) == RULE.tries + 1
    assert "walled in; nor is there one from 0.5 m back" in stage.planning.given_up


def test_without_room_behind_it_stays():
    stage = Stage(nothing, grid=room(np.s_[:, 37]))  # its near side at x = 1.9 m, the car's tail at 1.9155 m
    assert stage.stand(10.0) is None
    assert "no room to back off" in stage.planning.given_up


def test_it_does_not_back_off_for_ever():
    def from_behind(start, goal):
        return straight(start, goal) if len(stage.starts) % (RULE.tries + 1) == 0 else nothing(start, goal)

    stage = Stage(from_behind)
    for n in range(RULE.back_offs):
        assert stage.stand(10.0, pose=HERE + np.array([0.1 * n, 0.0, 0.0])).backs_off
        stage.planning.again("backed off")
    assert stage.stand(10.0, pose=HERE + np.array([0.5, 0.0, 0.0])) is None
    assert f"backed off {RULE.back_offs} times" in stage.planning.given_up
    stage.planning.begin(GOAL, "another goal")
    assert stage.planning.given_up == ""


def test_what_is_found_here_again_and_again_but_cannot_be_followed_counts_as_nothing():
    stage = Stage(straight)
    for _ in range(RULE.tries):
        found = stage.stand(10.0)
        assert not found.backs_off
        stage.planning.again("contact in 0.04 m")
    found = stage.stand(10.0)
    assert found.backs_off
    assert "cannot be followed: contact in 0.04 m" in found.reason


class Rooms:
    """A search that finds a path with more room where it begins farther back."""

    def __init__(self, margin_back_m):
        self.margin_back_m = margin_back_m
        self.asked: list[PathWanted] = []

    def ask(self, wanted):
        self.asked.append(wanted)

    def answer(self):
        start, goal = self.asked[-1].start, self.asked[-1].goal
        margin_m = 0.0 if start[0] > HERE[0] - 0.3 else self.margin_back_m
        return PathAnswer(straight(start, goal), margin_m)

    def close(self):
        pass


def beside_a_box(margin_back_m, wall):
    stage = Stage(straight, grid=room(wall))
    stage.planning = DrivePlanning(Rooms(margin_back_m), Vehicle(), RULE, stage.notes)
    stage.planning.begin(GOAL, "set out")
    return stage.stand(5.0)


NEXT_TO_IT = np.s_[35:45, 47:50]  # its near side at x = 2.35 m, the car's nose at 2.3405 m


def test_from_too_near_it_backs_off_if_a_path_from_there_has_more_room():
    assert beside_a_box(RULE.margins_m[0], NEXT_TO_IT).backs_off
    assert not beside_a_box(0.0, NEXT_TO_IT).backs_off
    assert not beside_a_box(RULE.margins_m[0], None).backs_off  # in the open it is the way that is narrow
