"""What may be asked of a run together, and what is refused before a lidar turns."""

from __future__ import annotations

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
from tools.clock import RunClock
from tools.config import Config
from tools.errors import UsageError
from tools.live_journey import JourneyWanted, journey, without_wheels
from tools.localisation import FoundOnMap

GOAL = (1.0, 1.0, 0.0)


@pytest.fixture
def room(tmp_path):
    cells = np.full((80, 60), -5.0, np.float32)
    cells[[0, -1], :] = cells[:, [0, -1]] = cells[40:44, 20:40] = 5.0
    write_map(tmp_path / "room", OccupancyGrid(cells, 0.05, np.zeros(3)))
    return tmp_path / "room.yaml"


def test_without_goal_and_vehicle_the_car_is_at_most_looked_for(room):
    with journey(JourneyWanted(), Config(), RunClock()) as way:
        assert way.parts == ()
        assert way.conclude()
    with journey(JourneyWanted(room), Config(), RunClock()) as way:
        assert [type(part) for part in way.parts] == [FoundOnMap]


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        ({"goals": (GOAL,), "map_file": "m.yaml", "has_lidar": False}, "--goal: needs --lidar"),
        ({"start": GOAL, "map_file": "m.yaml"}, "--start: only with --goal"),
        ({"start": GOAL, "goals": (GOAL,)}, "--start: only with --map"),
        ({"goals": (GOAL,), "resumes": True}, "--goal: with --resume only with --map"),
    ],
)
def test_what_makes_no_sense_together_is_refused(wanted, words):
    with pytest.raises(UsageError, match=words):
        JourneyWanted(**wanted)


def test_goals_without_a_map_are_on_the_one_that_is_being_made(room):
    for map_file, is_made in ((None, True), (room, False)):
        with journey(JourneyWanted(map_file, (GOAL,), vehicle="none"), Config(), RunClock()) as way:
            (drive,) = way.parts
            assert drive.needs_map is is_made


def test_run_refuses_in_one_line_before_it_looks_for_a_lidar(cli, room, tmp_path):
    run = ("run", "--lidar", "/no/lidar", "-o", tmp_path / "out", "--map", room)
    for words, code, says in (
        (
            ("--goal", "1.5", "2.1", "0"),
            1,
            "--goal 1.5 2.1 0: stands on an occupied cell; the nearest pose that would do: --goal",
        ),
        (("--goal", "-5", "1", "0"), 1, "--goal -5 1 0: is outside the map; the nearest pose that would do: --goal"),
        (("--goal", "1", "1"), 2, "--goal 1 1: expected three numbers"),
        (("--goal", "1", "1", "north"), 2, "--goal 1 1 north: expected three numbers"),
        (("--goal", "1", "1", "0", "--vehicle", "car"), 2, "--vehicle: vehicle 'car': expected serial:PATH"),
        (("--start", "1", "1", "0"), 2, "--start: only with --goal"),
    ):
        ended = cli(*run, *words)
        assert ended.code == code, ended.err
        (line,) = ended.error_lines
        assert says in line
    assert not (tmp_path / "out").exists()


def test_a_run_with_a_vehicle_maps_without_its_wheels():
    assert Config().odometry.use_wheel_odometry
    assert not without_wheels(Config()).mapping_settings().use_wheel_odometry
