"""`emulate lidar` and what it refuses."""

from __future__ import annotations

import pytest

from tools.emulated_camera import EmulatedCar
from tools.emulation import Drive, car_writer


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
