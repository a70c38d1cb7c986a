"""A run's map while it goes on, for others to read."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from mapping.grid import OccupancyGrid
from mapping.map_io import read_map
from mapping.mount import Mount
from mapping.odometry import ScanMatch
from mapping.slam import MappedScan
from mapping.trajectory import Trajectory, read_tum
from tools.clock import RunClock
from tools.map_sharing import SharedMap
from tools.session_parts import LiveSession


def mapped(second):
    match = ScanMatch(np.zeros(3), np.zeros(3), accepted=True)
    return MappedScan(round(second * 1e9), np.zeros(3), match, np.zeros((0, 2)), False, False)


class Drive:
    """A session whose map gets a column more each time that it is asked for."""

    def __init__(self, folder):
        self.drawn = 0
        self.session = LiveSession(
            RunClock(), Mount(), lambda _: None, threading.Event(), self.grid, folder, self.trajectory
        )

    def trajectory(self):
        return Trajectory(np.arange(self.drawn, dtype=np.int64), np.zeros((self.drawn, 3)))

    def grid(self):
        self.drawn += 1
        return OccupancyGrid(np.full((4, self.drawn), -1.0, np.float32), 0.05, np.zeros(3))


@pytest.fixture
def drive(tmp_path):
    return Drive(tmp_path)


def wait_for(part):
    """Let the writer finish, as time between scans does."""
    part.end()


def test_the_map_is_written_every_so_often_and_whole(drive, tmp_path):
    part = SharedMap(2.0)
    part.begin(drive.session)
    widths = []
    for tenth in range(100):
        part.add(mapped(100.0 + tenth * 0.1))
        wait_for(part)
        if (tmp_path / "map.npz").exists():
            widths.append(read_map(tmp_path / "map.npz").log_odds.shape[1])
    assert drive.drawn == 4
    assert sorted(set(widths)) == [1, 2, 3, 4]
    assert len(read_tum(tmp_path / "trajectory.tum")) == 4
    assert sorted(path.name for path in tmp_path.iterdir()) == ["map.npz", "trajectory.tum"]
    assert part.save(tmp_path) == {}


def test_nothing_is_drawn_while_the_last_one_is_still_written(drive):
    part = SharedMap(0.5)
    part.begin(drive.session)
    part.add(mapped(0.0))
    gate = threading.Event()
    part._writer = threading.Thread(target=gate.wait, daemon=True)  # a disk that hangs
    part._writer.start()
    part.add(mapped(10.0))
    assert drive.drawn == 0
    gate.set()
    part.end()
    part.add(mapped(10.1))
    part.end()
    assert drive.drawn == 1


def test_a_folder_that_is_gone_is_told_once_and_mapping_goes_on(tmp_path, caplog):
    drive = Drive(tmp_path / "none")
    part = SharedMap(0.5)
    part.begin(drive.session)
    for second in range(5):
        part.add(mapped(float(second)))
        wait_for(part)
    assert drive.drawn == 4
    assert caplog.text.count("the map is not shared") == 1
