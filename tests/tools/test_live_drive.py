"""A car that drives itself in real time: `run` and an emulated car as processes, and a session in this one."""

from __future__ import annotations

import json
import signal
import sys
import time

import numpy as np
import pytest

from drivers.mavlink_address import parse_address
from drivers.mavlink_vehicle import open_mavlink
from drivers.recording_reader import open_recording
from mapping import se2
from mapping.grid import OccupancyGrid
from mapping.map_io import write_map
from mapping.trajectory import read_tum
from tools.autopilot import AutopilotSettings
from tools.bell import Bell
from tools.clock import RunClock
from tools.config import Config, parse
from tools.drive_log import Outcome
from tools.drive_thread import KEY
from tools.drive_warm_up import warm_up_drive
from tools.lidar_session import SensorPorts, run_session
from tools.live_drive import DriveWanted, LiveDrive, SavedMap, autopilot_settings
from tools.path_search import PathSearchBeside
from tools.signals import Stop
from tools.watched_car import WatchedCar
from tools.world import load_world

START = np.array([1.6, 3.6, 0.0])
GOALS = [(3.0, 3.6, 0.0), (2.4, 3.6, 0.0)]  # the second one backwards


@pytest.fixture(scope="module")
def office(tmp_path_factory):
    """The map of the built-in office as it is, in a file, and its grid."""
    world = load_world("office")
    cells = np.where(world.occupied, 5.0, -5.0).astype(np.float32)
    grid = OccupancyGrid(cells, world.resolution_m, world.origin)
    folder = tmp_path_factory.mktemp("office")
    write_map(folder / "office", grid)
    return folder / "office.yaml", grid


def test_the_defaults_drive_as_the_autopilot_does_by_itself():
    assert autopilot_settings(Config()) == AutopilotSettings()


def test_the_cap_holds_for_the_path_as_for_the_commands():
    settings = autopilot_settings(parse({"drive": {"speed_mps": 0.03}}, "test"))
    assert (settings.speed.top_mps, settings.speed.creep_mps, settings.safety.speed_mps) == (0.03, 0.03, 0.03)


def run_drives(spawn, tmp_path, goals, *more):
    """Have `run` drive an emulated car; return its exit code, its report, what it logged, and the end of the car."""
    lidar, truth, pose = tmp_path / "lidar", tmp_path / "truth.tum", [str(value) for value in START]
    car = spawn(
        *("emulate", "car", "--pose", *pose, "--rover", "udp:127.0.0.1:0", "--lidar-link", lidar),
        *("--truth", truth, "--json"),
    )
    vehicle = car.event("ready")["vehicle"]
    words = [word for goal in goals for word in ("--goal", *map(str, goal))]
    run = spawn("run", "--lidar", lidar, "--vehicle", vehicle, *words, *more, "-o", tmp_path / "run", "--json")
    out, err = run.process.communicate(timeout=240)
    ended = car.end()
    assert run.process.returncode == 0, err
    assert json.loads(ended.out.splitlines()[-1])["contacts"] == 0
    return json.loads(out), err, read_tum(truth)


@pytest.mark.live
@pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals")
def test_run_drives_on_the_map_that_it_is_making(spawn, tmp_path):
    goal = (1.2, 0.0, 0.0)  # in the frame of its own start
    report, _, truth = run_drives(spawn, tmp_path, [goal])
    assert (report["drive"]["outcome"], report["drive"]["arrived"]) == ("arrived", 1)
    assert "localisation" not in report
    off = se2.between(se2.compose(START, np.array(goal)), truth.poses[-1])
    assert np.hypot(off[0], off[1]) < 0.10
    assert abs(off[2]) < np.radians(15.0)


@pytest.mark.live
@pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals")
def test_run_drives_to_one_goal_after_the_other_and_ends_by_itself(spawn, cli, tmp_path, office):
    map_file, _ = office
    folder, pose = tmp_path / "run", [str(value) for value in START]
    report, err, truth = run_drives(spawn, tmp_path, GOALS, "--map", map_file, "--start", *pose)
    drive = report["drive"]
    assert (drive["outcome"], drive["arrived"], drive["setpoint_timeout_s"]) == ("arrived", 2, 3.0)
    assert [path["reason"] for path in drive["paths"]][:1] == ["set out"]
    assert "driving to goal 1 of 2" in err
    off = se2.between(np.array(GOALS[-1]), truth.poses[-1])
    assert np.hypot(off[0], off[1]) < 0.10
    assert abs(off[2]) < np.radians(15.0)
    with open_recording(folder / "recording.mcap") as recording:
        topics = {topic.name: topic.count for topic in recording.topics}
    assert topics["/plan"] == len(drive["paths"])
    assert min(topics["/cmd_vel"], topics["/odom"], topics["/imu"]) > 50
    again = json.loads(cli("replay", folder / "recording.mcap", "-o", tmp_path / "again", "--json").out)
    assert again["scans"]["wheel_guesses"] == 0, "the wheels are recorded and not mapped with, as in the run"


class Saboteur:
    """A part of the session that fails as mapping might, once the car drives."""

    tells = False
    hurries = False
    needs_map = False

    def __init__(self, when):
        self.when = when

    def begin(self, session):
        pass

    def note(self, message):
        pass

    def add(self, mapped):
        if self.when():
            raise ZeroDivisionError

    def end(self):
        pass

    def save(self, folder):
        return {}


@pytest.fixture
def car(tmp_path):
    car = WatchedCar("office", START, tmp_path / "lidar", 1)
    yield car
    car.close()


def driven(car, office, folder, stop, *more):
    """Drive the car in this process; return the report, and how the drive ended."""
    map_file, grid = office
    clock, config = RunClock(), Config()
    wanted = DriveWanted([np.array(goal) for goal in GOALS], SavedMap(map_file, grid), START)
    warm_up_drive()
    folder.mkdir()
    with (
        Bell() as bell,
        PathSearchBeside(time.monotonic) as search,
        open_mavlink(parse_address(car.address), clock) as vehicle,
    ):
        drive = LiveDrive(wanted, vehicle, config, search, bell)
        parts = [drive, *(part(bell) for part in more)]
        ports = SensorPorts(str(folder.parent / "lidar"))
        report, _ = run_session(ports, config, lambda: folder, stop, record=True, parts=parts, clock=clock)
    return report, drive.conclusion


def stands(car):
    end = time.monotonic() + 5.0
    while car.speed_mps > 0.0 and time.monotonic() < end:
        time.sleep(0.01)
    return car.speed_mps == 0.0 and not car.emulated.rover.autopilot.armed


@pytest.mark.live
@pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals")
def test_a_mapper_that_fails_leaves_a_car_that_stands_and_a_whole_recording(car, office, tmp_path):
    folder = tmp_path / "run"
    with pytest.raises(ZeroDivisionError):
        driven(car, office, folder, Stop(), lambda _: Saboteur(lambda: bool(car.setpoints) and car.is_driven))
    assert stands(car)
    with open_recording(folder / "recording.mcap") as recording:
        topics = {topic.name: topic.count for topic in recording.topics}
        assert (recording.truncated, recording.problems) == (False, [])
    assert topics["/cmd_vel"] > 20


@pytest.mark.live
@pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals")
def test_an_emergency_stop_holds_while_mapping_goes_on(car, office, tmp_path):
    stop = Stop()
    pressed: list[int] = []

    def key(bell):
        def press():
            if not pressed and car.setpoints and car.is_driven:
                bell.ring(KEY)
                pressed.append(car.now_ns())
            elif pressed and car.now_ns() - pressed[0] > 2_000_000_000:
                stop.set()
            return False

        return Saboteur(press)

    report, (outcome, reason) = driven(car, office, tmp_path / "run", stop, key)
    assert (outcome, reason) == (Outcome.emergency, "by a key")
    assert stands(car)
    assert car.stop_after(pressed[0]).stood_s < 0.6 + 0.1 + 0.5 / 1.5
    assert report["drive"]["outcome"] == "emergency stop"
    assert report["scans"]["mapped"] > 20
    assert {int(signal.SIGUSR1), KEY}.isdisjoint({int(signal.SIGINT), int(signal.SIGTERM)})
