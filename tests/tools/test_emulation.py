"""`emulate lidar` and what it refuses."""

from __future__ import annotations

import json
import threading
import time

import pytest

from drivers.errors import DeviceLostError
from drivers.rplidar import open_rplidar
from drivers.rplidar_models import A2M8
from tools.emulated_camera import EmulatedCar
from tools.emulation import Drive, EmulatedSensor, car_writer, read_faults, serve_lidar, simulated_lidar, with_firmware


@pytest.mark.parametrize("pose", [("nan", "0", "0"), ("0", "inf", "0"), ("0", "0", "-inf")])
def test_a_pose_that_is_none_is_wrong_usage(pose, cli):
    outcome = cli("emulate", "lidar", "--pose", *pose)
    assert (outcome.code, len(outcome.error_lines)) == (2, 1)
    assert "--pose" in outcome.error_lines[0]


def test_a_truth_that_could_not_be_written_is_refused_before_the_drive(cli, tmp_path):
    outcome = cli("emulate", "lidar", "--truth", tmp_path / "none/truth.tum")
    assert (outcome.code, len(outcome.error_lines)) == (1, 1)
    assert outcome.out == ""


@pytest.mark.parametrize(
    "options",
    [
        ("--model", "A1"),
        ("--world", "map.yaml"),
        ("--world", "office", "--drive", "wings-west"),
        ("--pose", "0", "0", "0", "--trajectory", "x"),
        ("--fault", "melt"),
        ("--faults", "no-such-file"),
        ("--firmware", "1"),
        ("--firmware", "1.300"),
        ("--wiring", "loose"),
    ],
)
def test_options_that_do_not_fit_are_wrong_usage(options, cli):
    assert cli("emulate", "lidar", *options).code == 2


def test_the_car_is_shared_with_its_camera(tmp_path):
    file, drive = tmp_path / "car.json", Drive.standing((1.0, 2.0, 0.5))
    share = car_writer(file, "office", drive)
    share(None)
    assert EmulatedCar.read(file).start_ns is None
    share(5)
    car = EmulatedCar.read(file)
    assert (car.world, car.start_ns, car.drive.poses.tolist()) == ("office", 5, [[1.0, 2.0, 0.5]])
    car_writer(None, "office", drive)(5)


def test_faults_come_from_the_file_and_from_the_options(tmp_path):
    file = tmp_path / "faults.txt"
    file.write_text("flip=0.1  # a poor cable\n")
    script = read_faults(["unplug@1+1"], file, 7)
    assert [fault.kind.value for fault in script.faults] == ["flip", "unplug"]
    assert script.seed == 7


def test_older_firmware_has_fewer_modes():
    assert [mode.name for mode in with_firmware(A2M8, "1.20").modes] == ["Standard", "Express"]
    assert with_firmware(A2M8, None) is A2M8


@pytest.mark.live(cores=1)
def test_a_sensor_is_unplugged_and_plugged_in_by_script(tmp_path, capsys):
    link, stop, drive = tmp_path / "lidar", threading.Event(), Drive.standing((1.6, 3.6, 0.0))
    ranger = simulated_lidar("office", drive, noise=False, seed=0)
    sensor = EmulatedSensor(A2M8, ranger, script=read_faults(["unplug@0.5+0.5"], None, 0), link=link)
    serving = threading.Thread(
        target=serve_lidar, args=(sensor, ranger, drive, stop), kwargs={"truth": None, "as_json": True}
    )
    serving.start()
    with open_rplidar(str(link)) as lidar, pytest.raises(DeviceLostError):
        list(lidar)
    deadline = time.monotonic() + 5.0
    while not link.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    with open_rplidar(str(link)) as lidar:
        assert lidar.info().model == "A2M8"
    stop.set()
    serving.join()
    events = [json.loads(line)["event"] for line in capsys.readouterr().out.splitlines()]
    assert [event for event in events if event in ("ready", "unplugged", "plugged", "stopped")] == [
        *("ready", "unplugged", "plugged", "stopped")
    ]
