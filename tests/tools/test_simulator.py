from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mapping import se2
from mapping.mount import Mount
from mapping.trajectory import Trajectory
from tools.simulator import MAX_STEERING_RAD, WHEELBASE_M, SimulatedLidar, drive_along
from tools.world import OFFICE_TOUR, World, office

CENTER = Trajectory(np.zeros(1, dtype=np.int64), np.zeros((1, 3)))


def box(half_width_m=3.0, half_height_m=2.0, cell_m=0.01):
    """A room around the origin whose walls stand at x = +-half_width and y = +-half_height."""
    rows, cols = round(2 * half_height_m / cell_m) + 20, round(2 * half_width_m / cell_m) + 20
    walls = np.ones((rows, cols), dtype=bool)
    walls[10:-10, 10:-10] = False
    return World(walls, cell_m, np.array([-half_width_m - 0.1, -half_height_m - 0.1, 0.0]))


def still(world, mount=None, truth=CENTER, **options):
    quiet: dict[str, Any] = {"noise": (0.0, 0.0), "dropout": 0.0}
    return SimulatedLidar(world, truth, mount or Mount(), **(quiet | options))


def test_tour_is_one_that_a_car_can_drive():
    drive = drive_along(OFFICE_TOUR)
    seconds = np.diff(drive.stamps_ns) * 1e-9
    steps = se2.log(se2.between(drive.poses[:-1], drive.poses[1:])) / seconds[:, np.newaxis]
    speed, turn = steps[:, 0], steps[:, 2]
    assert np.abs(steps[:, 1]).max() < 0.02  # no sideways motion: pure pursuit changes curvature between two poses
    assert speed.max() <= 0.6 + 1e-3
    tightest = np.tan(MAX_STEERING_RAD) / WHEELBASE_M
    assert np.abs(turn / np.maximum(speed, 0.05)).max() <= tightest * 1.01
    assert np.abs(np.diff(speed) / seconds[1:]).max() < 0.6


def test_tour_keeps_clear_of_the_walls():
    world, drive = office(), drive_along(OFFICE_TOUR)
    cells = np.floor((drive.poses[:, :2] - world.origin[:2]) / world.resolution_m).astype(int)
    reach = round(0.12 / world.resolution_m)  # half the width of a QCar and a little
    for dx in range(-reach, reach + 1):
        for dy in range(-reach, reach + 1):
            if dx * dx + dy * dy <= reach * reach:
                assert not world.occupied[cells[:, 1] + dy, cells[:, 0] + dx].any()


def test_ranges_are_those_of_the_room_clockwise():
    lidar = still(box())
    theta = np.radians([0.0, 90.0, 180.0, 270.0, 45.0])
    assert lidar(np.zeros(5, dtype=np.int64), theta) == pytest.approx([3.0, 2.0, 3.0, 2.0, 2.0 * np.sqrt(2)], abs=0.011)
    off_center = Trajectory(np.zeros(1, dtype=np.int64), np.array([[1.0, 0.5, 0.0]]))
    ranges = still(box(), truth=off_center)(np.zeros(4, dtype=np.int64), theta[:4])
    assert ranges == pytest.approx([2.0, 2.5, 4.0, 1.5], abs=0.011)  # theta 90 looks right, to y = -2


def test_mount_and_its_inversion_are_honoured():
    turned = Mount(np.array([0.5, 0.0, np.pi / 2]))
    assert still(box(), turned)(np.zeros(2, dtype=np.int64), np.radians([0.0, 90.0])) == pytest.approx(
        [2.0, 2.5], abs=0.011
    )
    hanging = Mount(np.array([0.5, 0.5, 0.0]), inverted=True)
    assert still(box(), hanging)(np.zeros(1, dtype=np.int64), np.radians([90.0])) == pytest.approx([1.5], abs=0.011)


def test_car_sets_out_after_the_delay_and_each_sample_has_its_own_pose():
    drive = Trajectory(np.array([0, 1_000_000_000]), np.array([[0.0, 0, 0], [1.0, 0, 0]]))
    lidar = still(box(), truth=drive, start_delay_s=2.0)
    begin = 5_000_000_000
    times = begin + np.array([0, 2_000_000_000, 2_500_000_000, 3_000_000_000, 9_000_000_000])
    assert lidar(times, np.zeros(5)) == pytest.approx([3.0, 3.0, 2.5, 2.0, 2.0], abs=0.011)
    assert lidar.start_ns == begin + 2_000_000_000


def test_noise_repeats_with_the_seed_and_has_the_stated_size():
    theta = np.zeros(4000)
    times = np.zeros(4000, dtype=np.int64)
    noisy = [still(box(), noise=(0.01, 0.0), dropout=0.1, seed=seed)(times, theta) for seed in (1, 1, 2)]
    assert np.array_equal(noisy[0], noisy[1])
    assert not np.array_equal(noisy[0], noisy[2])
    seen = noisy[0][noisy[0] > 0]
    assert len(seen) / 4000 == pytest.approx(0.9, abs=0.02)
    assert seen.std() == pytest.approx(0.01, rel=0.1)


def test_nothing_within_range_is_no_return():
    assert still(box(), max_range_m=2.5)(np.zeros(2, dtype=np.int64), np.radians([0.0, 90.0])) == pytest.approx(
        [0, 2], abs=0.011
    )
