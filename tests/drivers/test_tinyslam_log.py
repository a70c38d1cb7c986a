from __future__ import annotations

import gzip
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import RecordingError
from drivers.messages import LaserScan, Odometry, Transform
from drivers.recording_reader import open_recording
from drivers.tinyslam_log import (
    AXLE_M,
    BEAMS,
    COUNTS_PER_TURN,
    SCAN_AGE_S,
    WHEEL_RADIUS_M,
    TinyslamLog,
    beam_angles,
    is_tinyslam_log,
)

M_PER_COUNT = 2 * math.pi * WHEEL_RADIUS_M / COUNTS_PER_TURN


def line25(time_us, left=0, right=0, ranges=None):
    header = [time_us, 14710, left, right, *[0] * 3, 170.1, *[9] * 17]
    return " ".join(str(number) for number in (*header, *(ranges or [1000] * BEAMS))) + " \n"


def line13(time_us, left=0, right=0, ranges=None):
    header = [time_us, left, -right, -2.5, 1.5, 321.9, *[0] * 7]
    return "  ".join(str(number) for number in (*header, *(ranges or [1000] * BEAMS))) + "\n"


@pytest.fixture
def write(tmp_path):
    def to_file(text, pack=None):
        path = tmp_path / "any.name"
        path.write_bytes(pack(text.encode()) if pack else text.encode())
        return path

    return to_file


def odometry_of(log):
    return [message for message in log if isinstance(message, Odometry)]


def scans_of(log):
    return [message for message in log if isinstance(message, LaserScan)]


@pytest.mark.parametrize("line", [line25, line13])
@pytest.mark.parametrize("pack", [None, gzip.compress])
def test_both_kinds_are_told_by_their_content(line, pack, write):
    path = write(line(1_000_000, 10, 20) + line(1_100_000, 10, 20), pack)
    assert is_tinyslam_log(path)
    with open_recording(path) as log:
        static, first, scan, *rest = log.messages()
        assert {topic.name: topic.count for topic in log.topics} == {"ranges": 2, "encoders": 2}
        assert (log.problems, log.truncated, log.skipped) == ([], False, {})
        assert (log.start_ns, log.end_ns) == (scan.stamp_ns, rest[1].stamp_ns)
    assert isinstance(static, Transform)
    assert (static.parent, static.child) == ("base_link", "laser")
    assert isinstance(first, Odometry)
    assert isinstance(scan, LaserScan)
    assert first.stamp_ns == 1_000_000_000
    assert len(rest) == 2


def test_samples_are_taken_counterclockwise_before_the_line_is_written(write):
    with TinyslamLog(write(line25(1_000_000))) as log:
        scan = scans_of(log)[0]
    # A turn of 1024 steps takes 100 ms.
    assert scan.offsets_s == pytest.approx(np.arange(BEAMS) * 0.1 / 1024)
    assert (np.diff(scan.angles_rad) > 0).all()
    last_ns = scan.stamp_ns + round(scan.offsets_s[-1] * 1e9)
    assert last_ns == pytest.approx(1_000_000_000 - SCAN_AGE_S * 1e9, abs=1)


def test_beams_are_those_of_the_sensor():
    angles = np.degrees(beam_angles())
    assert np.diff(angles) == pytest.approx(np.full(681, 360 / 1024))
    assert angles[384 - 44] == 0.0
    assert (angles[0], angles[-1]) == pytest.approx((-119.53125, 119.8828125))


def test_error_codes_and_what_lies_beyond_the_range_are_no_measurements(write):
    ranges = [0, 1, 6, 19, 20, 4000, 5599, 5600, *[0] * (BEAMS - 8)]
    with TinyslamLog(write(line13(1_000_000, ranges=ranges))) as log:
        scan = scans_of(log)[0]
    assert scan.valid[:8].tolist() == [False] * 4 + [True] * 3 + [False]
    assert scan.ranges_m[5] == pytest.approx(4.0)


@pytest.mark.parametrize("line", [line25, line13])
def test_equal_counts_drive_straight_and_a_faster_right_wheel_turns_left(line, write):
    text = line(0, 100, 200) + line(1_000_000, 1100, 1200) + line(2_000_000, 1100, 2200)
    with TinyslamLog(write(text)) as log:
        _, straight, turned = odometry_of(log)
    assert straight.pose == pytest.approx([1000 * M_PER_COUNT, 0.0, 0.0])
    assert straight.twist == pytest.approx([1000 * M_PER_COUNT, 0.0, 0.0])
    assert turned.pose[2] == pytest.approx(1000 * M_PER_COUNT / AXLE_M)
    assert turned.pose[1] > 0.0
    assert turned.twist[2] == pytest.approx(turned.pose[2])


@given(left=st.integers(-2000, 2000), right=st.integers(-2000, 2000))
def test_driving_back_ends_where_it_began(left, right, tmp_path_factory):
    path = tmp_path_factory.mktemp("d") / "log"
    path.write_text(line25(0, 50, 70) + line25(1_000_000, 50 + left, 70 + right) + line25(2_000_000, 50, 70))
    with TinyslamLog(path) as log:
        end = odometry_of(log)[-1]
    assert end.pose == pytest.approx(np.zeros(3), abs=1e-12)


@given(left=st.integers(1, 1500), right=st.integers(1, 1500))
def test_arc_is_that_of_a_differential_drive(left, right, tmp_path_factory):
    path = tmp_path_factory.mktemp("d") / "log"
    path.write_text(line25(0) + line25(1_000_000, left, right))
    with TinyslamLog(path) as log:
        x, y, yaw = odometry_of(log)[-1].pose
    if left == right:
        assert (x, y, yaw) == pytest.approx((left * M_PER_COUNT, 0.0, 0.0))
        return
    # About the point beside the axle at which both wheels turn by one angle.
    radius = AXLE_M / 2 * (right + left) / (right - left)
    assert (x, y) == pytest.approx((radius * math.sin(yaw), radius * (1 - math.cos(yaw))), abs=1e-6)


def test_counters_and_clock_run_over_their_ends(write):
    low, high = -(2**31), 2**31 - 1
    text = line25(2**32 - 500_000, high, high - 10) + line25(500_000, low + 99, low + 89)
    with TinyslamLog(write(text)) as log:
        first, second = odometry_of(log)
        assert log.problems == []
    assert second.stamp_ns - first.stamp_ns == 1_000_000_000
    assert second.pose == pytest.approx([100 * M_PER_COUNT, 0.0, 0.0])


def test_counter_that_was_reset_does_not_move_the_robot(write):
    text = line25(0, 90_000, 90_000) + line25(100_000, 5, 5) + line25(200_000, 105, 105)
    with TinyslamLog(write(text)) as log:
        _, reset, after = odometry_of(log)
        assert len(log.problems) == 1
        assert "reset" in log.problems[0]
    assert reset.pose.tolist() == [0.0, 0.0, 0.0]
    assert after.pose == pytest.approx([100 * M_PER_COUNT, 0.0, 0.0])


@pytest.mark.parametrize(
    "broken", ["1 2 3\n", "hello\n", line25(150_000)[:-40] + "\n", line25(150_000).replace("1000", "x", 1), line25(50)]
)
def test_broken_and_late_lines_are_counted_and_passed_over(broken, write):
    with TinyslamLog(write(line25(100_000) + broken + line25(200_000) + "\n")) as log:
        for _ in range(2):
            assert len(scans_of(log)) == 2
        assert not log.truncated
        assert len(log.problems) == 1
        assert log.problems[0].startswith("1 line")


def test_line_that_the_end_of_the_file_cuts_off_is_left_out(write):
    with open_recording(write(line13(100_000) + line13(200_000) + line13(300_000)[:-30])) as log:
        assert len(scans_of(log)) == 2
        assert log.truncated
        assert len(log.problems) == 1
        assert "cut off" in log.problems[0]


def test_cut_archive_is_read_as_far_as_it_goes(write):
    random = np.random.default_rng(2)
    text = "".join(line25(n * 100_000, ranges=random.integers(20, 5000, BEAMS).tolist()) for n in range(200))
    path = write("")
    packed = gzip.compress(text.encode())
    path.write_bytes(packed[: len(packed) // 2])
    with open_recording(path) as log:
        assert 50 < len(scans_of(log)) < 150
        assert log.truncated


@pytest.mark.parametrize("content", ["", "1 2 3\n", "1 " * 694 + "\n", "x " * 707 + "\n", line25(0)[:-40]])
def test_other_files_are_no_tinyslam_logs(content, write):
    path = write(content)
    assert not is_tinyslam_log(path)
    with pytest.raises(RecordingError, match=r"^[^\n]*$"):
        open_recording(path)


def test_unknown_scan_topic_is_refused(write):
    with TinyslamLog(write(line25(0))) as log, pytest.raises(RecordingError, match="/scan"):
        list(log.messages("/scan"))
