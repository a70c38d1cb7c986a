from __future__ import annotations

import bz2
import gzip

import numpy as np
import pytest

from drivers.carmen_log import CarmenLog, is_carmen_log
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
    first, second = flaser("976052857.337530"), flaser("976052858.0", robot=(1.5, 2.0, 0.5))
    path = write("# comment\nPARAM a b 1 h 2\n" + first + odom("976052857.400001", 3.0) + second)
    with open_recording(path) as log:
        static, own, scan, wheel, *_ = log.messages()
        assert {topic.name: topic.count for topic in log.topics} == {"FLASER": 2, "ODOM": 1, "PARAM": 1}
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
    with CarmenLog(write(flaser("1.0") + flaser("2.0", robot=(1.1, 2.0, 0.5)))) as log:
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
    with pytest.raises(RecordingError, match="without one whole line of"):
        open_recording(write("PARAM a b 1 h 2\n"))


def test_unknown_scan_topic_is_refused(write):
    with CarmenLog(write(flaser())) as log, pytest.raises(RecordingError, match="/scan"):
        list(log.messages("/scan"))


def new_laser(name="ROBOTLASER1", stamp="10.5", ranges=(1.0, 2.0, 9.0), laser=(1.0, 2.0, 0.5), robot=(1.0, 2.0, 0.5)):
    poses = [*laser, *robot, 0.4, 0.1, 0.5, 0.3, 1e6] if name.startswith("ROBOT") else []
    numbers = [0, -1.0, 2.0, 1.0, 8.0, 0.01, 0, len(ranges), *ranges, 0, *poses]
    return f"{name} {' '.join(map(str, numbers))} {stamp} host 0.1\n"


def scans_of(log, topic=None):
    return [message for message in log.messages(topic) if isinstance(message, LaserScan)]


def odometry_of(log):
    return [message for message in log if isinstance(message, Odometry)]


def test_new_laser_lines_bring_beams_limit_and_odometry(write):
    text = new_laser(stamp="1.0") + new_laser(stamp="2.0", robot=(1.5, 2.0, 0.5))
    with open_recording(write(text)) as log:
        scan = scans_of(log)[0]
        own = odometry_of(log)
        assert (log.scan_topic, log.odometry_topic) == ("ROBOTLASER1", "ROBOTLASER1")
    assert scan.angles_rad.tolist() == [-1.0, 0.0, 1.0]
    assert scan.valid.tolist() == [True, True, False]
    assert own[1].pose.tolist() == [1.5, 2.0, 0.5]
    assert own[1].twist.tolist() == [0.4, 0.0, 0.1]


def test_lasers_other_than_the_front_one_are_counted_and_left_out(write):
    rear = flaser("1.5").replace("FLASER", "RLASER") + new_laser("ROBOTLASER2", "1.6") + new_laser("RAWLASER2", "1.7")
    with open_recording(write(flaser("1.0") + rear + flaser("2.0"))) as log:
        assert len(scans_of(log)) == 2
        assert log.skipped == {"CARMEN RLASER": 1, "CARMEN ROBOTLASER2": 1, "CARMEN RAWLASER2": 1}
        assert log.problems == []


@pytest.mark.parametrize(
    ("lines", "taken"),
    [
        ({"ROBOTLASER1": 3, "FLASER": 3, "RAWLASER1": 3}, "ROBOTLASER1"),
        ({"RAWLASER1": 4, "FLASER": 2}, "FLASER"),
        ({"RAWLASER1": 5, "FLASER": 2}, "RAWLASER1"),
        ({"RAWLASER1": 1}, "RAWLASER1"),
    ],
)
def test_one_kind_of_scan_lines_is_taken_and_another_can_be_asked_for(lines, taken, write):
    text = "".join(
        flaser(f"{n}.0") if name == "FLASER" else new_laser(name, f"{n}.0")
        for name in lines
        for n in range(lines[name])
    )
    with open_recording(write(text)) as log:
        assert log.scan_topic == taken
        assert len(scans_of(log)) == lines[taken]
        for name, count in lines.items():
            assert len(scans_of(log, name)) == count


def test_robot_that_never_moves_by_its_scan_lines_has_no_odometry_from_them(write):
    still = flaser("1.0") + flaser("2.0")
    with CarmenLog(write(still)) as log:
        assert log.odometry_topic is None
        assert odometry_of(log) == []
    with CarmenLog(write(still + odom("1.5", 3.0))) as log:
        assert log.odometry_topic == "ODOM"
        assert [message.pose[0] for message in odometry_of(log)] == [3.0]


def test_raw_laser_is_mounted_where_the_parameters_say(write):
    text = "PARAM robot_frontlaser_offset 0.25 nohost 0\n" + new_laser("RAWLASER1", "1.0")
    with CarmenLog(write(text)) as log:
        static = next(iter(log))
    assert static.translation.tolist() == [0.25, 0.0, 0.0]


def test_number_that_means_no_return_is_found_in_the_log_itself(write):
    random = np.random.default_rng(1)
    rows = [(*random.uniform(0.5, 20.0, 30).round(2), 51.15, 51.15, 51.14) for _ in range(30)]
    with CarmenLog(write("".join(flaser(f"{n}.0", ranges=row) for n, row in enumerate(rows)))) as log:
        for scan in scans_of(log):
            assert scan.valid.tolist() == [True] * 30 + [False] * 3
