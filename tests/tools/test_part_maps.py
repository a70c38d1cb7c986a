"""A part of a drive as a map with its trajectory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapping import se2
from mapping.map_io import read_map
from mapping.trajectory import read_tum
from tools.part_maps import DrivePart, start_frame, write_part


@pytest.fixture
def part(corridor_drive):
    numbers = np.arange(10, 50, 2)
    return DrivePart("car", numbers, 2, start_frame(corridor_drive.poses[10], np.random.default_rng(1)))


def test_map_and_trajectory_are_in_a_frame_near_the_start(corridor_drive, part, tmp_path):
    (tmp_path / "maps").mkdir()
    made = write_part(tmp_path, corridor_drive, part, 10.0, "hall.log")
    assert (made.name, made.robot, made.scan_every, made.rate_hz) == ("car-r10", "car", 2, None)
    assert made.resolution_m == pytest.approx(0.1)
    assert made.trajectory is not None
    assert made.pose is not None
    track = read_tum(made.trajectory)
    np.testing.assert_allclose(se2.compose(made.pose, track.poses), corridor_drive.poses[part.numbers], atol=1e-6)
    assert np.hypot(*track.poses[0, :2]) < 1.5
    # Where the car drove, the map is free.
    grid = read_map(made.path)
    col, row = np.floor(grid.cell_coordinates(track.poses[:, :2])).astype(int).T
    assert grid.free[row, col].mean() > 0.8


def test_stamps_of_the_log_are_kept_and_tell_the_rate(corridor_drive, part, tmp_path):
    (tmp_path / "maps").mkdir()
    stamps_ns = np.arange(len(corridor_drive.poses)) * 400_000_000 + 17
    made = write_part(tmp_path, replace(corridor_drive, stamps_ns=stamps_ns), part, 10.0, "hall.log")
    assert made.rate_hz == pytest.approx(1.25)
    assert made.trajectory is not None
    np.testing.assert_array_equal(read_tum(made.trajectory).stamps_ns, stamps_ns[part.numbers])


def test_frames_are_turned_by_any_angle(corridor_drive):
    random = np.random.default_rng(0)
    turns = [start_frame(corridor_drive.poses[0], random)[2] for _ in range(60)]
    assert min(turns) < -2.5
    assert max(turns) > 2.5
