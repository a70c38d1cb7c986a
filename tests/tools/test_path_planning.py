"""`plan` and `evaluate plans` on files."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import read_map, write_map
from planning.vehicle import Vehicle
from planning.worker import PlanningWorker
from tools.config import load
from tools.path_planning import plan_on_map
from tools.plan_checks import colliding_poses

ORIGIN = np.array([10.0, -3.0, -0.3])


@pytest.fixture
def room(tmp_path):
    """A room of 5 m x 4 m with a wall that leaves a gap."""
    cells = np.full((80, 100), -5.0, np.float32)
    cells[[0, -1], :] = cells[:, [0]] = cells[:, [-1]] = 5.0
    cells[:50, 50] = 5.0
    write_map(tmp_path / "room", OccupancyGrid(cells, 0.05, ORIGIN))
    return tmp_path / "room.yaml"


@pytest.fixture(scope="module")
def worker() -> Iterator[PlanningWorker]:
    with PlanningWorker(clock=time.monotonic) as worker:
        yield worker


@pytest.fixture
def planned(worker, room) -> Callable[..., dict[str, Any]]:
    """Plan in the room as the command does, with options of the section `planning`."""

    def run(start, goal, *, seed=1, output=None, file=room, **options):
        section = load(None).with_planning(options).planning
        return plan_on_map(
            worker, file, as_pose(in_map(*start)), as_pose(in_map(*goal)), section, seed=seed, output=output
        )

    return run


def as_pose(words: list[str]) -> tuple[float, float, float]:
    x, y, yaw = map(float, words)
    return x, y, yaw


def in_map(x: float, y: float, yaw: float) -> list[str]:
    return [str(value) for value in se2.compose(ORIGIN, np.array([x, y, yaw])).tolist()]


def test_plan_prints_the_promised_json_and_leaves_a_picture(cli, room, tmp_path):
    ends = ("--start", *in_map(1.0, 1.0, 0.0), "--goal", *in_map(4.0, 1.0, 0.0))
    outcome = cli("plan", room, *ends, "--json", "-o", tmp_path / "out")
    assert outcome.code == 0, outcome.err
    report = json.loads(outcome.out)
    assert set(report) == {
        "solved", "error", "reason", "length_m", "seconds", "first_path_s", "iterations", "ended_by", "min_clearance_m",
        "path", "direction", "speed_mps", "cusps", "advice",
    }  # fmt: skip
    assert (report["solved"], report["error"], report["advice"]) == (True, None, None)
    assert len(report["path"]) == len(report["direction"]) == len(report["speed_mps"])
    assert colliding_poses(read_map(room), read_map(room).occupied, np.array(report["path"]), Vehicle().body) == 0
    assert (tmp_path / "out/plan.png").stat().st_size > 0
    assert json.loads((tmp_path / "out/plan.json").read_text()) == report
    recorded = recorded_messages(tmp_path / "out/plan.mcap")
    assert set(recorded) == {"/map", "/plan"}
    assert (recorded["/map"].info.height, recorded["/map"].info.width) == (80, 100)
    assert recorded["/plan"].header.frame_id == recorded["/map"].header.frame_id == "map"
    positions = [[stamped.pose.position.x, stamped.pose.position.y] for stamped in recorded["/plan"].poses]
    assert positions == [pose[:2] for pose in report["path"]]


def recorded_messages(file) -> dict[str, Any]:
    """The last message of each topic, read by another program's library."""
    with AnyReader([file], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        return {
            connection.topic: reader.deserialize(data, connection.msgtype) for connection, _, data in reader.messages()
        }


def test_a_second_plan_replaces_the_first(planned, tmp_path):
    for goal in ((4.0, 1.0, 0.0), (2.5, 1.0, 0.0)):
        planned((1.0, 1.0, 0.0), goal, output=tmp_path / "out")
    assert json.loads((tmp_path / "out/plan.json").read_text())["error"] == "GOAL_OCCUPIED"
    assert set(recorded_messages(tmp_path / "out/plan.mcap")) == {"/map"}


def test_a_map_is_not_overwritten_by_the_picture_of_a_plan_on_it(cli, room, tmp_path):
    text = room.read_text().replace("room.pgm", "plan.png")
    (tmp_path / "plan.yaml").write_text(text)
    (tmp_path / "room.pgm").rename(tmp_path / "plan.png")
    ends = ("--start", *in_map(1.0, 1.0, 0.0), "--goal", *in_map(4.0, 1.0, 0.0))
    outcome = cli("plan", tmp_path / "plan.yaml", *ends, "-o", tmp_path)
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert "name another folder" in outcome.err


def test_a_seed_repeats_the_path(planned):
    paths = [planned((1.0, 1.0, 0.0), (4.0, 1.0, 0.0), seed=seed)["path"] for seed in (4, 5, 4)]
    assert paths[0] == paths[2]
    assert paths[0] != paths[1]


def test_the_car_and_its_speed_come_from_the_configuration(planned):
    ends = (1.0, 1.0, 0.0), (4.0, 1.0, 0.0)
    wide = ((-0.6, -0.6), (0.6, -0.6), (0.6, 0.6), (-0.6, 0.6))  # the gap is 1.45 m
    assert planned(*ends, footprint=wide, margin_m=0.2)["error"] == "NO_VALID_PATH"
    assert max(planned(*ends, speed={"top_mps": 0.2})["speed_mps"]) == 0.2


def test_an_option_comes_before_the_configuration(cli, worker, room, tmp_path):
    start, goal = in_map(1.0, 1.0, 0.0), in_map(4.0, 1.0, 0.0)
    ends = ("--start", *start, "--goal", *goal)
    (tmp_path / "wide.yaml").write_text("planning: {margin_m: 2}\n")
    assert cli("plan", room, *ends, "--config", tmp_path / "wide.yaml", "--margin", "0.01").code == 0
    refused = plan_on_map(worker, room, as_pose(start), as_pose(goal), load(tmp_path / "wide.yaml").planning)
    assert refused["error"] == "START_OCCUPIED"


def test_advice_is_told_as_the_option_to_give(cli, room, planned):
    refused = cli("plan", room, "--start", *in_map(1.0, 1.0, 0.0), "--goal", *in_map(2.5, 1.0, 0.0))
    told = refused.err.splitlines()[-1]
    assert "the nearest pose that would do: --goal " in told
    goal = np.array([float(value) for value in told.partition("--goal ")[2].split()])
    assert planned((1.0, 1.0, 0.0), tuple(se2.compose(se2.inverse(ORIGIN), goal)))["solved"]


@pytest.mark.parametrize(
    ("start", "goal", "error"),
    [
        ((2.5, 1.0, 0.0), (4.0, 1.0, 0.0), "START_OCCUPIED"),
        ((1.0, 1.0, 0.0), (40.0, 1.0, 0.0), "GOAL_OUTSIDE_MAP"),
    ],
)
def test_an_unsolved_plan_has_a_report_too(planned, start, goal, error):
    report = planned(start, goal)
    assert (report["solved"], report["error"], report["path"], report["length_m"]) == (False, error, [], None)
    assert len(report["advice"]) == 3


def test_an_unsolved_plan_prints_its_json_and_ends_with_1(cli, room):
    outcome = cli("plan", room, "--start", *in_map(2.5, 1, 0), "--goal", *in_map(4, 1, 0), "--json")
    assert (outcome.code, json.loads(outcome.out)["error"]) == (1, "START_OCCUPIED")


@pytest.mark.parametrize("pose", [("nan", "0", "0"), ("0", "inf", "0"), ("0", "0", "x")])
def test_a_pose_that_is_none_is_wrong_usage(cli, room, pose):
    assert cli("plan", room, "--start", *pose, "--goal", *in_map(1.0, 1.0, 0.0)).code == 2


@pytest.mark.parametrize("value", [0.0, 5.0])
@pytest.mark.parametrize("size", [1, 40])
def test_a_map_without_free_cells_has_no_plan_and_no_traceback(worker, tmp_path, value, size):
    write_map(tmp_path / "poor", OccupancyGrid(np.full((size, size), value, np.float32), 0.05, np.zeros(3)))
    ends = (0.02, 0.02, 0.0), (0.03, 0.02, 0.0)
    report = plan_on_map(worker, tmp_path / "poor.yaml", *ends, load(None).planning, output=tmp_path / "out")
    assert (report["error"], report["advice"]) == ("START_OCCUPIED", None)


def test_a_negated_map_is_planned_on_as_meant(planned, room, tmp_path):
    image = cv2.imread(str(tmp_path / "room.pgm"), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    cv2.imwrite(str(tmp_path / "negative.png"), 255 - image)
    text = room.read_text().replace("room.pgm", "negative.png").replace("negate: 0", "negate: 1")
    (tmp_path / "negative.yaml").write_text(text)
    paths = [planned((1, 1, 0), (4, 1, 0), file=each)["path"] for each in (room, tmp_path / "negative.yaml")]
    assert paths[0]
    assert paths[0] == paths[1]


def test_a_budget_is_a_time_or_with_a_seed_a_number_of_iterations(cli, room):
    ends = ("--start", *in_map(1, 1, 0), "--goal", *in_map(4, 1, 0))
    for options in (("--iterations", "10"), ("--seed", "1", "--budget", "1")):
        outcome = cli("plan", room, *ends, *options)
        assert (outcome.code, len(outcome.error_lines)) == (2, 1)
        assert "--seed" in outcome.err


def test_a_car_that_only_drives_forwards_changes_no_gear(planned):
    behind = (2.0, 3.2, 0.0), (1.0, 3.2, 0.0)
    assert -1 in planned(*behind, iterations=10)["direction"]
    assert set(planned(*behind, forward_only=True, iterations=10)["direction"]) == {1}


def test_a_goal_that_does_not_fit_may_be_moved_within_its_tolerance(planned):
    at_the_wall = (1.0, 1.0, 0.0), (4.0, 0.12, 0.0)
    assert planned(*at_the_wall)["error"] == "GOAL_OCCUPIED"
    report = planned(*at_the_wall, goal_tolerance_m=0.3, iterations=10)
    assert report["solved"]
    end, wanted = np.array(report["path"][-1]), np.array([float(value) for value in in_map(*at_the_wall[1])])
    assert 0.0 < np.hypot(*(end - wanted)[:2]) <= 0.3


@pytest.mark.parametrize("planner", ["car", "rrt", "rrt_connect", "rrt_star", "informed_rrt_star", "bit_star"])
def test_every_planner_on_offer_finds_its_way(planned, room, planner):
    report = planned((1.0, 1.0, 0.0), (4.0, 1.0, 0.0), planner=planner, iterations=10)
    assert report["solved"]
    assert colliding_poses(read_map(room), read_map(room).occupied, np.array(report["path"]), Vehicle().body) == 0


@pytest.mark.parametrize("option", [("--time-limit", "inf"), ("--time-limit", "nan"), ("--margin", "nan")])
def test_limits_that_are_none_are_wrong_usage(cli, room, option):
    assert cli("plan", room, "--start", *in_map(1, 1, 0), "--goal", *in_map(4, 1, 0), *option).code == 2


@pytest.mark.parametrize(
    "text",
    [
        "[1]",
        '{"room": [{"start": [1, 2], "goal": [1, 1, 0], "ref": 1}]}',
        '{"room": [{"start": [1, 2, NaN], "goal": [1, 1, 0], "ref": 1}]}',
        '{"room": [{"start": [1, 2, 0], "goal": [1, 1, 0]}]}',
        '{"a/b": [{"start": [1, 1, 0], "goal": [1, 2, 0], "ref": 1}]}',
        '{"room": []}',
        "{}",
    ],
)
def test_a_file_of_no_problems_fails_with_one_line(cli, tmp_path, text):
    (tmp_path / "problems.json").write_text(text)
    outcome = cli("evaluate", "plans", tmp_path / "problems.json")
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert "not a file of planning problems" in outcome.err


def test_bad_numbers_and_files_fail_with_one_line(cli, room, tmp_path):
    ends = ("--start", *in_map(1.0, 1.0, 0.0), "--goal", *in_map(4.0, 1.0, 0.0))
    outcome = cli("plan", tmp_path / "none.yaml", *ends)
    assert outcome.code == 1
    assert len(outcome.error_lines) == 1
    assert cli("plan", room, *ends, "--radius", "-1").code == 2


def test_evaluate_plans_scores_a_file_of_problems(cli, room, tmp_path):
    start, goal, wall = ([float(value) for value in in_map(*pose)] for pose in ((1, 1, 0), (4, 1, 0), (2.5, 1, 0)))
    problems = [{"start": start, "goal": goal, "ref": 5.0}, {"start": start, "goal": wall, "ref": 5.0}]
    (tmp_path / "problems.json").write_text(json.dumps({"room": problems}))
    outcome = cli("evaluate", "plans", tmp_path / "problems.json", "--json")
    assert outcome.code == 3
    for report in json.loads(outcome.out)["planners"]:
        assert (report["maps"]["room"]["solved"], report["maps"]["room"]["colliding_paths"]) == (1, 0)
        assert [row["error"] for row in report["rows"]] == [None, "GOAL_OCCUPIED"]
    assert cli("evaluate", "plans", room).code == 1


def test_the_second_opinion_sees_a_collision(room):
    straight = np.linspace([1.0, 1.0, 0.0], [4.0, 1.0, 0.0], 50)
    poses = np.array([[float(value) for value in in_map(*pose)] for pose in straight])
    assert colliding_poses(read_map(room), read_map(room).occupied, poses, Vehicle().body) > 0
    assert colliding_poses(read_map(room), read_map(room).occupied, poses[:10], Vehicle().body) == 0


@pytest.mark.real_data
def test_real_problems_are_solved_without_a_collision(cli, data_dir, tmp_path):
    folder = data_dir / "maps_planning"
    for file in folder.iterdir():
        (tmp_path / file.name).symlink_to(file)
    problems = json.loads((folder / "problems.json").read_text())
    (tmp_path / "some.json").write_text(json.dumps({name: listed[1::6] for name, listed in problems.items()}))
    outcome = cli("-q", "evaluate", "plans", tmp_path / "some.json", "--time-limit", "1", "--json")
    assert outcome.code == 3
    for report in json.loads(outcome.out)["planners"]:
        # One goal stands on unknown space. How many searches end in a second is a matter of the machine.
        errors = Counter(row["error"] for row in report["rows"])
        assert errors["GOAL_OCCUPIED"] == 1
        assert set(errors) <= {None, "GOAL_OCCUPIED", "TIMEOUT"}
        assert errors[None] >= 6
        assert sum(m["colliding_paths"] for m in report["maps"].values()) == 0
