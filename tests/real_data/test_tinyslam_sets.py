"""The logs of the MINES rover that tinySLAM was shown with."""

from __future__ import annotations

import json

import numpy as np
import pytest

from drivers.messages import LaserScan
from drivers.recording_reader import open_recording
from mapping import se2
from mapping.trajectory import read_tum
from tools.config import parse
from tools.replay_run import replay_recording

pytestmark = pytest.mark.real_data

SCANS = {"exp1": 756, "exp2": 641, "test_lab": 590}
MAPPED = ("exp1", "test_lab")  # exp2 is like exp1, and mapping takes its time


def silent(_text: str) -> None:
    """Take no notice of progress."""


@pytest.fixture(scope="module", params=MAPPED)
def mapped(request, data_dir, tmp_path_factory):
    """Name of the log, and the folder with its map by scan matching and, below, by the wheels and without them."""
    folder = tmp_path_factory.mktemp(request.param)
    plain = {"slam": {"refine": False}}  # what is asked below does not depend on it
    stated = {**plain, "replay": {"sweep": "stated"}}  # as the first replay finds out, which takes as long as mapping
    with open_recording(data_dir / f"tinyslam_mines/{request.param}.dat") as recording:
        replay_recording(recording, parse(plain, "test"), folder, on_progress=silent)
        wheels = parse(stated, "test").with_odometry("wheel")
        replay_recording(recording, wheels, folder / "wheels", on_progress=silent)
        without = parse({**stated, "odometry": {"use_wheel_odometry": False}}, "test")
        replay_recording(recording, without, folder / "without", on_progress=silent)
    return request.param, folder


def report_of(folder):
    return json.loads((folder / "report.json").read_text())


def test_all_scans_but_a_doubtful_few_are_mapped_with_and_without_the_wheels(mapped):
    name, folder = mapped
    for where in (folder, folder / "without"):
        scans = report_of(where)["scans"]
        assert scans["received"] == SCANS[name]
        assert scans["mapped"] >= 0.98 * SCANS[name]  # where a wheel slips, matches may be refused for a second
    assert report_of(folder)["scans"]["wheel_guesses"] > SCANS[name] - 10


def test_only_the_cut_line_at_the_end_of_test_lab_is_missing(mapped):
    name, folder = mapped
    report = report_of(folder)
    assert report["truncated"] == (name == "test_lab")
    assert len(report["problems"]) == (name == "test_lab")


def test_laser_turns_the_way_its_maker_says(mapped):
    _, folder = mapped
    assert report_of(folder)["sweep"]["reversed"] is False


def test_wheels_and_laser_agree_on_distance_and_turning(mapped):
    """Over some 2 s, in the median: a wheel slips now and then, by 90 deg once in test_lab."""
    _, folder = mapped
    matched, wheels = (read_tum(folder / where / "trajectory.tum") for where in ("", "wheels"))
    common = matched.stamps_ns[5::20]
    by_laser, by_wheels = (se2.between(t.at(common)[:-1], t.at(common)[1:]) for t in (matched, wheels))
    driven = np.hypot(*by_wheels[:, :2].T)
    moving = driven > 0.3
    assert moving.sum() > 15
    assert np.median(np.hypot(*by_laser[moving, :2].T) / driven[moving]) == pytest.approx(1.0, abs=0.03)
    assert np.median(np.abs(by_laser[moving, 2] - by_wheels[moving, 2])) < np.radians(3.0)
    turning = np.abs(by_wheels[:, 2]) > np.radians(20.0)
    assert np.median(by_laser[turning, 2] / by_wheels[turning, 2]) == pytest.approx(1.0, abs=0.03)


def test_the_wheels_do_not_decide_where_a_drive_ends(mapped):
    """Scan matching with and without the wheels' guess: drifts that differ would end metres apart."""
    _, folder = mapped
    ends = []
    for where in (folder, folder / "without"):
        poses = read_tum(where / "trajectory.tum").poses
        ends.append(np.hypot(*(poses[-1] - poses[0])[:2]))
    assert abs(ends[0] - ends[1]) < 1.0


@pytest.mark.parametrize("name", sorted(SCANS))
def test_every_scan_of_a_log_is_read(name, data_dir):
    with open_recording(data_dir / f"tinyslam_mines/{name}.dat") as recording:
        stamps = [message.stamp_ns for message in recording if isinstance(message, LaserScan)]
    assert len(stamps) == SCANS[name]
    assert stamps == sorted(set(stamps))


def test_no_error_code_is_a_measurement(data_dir):
    with open_recording(data_dir / "tinyslam_mines/exp1.dat") as recording:
        ranges = np.concatenate([scan.ranges_m[scan.valid] for scan in recording if isinstance(scan, LaserScan)])
    assert ranges.min() > 0.1
    assert ranges.max() < 5.6
