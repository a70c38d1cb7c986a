from __future__ import annotations

import math
import shutil

import numpy as np
import pytest

from drivers.errors import RecordingError
from mapping import se2
from tools.errors import ToolError
from tools.mrpt_peer import PROGRAMS, bench_icp_slam, with_times
from tools.world import office

YEAR_2026 = 116_444_736_000_000_000 + 17_900_000_000_000_000


def rawlog(time: int, observations: int) -> bytes:
    """What the converter writes, as far as the times go."""
    parts = []
    for number in range(observations):
        name = b"CObservation2DRangeScan" if number % 2 else b"CObservationOdometry"
        parts.append(bytes([len(name)]) + name + b"\x07" * (5 + number) + time.to_bytes(8, "little") + b"rest\x88")
    return b"head" + b"".join(parts)


def times_of(data: bytes, observations: int) -> list[int]:
    places = [place for place in range(len(data)) if data.startswith(b"rest", place)]
    assert len(places) == observations
    return [int.from_bytes(data[place - 8 : place], "little") for place in places]


def test_each_pair_of_observations_gets_its_stamp_and_times_rise():
    stamps = [10**18, 10**18 + 10**9, 10**18 + 10**9, 10**18 + 5 * 10**8]
    stamped = with_times(rawlog(YEAR_2026, 8), stamps)
    assert len(stamped) == len(rawlog(YEAR_2026, 8))
    times = times_of(stamped, 8)
    assert times[::2] == times[1::2]
    assert times[2] - times[0] == 10**7  # of 100 ns
    assert (np.diff(times[::2]) > 0).all()


@pytest.mark.parametrize("data", [b"", rawlog(YEAR_2026, 6), rawlog(17, 8)])
def test_another_form_of_rawlog_is_refused(data):
    with pytest.raises(ToolError, match="--no-peers"):
        with_times(data, [1, 2, 3, 4])


def test_a_program_that_is_not_installed_is_a_row_that_says_so(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    row = bench_icp_slam(tmp_path / "any.log", ())
    assert row.note.startswith("not installed")
    assert row.cpu_ms_per_scan is None


@pytest.fixture
def failing_programs(tmp_path, monkeypatch):
    """Programs of these names that end with an error."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name in PROGRAMS:
        (folder / name).write_text("#!/bin/sh\necho it went wrong\nexit 7\n")
        (folder / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(folder))


def carmen_log(path, scans: int = 60) -> None:
    """A drive of 5 cm a scan along the office's corridor, laser with 180 beams, and relations of it."""
    world, bearings = office(), np.radians(np.arange(180) - 90.0)
    lines = ["# CARMEN Logfile\n"]
    for number in range(scans):
        x = 2.0 + 0.05 * number
        ranges = world.ranges(np.tile([x, 5.75, 0.0], (180, 1)), bearings, 20.0)
        text = " ".join(f"{value:.3f}" for value in np.where(ranges > 0, ranges, 81.9))
        stamp = f"{1000.0 + 0.2 * number:.6f}"
        pose = f"{0.05 * number:.4f} 0.0 0.0"
        lines.append(f"FLASER 180 {text} {pose} {pose} {stamp} here {stamp}\n")
    path.write_text("".join(lines))


@pytest.mark.usefixtures("failing_programs")
def test_a_recording_of_another_kind_is_a_row_that_says_so(project_root):
    row = bench_icp_slam(project_root / "recordings/simulated_office_a2m8.mcap", ())
    assert row.note == "reads CARMEN logs only"


@pytest.mark.usefixtures("failing_programs")
def test_a_program_that_fails_is_one_line_with_what_it_said(tmp_path):
    carmen_log(tmp_path / "a.log")
    with pytest.raises(ToolError, match="carmen2rawlog ended with 7: it went wrong"):
        bench_icp_slam(tmp_path / "a.log", ())


@pytest.mark.usefixtures("failing_programs")
def test_a_log_of_one_scan_is_refused(tmp_path):
    carmen_log(tmp_path / "a.log", scans=1)
    with pytest.raises(RecordingError, match="fewer than two scans"):
        bench_icp_slam(tmp_path / "a.log", ())


@pytest.mark.skipif(any(shutil.which(name) is None for name in PROGRAMS), reason="needs mrpt-apps")
def test_icp_slam_follows_a_short_drive(tmp_path):
    carmen_log(tmp_path / "a.log")
    dx, _, yaw = se2.between(np.array([0.0, 0, 0]), np.array([2.5, 0, 0])).tolist()
    relations = tmp_path / "a.relations"
    relations.write_text(f"1000.0 1010.0 {dx} 0 0 0 0 {yaw}\n")
    row = bench_icp_slam(tmp_path / "a.log", (relations,))
    assert row.cpu_ms_per_scan is not None
    assert row.cpu_ms_per_scan > 0.0
    assert row.score.relations == 1
    assert row.score.mean_m < 0.3
    assert row.tau_cpu is not None
    assert math.isfinite(row.tau_cpu)
