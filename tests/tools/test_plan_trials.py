"""Random problems, problems without a solution, and the bench of plans, on a small hall."""

from __future__ import annotations

import json
import time

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from mapping.map_io import read_map, write_map
from planning.costmap import UnknownSpace, costmap
from planning.vehicle import Vehicle
from tools.errors import ToolError
from tools.maps_at_hand import map_files, read_any_map
from tools.plan_peer import plan_by_peer
from tools.plan_trials import LEAST_M, draw_problems

START, GOAL = np.array([1.0, 1.5, 0.0]), np.array([8.5, 1.5, 0.0])


@pytest.fixture
def hall(tmp_path):
    """A hall of 10 m x 5 m with a wall that leaves a door of 1 m; a map beside whose image is missing, and a text."""
    cells = np.full((100, 200), -5.0, np.float32)
    cells[[0, -1], :] = cells[:, [0]] = cells[:, [-1]] = 5.0
    cells[:80, 100] = 5.0
    folder = tmp_path / "maps"
    folder.mkdir()
    write_map(folder / "hall", OccupancyGrid(cells, 0.05, np.zeros(3)))
    (folder / "lost.yaml").write_text((folder / "hall.yaml").read_text().replace("hall.pgm", "lost.pgm"))
    (folder / "notes.yaml").write_text("a: 1\n")
    problems = {"hall": [{"start": START.tolist(), "goal": GOAL.tolist(), "ref": 9.0}]}
    (folder / "problems.json").write_text(json.dumps(problems))
    return folder / "hall.yaml"


def test_folders_and_lists_of_problems_name_their_maps_once(hall, tmp_path, caplog):
    assert map_files([hall.parent, hall, hall.parent / "problems.json"]) == [hall]
    assert "lost.pgm is not there" in caplog.text
    assert read_any_map(hall).log_odds.shape == (100, 200)
    (tmp_path / "empty").mkdir()
    with pytest.raises(ToolError, match="no map in it"):
        map_files([tmp_path / "empty"])


def test_random_problems_fit_and_lie_apart_and_a_closed_door_leaves_none_through_it(hall):
    known = read_map(hall)
    on = costmap(known, Vehicle(), UnknownSpace.forbidden)
    drawn = draw_problems(on, 30, np.random.default_rng(1))
    assert len(drawn) == 30
    assert all(on.fits(each.start) and on.fits(each.goal) for each in drawn)
    assert min(np.hypot(*(each.goal - each.start)[:2]) for each in drawn) >= LEAST_M
    cells = known.log_odds.copy()
    cells[:, 100] = 5.0
    shut = costmap(OccupancyGrid(cells, 0.05, known.origin), Vehicle(), UnknownSpace.forbidden)
    beside = draw_problems(shut, 5, np.random.default_rng(1))
    assert beside
    assert all((each.start[0] < 5.0) == (each.goal[0] < 5.0) for each in beside)


def test_random_plans_are_solved_and_checked(cli, hall):
    outcome = cli("evaluate", "plans", hall, "--random", "8", "--seed", "2", "--budget", "0.02", "--json")
    assert outcome.code == 0
    report = json.loads(outcome.out)["all"]
    assert (report["problems"], report["solved"]) == (8, 8)
    assert [report[kind] for kind in ("colliding", "too_curved", "wrong_gears", "gaps", "ends_off")] == [0] * 5


def test_problems_without_a_solution_get_the_right_error(cli, hall):
    outcome = cli("evaluate", "plans", hall, "--blocked", "--json")
    report = json.loads(outcome.out)
    assert outcome.code == 0
    assert report["problems"] == report["right"] == 30
    assert {"START_OUTSIDE_MAP", "GOAL_OCCUPIED", "NO_VALID_PATH"} <= {row["error"] for row in report["rows"]}


def test_a_peer_finds_a_way_that_is_no_shorter_than_the_way_through_the_door(hall):
    on = costmap(read_map(hall), Vehicle(margin_m=0.0), UnknownSpace.free)
    found = plan_by_peer(on, START, GOAL, limit_s=20.0, seed=1, clock=time.process_time)
    assert found is not None
    door = np.array([5.0, 4.0])
    assert found.length_m > np.hypot(*(door - START[:2])) + np.hypot(*(door - GOAL[:2])) - 0.2
    assert found.first_s <= found.seconds
    assert plan_by_peer(on, START, GOAL, limit_s=0.0, seed=1, clock=time.process_time) is None


def test_the_bench_solves_its_problems_without_faults(cli, hall):
    options = ("--no-start", "--leaks", "0", "--cancels", "1", "--json")
    outcome = cli("bench", "plan", *options, hall.parent / "problems.json")
    assert outcome.code == 0
    report = json.loads(outcome.out)
    assert {row["solved"] for row in report["plans"]} == {1}
    assert not any(row["faults"] for row in report["plans"])
    assert all(report["cancel"][kind]["max"] < 30_000.0 for kind in ("cancel", "ctrl_c"))
