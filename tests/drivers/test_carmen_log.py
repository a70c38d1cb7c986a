from __future__ import annotations

import bz2
import gzip

import numpy as np
import pytest

from drivers.carmen_log import CarmenLog, beam_angles, is_carmen_log, parse_stamp_ns
from drivers.errors import RecordingError
from drivers.messages import LaserScan, Odometry, Transform
from drivers.recording_reader import open_recording


def flaser(stamp="10.5", ranges=(1.0, 2.0, 81.91), laser=(1.0, 2.0, 0.5), robot=(1.0, 2.0, 0.5)):
    numbers = " ".join(str(value) for value in (*ranges, *laser, *robot))
    return f"FLASER {len(ranges)} {numbers} {stamp} host 0.1\n"


def odom(stamp, x=0.0):
    return f"ODOM {x} 0.0 0.0 0.3 0.0 0.0 {stamp} host 0.1\n"


@pytest.fixture
def write(tmp_path):
    def to_file(text, name="x.clf", pack=None):
        data = text.encode()
        path = tmp_path / name
        path.write_bytes(pack(data) if pack else data)
        return path

    return to_file


def test_scan_and_odometry_are_read_with_all_digits_of_their_stamps(write):
    path = write("# comment\nPARAM a b 1 h 2\n" + flaser("976052857.337530") + odom("976052857.400001", 3.0))
    with open_recording(path) as log:
        static, own, scan, wheel = log.messages()
        assert {topic.name: topic.count for topic in log.topics} == {"FLASER": 1, "ODOM": 1, "PARAM": 1}
        assert log.skipped == {"CARMEN PARAM": 1}
    assert isinstance(static, Transform)
    assert isinstance(scan, LaserScan)
    assert isinstance(own, Odometry)
    assert isinstance(wheel, Odometry)
    assert scan.stamp_ns == own.stamp_ns == 976_052_857_337_530_000
    assert wheel.stamp_ns == 976_052_857_400_001_000
    assert wheel.pose.tolist() == [3.0, 0.0, 0.0]
    assert own.pose.tolist() == [1.0, 2.0, 0.5]


def test_no_return_is_no_measurement(write):
    with CarmenLog(write(flaser(ranges=(1.0, 81.0, 81.91, 0.0)))) as log:
        scan = next(message for message in log if isinstance(message, LaserScan))
    assert scan.valid.tolist() == [True, False, False, False]


@pytest.mark.parametrize(
    ("count", "first_deg", "last_deg", "step_deg"), [(180, -90, 89, 1.0), (360, -90, 89.5, 0.5), (361, -90, 90, 0.5)]
)
def test_beams_cover_half_a_turn(count, first_deg, last_deg, step_deg):
    angles = np.degrees(beam_angles(count))
    assert (angles[0], angles[-1]) == pytest.approx((first_deg, last_deg))
    assert np.diff(angles) == pytest.approx(np.full(count - 1, step_deg))


def test_laser_pose_on_the_robot_is_what_the_two_poses_say(write):
    ahead = flaser(laser=(1.0, 2.3, 1.5707963), robot=(1.0, 2.0, 1.5707963))
    with CarmenLog(write(ahead)) as log:
        static = next(iter(log))
    assert isinstance(static, Transform)
    assert (static.parent, static.child) == ("base_link", "laser")
    assert static.translation == pytest.approx([0.3, 0.0, 0.0], abs=1e-6)


@pytest.mark.parametrize("pack", [None, gzip.compress, bz2.compress])
def test_compression_is_told_by_content_not_by_name(pack, write):
    path = write(flaser(), name="log.txt", pack=pack)
    assert is_carmen_log(path)
    with open_recording(path) as log:
        assert sum(isinstance(message, LaserScan) for message in log) == 1
        assert not log.truncated


def test_stamps_that_step_back_are_sorted_and_none_is_lost(write):
    stamps = ["3.0", "1.0", "2.0", "5.0", "4.0"]
    with CarmenLog(write("".join(flaser(stamp) for stamp in stamps))) as log:
        scans = [message.stamp_ns for message in log if isinstance(message, LaserScan)]
    assert scans == [n * 10**9 for n in range(1, 6)]


def test_odometry_of_a_scan_comes_before_it(write):
    with CarmenLog(write(flaser("1.0") + flaser("2.0"))) as log:
        kinds = [type(message) for message in log]
    assert kinds == [Transform, Odometry, LaserScan, Odometry, LaserScan]


@pytest.mark.parametrize(
    "broken",
    ["FLASER 3 1.0 2.0\n", "FLASER x\n", "FLASER\n", "FLASER 2 1.0 nonsense 0 0 0 0 0 0 1.0 h 1\n", "ODOM 1 2 3\n"],
)
def test_broken_lines_are_counted_and_passed_over(broken, write):
    with CarmenLog(write(flaser("1.0") + broken + flaser("2.0"))) as log:
        assert len([message for message in log if isinstance(message, LaserScan)]) == 2
        assert len(log.problems) == 1
        assert "do not parse" in log.problems[0]


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress])
def test_a_cut_archive_is_read_as_far_as_it_goes(pack, write):
    random = np.random.default_rng(0)
    ranges = [tuple(random.uniform(0.5, 9.0, 180).round(2)) for _ in range(3000)]  # bz2 packs blocks of 900 kB
    text = "".join(flaser(f"{n}.0", ranges=values) for n, values in enumerate(ranges))
    whole = pack(text.encode())
    path = write("")
    path.write_bytes(whole[: len(whole) * 3 // 4])
    with open_recording(path) as log:
        scans = [message for message in log.messages() if isinstance(message, LaserScan)]
        assert log.truncated
        assert len(log.problems) == 1
    assert 500 < len(scans) < 3000


@pytest.mark.parametrize("content", [b"", b"hello world\n", b"FLASERX\n", bz2.compress(b"hello"), b"\x1f\x8bbroken"])
def test_other_files_are_no_carmen_logs(content, write, tmp_path):
    path = tmp_path / "x"
    path.write_bytes(content)
    assert not is_carmen_log(path)
    with pytest.raises(RecordingError, match=r"^[^\n]*$"):
        open_recording(path)


def test_log_without_scans_and_odometry_is_refused(write):
    with pytest.raises(RecordingError, match="without FLASER"):
        open_recording(write("PARAM a b 1 h 2\n"))


def test_unknown_scan_topic_is_refused(write):
    with CarmenLog(write(flaser())) as log, pytest.raises(RecordingError, match="/scan"):
        list(log.messages("/scan"))


def test_stamp_is_exact():
    assert parse_stamp_ns(b"976052857.337530") == 976_052_857_337_530_000
    assert parse_stamp_ns(b"12") == 12_000_000_000
