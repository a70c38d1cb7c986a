"""A recording of a real sensor, made by other people, through the whole flow."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.recording_reader import open_recording
from mapping import se2
from mapping.map_io import read_map
from mapping.sweep import entropy
from mapping.trajectory import read_tum
from tools.config import Config, parse
from tools.replay_run import replay_recording

pytestmark = pytest.mark.real_data


def silent(_text: str) -> None:
    """Take no notice of progress."""


@pytest.fixture(scope="module")
def turtlebot(data_dir, tmp_path_factory):
    """A real RPLIDAR A1 on a TurtleBot 4, its laser turned by 90 deg (tb4_rplidar_olin)."""
    folder = tmp_path_factory.mktemp("tb4")
    with open_recording(data_dir / "tb4_rplidar_olin") as recording:
        report = replay_recording(recording, Config(), folder, on_progress=silent)
        wheels = folder / "wheels"
        replay_recording(recording, Config().with_odometry("wheel"), wheels, on_progress=silent)
    return folder, report


def test_every_scan_of_the_turtlebot_is_mapped(turtlebot):
    _, report = turtlebot
    assert report["scans"]["mapped"] == report["scans"]["received"] == 357
    assert report["laser_pose"]["yaw_rad"] == pytest.approx(np.pi / 2)


def test_trajectory_is_the_robots_not_the_lasers(turtlebot):
    """A TurtleBot cannot move sideways: by the wheels too it drives forward, however its laser is turned."""
    folder, _ = turtlebot
    for name in ("trajectory.tum", "wheels/trajectory.tum"):
        poses = read_tum(folder / name).poses
        steps = se2.between(poses[:-8], poses[8:])[:, :2]  # about a second
        moving = np.hypot(*steps.T) > 0.1
        assert moving.sum() > 50
        assert np.median(np.abs(steps[moving, 1] / steps[moving, 0])) < 0.1, name


def test_matched_trajectory_agrees_with_the_wheels(turtlebot):
    folder, _ = turtlebot
    matched, wheels = (read_tum(folder / name) for name in ("trajectory.tum", "wheels/trajectory.tum"))
    # No truth exists: 46 s of a TurtleBot's wheels are good to a few per cent of its 8 m, on a smooth floor.
    common = matched.stamps_ns[20:-20]
    off = se2.between(wheels.at(common[:1]), wheels.at(common)) - se2.between(
        matched.at(common[:1]), matched.at(common)
    )
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.6


def test_sweep_of_rplidar_ros_is_found_out_and_sharpens_the_map(turtlebot, data_dir, tmp_path):
    folder, report = turtlebot
    assert report["sweep"]["reversed"] is True
    as_stated = parse({"replay": {"sweep": "stated"}}, "test")
    with open_recording(data_dir / "tb4_rplidar_olin") as recording:
        replay_recording(recording, as_stated, tmp_path, on_progress=silent)
    assert entropy(read_map(folder / "map.npz")) < 0.9 * entropy(read_map(tmp_path / "map.npz"))


def test_walls_are_single_lines(turtlebot):
    """Along the long wall beside the robot's start, the occupied cells across it span a few cells at most."""
    folder, _ = turtlebot
    grid = read_map(folder / "map.npz")
    rows, cols = np.nonzero(grid.occupied)
    points = grid.cell_centers(rows, cols)
    wall = points[
        (np.abs(points[:, 1] - np.median(longest_row(points))) < 0.6) & (points[:, 0] > -2) & (points[:, 0] < 4)
    ]
    spread = [np.ptp(wall[np.abs(wall[:, 0] - x) < 0.05, 1]) for x in np.arange(-1.5, 3.5, 0.1) if near(wall, x)]
    assert len(spread) > 25
    assert np.median(spread) <= 2 * grid.resolution_m + 1e-6


def longest_row(points):
    """Return the y of the cells in the 10 cm band with the most of them."""
    counts, edges = np.histogram(points[:, 1], bins=np.arange(points[:, 1].min(), points[:, 1].max() + 0.1, 0.1))
    best = int(np.argmax(counts))
    return points[(points[:, 1] >= edges[best]) & (points[:, 1] < edges[best + 1]), 1]


def near(wall, x):
    return bool((np.abs(wall[:, 0] - x) < 0.05).any())


def test_replay_repeats_bit_for_bit(turtlebot, data_dir, tmp_path):
    folder, _ = turtlebot
    with open_recording(data_dir / "tb4_rplidar_olin") as recording:
        replay_recording(recording, Config(), tmp_path, on_progress=silent)
    for name in ("trajectory.tum", "map.pgm"):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()
