"""`plan` and `evaluate plans` on files."""

from __future__ import annotations

import json
from collections import Counter

import cv2
import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from mapping.map_io import read_map, write_map
from planning.vehicle import Vehicle
from tools.plan_problems import colliding_poses


@pytest.fixture
def room(tmp_path):
    """A room of 5 m x 4 m with a wall that leaves a gap."""
    cells = np.full((80, 100), -5.0, np.float32)
    cells[[0, -1], :] = cells[:, [0]] = cells[:, [-1]] = 5.0
    cells[:50, 50] = 5.0
    write_map(tmp_path / "room", OccupancyGrid(cells, 0.05, np.array([10.0, -3.0, -0.3])))
    return tmp_path / "room.yaml"


def in_map(x: float, y: float, yaw: float) -> list[str]:
    cos, sin = np.cos(-0.3), np.sin(-0.3)
    return [str(10.0 + cos * x - sin * y), str(-3.0 + sin * x + cos * y), str(yaw - 0.3)]


def test_plan_prints_the_promised_json_and_leaves_a_picture(cli, room, tmp_path):
    ends = ("--start", *in_map(1.0, 1.0, 0.0), "--goal", *in_map(4.0, 1.0, 0.0))
    outcome = cli("plan", room, *ends, "--json", "-o", tmp_path / "out")
    assert outcome.code == 0, outcome.err
    report = json.loads(outcome.out)
    assert set(report) == {
        "solved", "error", "reason", "length_m", "seconds", "min_clearance_m",
        "path", "direction", "speed_mps", "advice",
    }  # fmt: skip
    assert (report["solved"], report["error"], report["advice"]) == (True, None, None)
    assert len(report["path"]) == len(report["direction"]) == len(report["speed_mps"])
    assert colliding_poses(read_map(room), np.array(report["path"]), Vehicle()) == 0
    assert (tmp_path / "out/plan.png").stat().st_size > 0
    assert json.loads((tmp_path / "out/plan.json").read_text()) == report


@pytest.mark.parametrize(
    ("start", "goal", "error"),
    [
        ((2.5, 1.0, 0.0), (4.0, 1.0, 0.0), "START_OCCUPIED"),
        ((1.0, 1.0, 0.0), (40.0, 1.0, 0.0), "GOAL_OUTSIDE_MAP"),
    ],
)
def test_an_unsolved_plan_still_prints_its_json(cli, room, start, goal, error):
    outcome = cli("plan", room, "--start", *in_map(*start), "--goal", *in_map(*goal), "--json")
    report = json.loads(outcome.out)
    assert outcome.code == 1
    assert (report["solved"], report["error"], report["path"], report["length_m"]) == (False, error, [], None)
    assert len(report["advice"]) == 3
    told = cli("plan", room, "--start", *in_map(*start), "--goal", *in_map(*goal))
    assert told.err.startswith(f"{error}: ")


@pytest.mark.parametrize("pose", [("nan", "0", "0"), ("0", "inf", "0"), ("0", "0", "x")])
def test_a_pose_that_is_none_is_wrong_usage(cli, room, pose):
    assert cli("plan", room, "--start", *pose, "--goal", *in_map(1.0, 1.0, 0.0)).code == 2


@pytest.mark.parametrize("value", [0.0, 5.0])
@pytest.mark.parametrize("size", [1, 40])
def test_a_map_without_free_cells_has_no_plan_and_no_traceback(cli, tmp_path, value, size):
    write_map(tmp_path / "poor", OccupancyGrid(np.full((size, size), value, np.float32), 0.05, np.zeros(3)))
    ends = ("--start", "0.02", "0.02", "0", "--goal", "0.03", "0.02", "0")
    outcome = cli("plan", tmp_path / "poor.yaml", *ends, "--json")
    assert outcome.code == 1
    assert (json.loads(outcome.out)["error"], json.loads(outcome.out)["advice"]) == ("START_OCCUPIED", None)


def test_a_negated_map_is_planned_on_as_meant(cli, room, tmp_path):
    image = cv2.imread(str(tmp_path / "room.pgm"), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    cv2.imwrite(str(tmp_path / "negative.png"), 255 - image)
    text = room.read_text().replace("room.pgm", "negative.png").replace("negate: 0", "negate: 1")
    (tmp_path / "negative.yaml").write_text(text)
    ends = ("--start", *in_map(1.0, 1.0, 0.0), "--goal", *in_map(4.0, 1.0, 0.0))
    paths = [json.loads(cli("plan", each, *ends, "--json").out)["path"] for each in (room, tmp_path / "negative.yaml")]
    assert paths[0]
    assert paths[0] == paths[1]


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
    assert colliding_poses(read_map(room), poses, Vehicle()) > 0
    assert colliding_poses(read_map(room), poses[:10], Vehicle()) == 0


@pytest.mark.real_data
def test_real_problems_are_solved_without_a_collision(cli, data_dir, tmp_path):
    folder = data_dir / "maps_planning"
    for file in folder.iterdir():
        (tmp_path / file.name).symlink_to(file)
    problems = json.loads((folder / "problems.json").read_text())
    (tmp_path / "some.json").write_text(json.dumps({name: listed[1::3] for name, listed in problems.items()}))
    outcome = cli("-q", "evaluate", "plans", tmp_path / "some.json", "--time-limit", "1", "--json")
    assert outcome.code == 3
    for report in json.loads(outcome.out)["planners"]:
        # One goal stands on unknown space. How many searches end in a second is a matter of the machine.
        errors = Counter(row["error"] for row in report["rows"])
        assert errors["GOAL_OCCUPIED"] == 1
        assert set(errors) <= {None, "GOAL_OCCUPIED", "TIMEOUT"}
        assert errors[None] >= 12
        assert sum(m["colliding_paths"] for m in report["maps"].values()) == 0
