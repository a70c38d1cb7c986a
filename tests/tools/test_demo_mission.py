from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from mapping import se2
from mapping.grid import GridBuilder, OccupancyGrid
from mapping.sensor_models import LidarModel
from mapping.trajectory import Trajectory
from tools import processes
from tools.demo_cars import CARS, CarFiles, DemoCar, drive_live, explore_live
from tools.demo_mission import exit_code_of, run_demo
from tools.demo_processes import run_command
from tools.demo_scores import MappedCar, score_common
from tools.emulation import Drive
from tools.errors import ToolError
from tools.wall_contact import Room
from tools.world import wings

CAR = DemoCar("A", "A2M8", "wings-west", 0.05)
DRIVEN = {
    "arrived": True, "exit_code": 0, "away_m": 0.02, "turned_deg": 1.0, "contacts": 0,
    "driven_m": 9.0, "driven_s": 30.0,
}  # fmt: skip
WHOLE = {
    "cars": [{"identical": True, "dropped_scans": 0}], "alignment": {"accepted": True}, "camera": {"accepted": True},
    "plan": {"solved": True, "error": None}, "drive": DRIVEN,
}  # fmt: skip


@pytest.mark.live
def test_demo_maps_fuses_and_plans(spawn, tmp_path):
    folder = tmp_path / "demo"
    demo = spawn("demo", "-o", folder)
    out, err = demo.process.communicate(timeout=600)
    assert demo.process.returncode == 0, err
    result = json.loads((folder / "demo.json").read_text())
    assert result["simulated"] is True
    for car in result["cars"]:
        assert car["identical"] is True
        assert car["decoded"] == pytest.approx(car["emitted"], rel=0.01)
        assert car["rms_m"] < 0.05
    first, second = result["cars"]
    assert first["resolution_m"] != second["resolution_m"]
    assert second["scans_hz"] > first["scans_hz"] + 1.0
    assert result["alignment"]["accepted"] is True
    assert result["alignment"]["rms_m"] < 0.15
    assert result["alignment"]["frames_apart_m"] > 5.0
    assert result["alignment"]["frames_apart_deg"] > 30.0
    assert result["common"]["overlap"] == pytest.approx(0.33, abs=0.03)
    assert result["common"]["wall_m"] > 10.0
    camera = result["camera"]
    assert camera["accepted"] is True
    assert camera["rms_between_maps_m"] < 0.1
    assert camera["rotation_deg"] < 2.0
    assert camera["trajectory_rms_m"] < 0.15
    assert camera["frames_apart_m"] > 5.0
    assert result["plan"]["solved"] is True
    drive = result["drive"]
    assert drive["arrived"] is True
    assert drive["contacts"] == 0
    assert drive["driven_m"] > 5.0
    assert cv2.imread(str(folder / "demo.png")).shape[0] > 500
    assert out.startswith("Simulated data")  # the result is on stdout, the progress is not
    assert "cm" in out
    assert "of the smaller map's free space" in out
    assert "1/7" in err


def mapped_without_error(car: DemoCar) -> MappedCar:
    """What a car would bring home if it knew where it is, from 5 scans of 400 beams a second."""
    truth, world, bearings = Drive.tour(car.drive).truth, wings(), np.linspace(-np.pi, np.pi, 400, endpoint=False)
    T_map_world = se2.inverse(truth.poses[0])
    trajectory = Trajectory(truth.stamps_ns, np.array([se2.compose(T_map_world, pose) for pose in truth.poses]))
    builder = GridBuilder(car.resolution_m, LidarModel())
    rays = np.column_stack([np.cos(bearings), np.sin(bearings)])
    for true, pose in zip(truth.poses[::4], trajectory.poses[::4], strict=True):
        ranges = world.ranges(np.tile(true, (len(bearings), 1)), bearings, 12.0)
        seen = ranges > 0.0
        builder.add_scan(pose[:2], se2.transform_points(pose, ranges[seen, np.newaxis] * rays[seen]))
    return MappedCar(car, builder.grid(), trajectory, truth)


def is_free(grid: OccupancyGrid, place: np.ndarray) -> bool:
    """Whether the map has free space at a place (2,) in its frame."""
    col, row = np.floor(grid.cell_coordinates(place[np.newaxis])[0]).astype(int)
    inside = 0 <= row < grid.log_odds.shape[0] and 0 <= col < grid.log_odds.shape[1]
    return bool(inside and grid.free[row, col])


def test_the_drives_share_a_third_and_the_goal_needs_both_maps():
    a, b = (mapped_without_error(car) for car in CARS)
    common = score_common(a, b)
    assert 0.30 <= common["overlap"] <= 0.36
    assert common["wall_m"] > 10.0
    for here, there in ((a, b), (b, a)):
        T_there_here = se2.between(there.T_world_map, here.T_world_map)
        assert is_free(here.grid, np.zeros(2))  # each car starts at the origin of its map
        assert not is_free(there.grid, T_there_here[:2])
    for car in (a, b):
        assert 35.0 < float(np.ptp(car.truth.stamps_ns)) * 1e-9 < 45.0


def test_demo_does_not_empty_a_folder_that_is_not_its_own(tmp_path):
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(ToolError, match="not empty"):
        run_demo(tmp_path, 0)
    assert (tmp_path / "thesis.txt").exists()
    with pytest.raises(ToolError, match="no folder"):
        run_demo(tmp_path / "thesis.txt" / "below", 0)


def children() -> set[int]:
    """The processes that this one started and that still run."""
    return children_of(os.getpid())


def children_of(process: int) -> set[int]:
    """The processes that a process started and that still run."""
    listed = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    return {int(number) for number in listed}


def test_a_run_that_dies_before_departure_ends_the_demo_with_its_name(tmp_path, monkeypatch):
    """A run that ends at once, as one does that is killed."""
    entry = processes.ENTRY
    monkeypatch.setattr(processes, "ENTRY", f"import sys\nif 'run' in sys.argv: sys.exit(9)\n{entry}")
    before = children()
    with pytest.raises(ToolError, match="car A: run ended with exit code 9 before 'departed'"):
        drive_live([(CAR, CarFiles(tmp_path))], 0, lambda: False, lambda _text: None)
    assert children() == before


# A program in place of this one: cars whose drives take no time, and runs that end on Ctrl-C.
STAND_IN = """
import json, signal, sys, time
signal.signal(signal.SIGINT, lambda *_: stop())
def stop():
    if "emulate" in sys.argv: say(event="stopped", samples_emitted=7)
    sys.exit(0)
def say(**event): print(json.dumps(event), flush=True)
if "emulate" in sys.argv:
    say(event="ready")
    say(event="departed", seconds=0.1)
    time.sleep(float(sys.argv[sys.argv.index("--drive") + 1]))
    say(event="arrived")
time.sleep(60)
"""


EXPLORER = """
import json, signal, sys, time
signal.signal(signal.SIGINT, lambda *_: stop())
def stop():
    say(event="stopped", samples_emitted=7)
    sys.exit(0)
def say(**event): print(json.dumps(event), flush=True)
if "run" in sys.argv:
    sys.exit(CODE if "--map" not in sys.argv and sys.argv.count("--goal") == 2 else 1)
say(event="ready", vehicle="udpout:127.0.0.1:9")
time.sleep(60)
"""


@pytest.mark.parametrize("code", [0, 3])
def test_cars_that_explore_end_by_themselves(code, tmp_path, monkeypatch):
    monkeypatch.setattr(processes, "ENTRY", EXPLORER.replace("CODE", str(code)))
    before, told = children(), list[str]()
    car = DemoCar(
        "A", "A2M8", "wings-west", 0.05, goals=((*Drive.tour("wings-west").truth.poses[0],), (2.2, 6.9, 1.57))
    )
    cars = [(car, CarFiles(tmp_path))]
    if code:
        with pytest.raises(ToolError, match="car A: run failed with exit code 3"):
            explore_live(cars, 0, lambda: False, told.append)
    else:
        assert explore_live(cars, 0, lambda: False, told.append) == [7]
        assert "--goal 0.0000 0.0000 0.0000" in told[0]  # the car's start, on its own map
    assert children() == before


def test_goals_of_the_cars_have_room():
    room = Room(wings())
    assert all(room(np.array(goal)) for car in CARS for goal in car.goals)


@pytest.mark.parametrize("drives_s", [("3.0", "5.0"), ("5.0", "3.0")])  # seconds: the stand-ins need some to start
def test_a_car_that_arrives_first_does_not_end_the_demo(drives_s, tmp_path, monkeypatch):
    monkeypatch.setattr(processes, "ENTRY", STAND_IN)
    before = children()
    cars = [
        (DemoCar(name, "A2M8", drive, 0.05), CarFiles(tmp_path)) for name, drive in zip("AB", drives_s, strict=True)
    ]
    assert drive_live(cars, 0, lambda: False, lambda _text: None) == [7, 7]
    assert children() == before


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({}, 0),
        ({"alignment": {"accepted": False}, "plan": {"solved": False, "error": "NOT_FUSED"}}, 3),
        ({"camera": {"accepted": False}}, 3),
        ({"cars": [{"identical": False, "dropped_scans": 2}]}, 0),  # a car that drives itself leaves out old scans
    ],
)
def test_the_exit_code_tells_whether_the_maps_were_fused(changed, expected):
    assert exit_code_of(WHOLE | changed) == expected


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"cars": [{"identical": False, "dropped_scans": 0}]}, "replay differs"),
        ({"plan": {"solved": False, "error": "TIMEOUT"}, "drive": None}, "TIMEOUT"),
        ({"drive": DRIVEN | {"arrived": False, "exit_code": 3}}, "did NOT arrive"),
        ({"drive": DRIVEN | {"contacts": 2}}, "2 CONTACTS"),
    ],
)
def test_a_demo_that_failed_says_why(changed, words):
    with pytest.raises(ToolError, match=words):
        exit_code_of(WHOLE | changed)


def test_stopping_ends_all_processes(tmp_path):
    before, asked = children(), time.monotonic() + 1.0
    with pytest.raises(KeyboardInterrupt):
        drive_live([(CAR, CarFiles(tmp_path))], 0, lambda: time.monotonic() > asked, lambda _text: None)
    assert children() == before


def test_sigterm_ends_the_demo_as_cut_off(spawn, tmp_path):
    demo = spawn("demo", "-o", tmp_path / "demo")
    while not (tmp_path / "demo/car_a/lidar").exists():
        assert demo.process.poll() is None
        time.sleep(0.05)
    started = children_of(demo.process.pid)
    assert started
    ended = demo.end(signal.SIGTERM)
    assert ended.code == 130
    assert not [number for number in started if Path(f"/proc/{number}").exists()]


def test_children_are_found_where_a_folder_called_tools_is_in_the_way(tmp_path, monkeypatch):
    (tmp_path / "tools").mkdir()
    (tmp_path / "tools/__init__.py").write_text("raise SystemExit(77)")
    monkeypatch.chdir(tmp_path)
    assert run_command(lambda: False, "config", "show") == 0
    with pytest.raises(ToolError, match="bag failed with exit code"):
        run_command(lambda: False, "bag", "info", "none.mcap")
    shadowed = [sys.executable, "-m", "tools.cli", "--version"]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    assert subprocess.run(shadowed, check=False, env=environment, capture_output=True).returncode == 77
