"""The simulated car's laser sees what its commands have brought it to."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.rover_dynamics import RoverModel
from drivers.vehicle import DriveCommand
from mapping.mount import Mount
from tools.driven_world import DrivenWorld
from tools.world import World

LASER_X_M = 0.1
EXACT = RoverModel(latency_s=0.0, acceleration_mps2=1000.0)


@pytest.fixture
def driven():
    """A car at (1, 1) that looks at the wall x = 4 m of a room of 5 m x 3 m."""
    occupied = np.zeros((150, 250), np.bool_)
    occupied[:, 200:] = True
    world = World(occupied, 0.02, np.zeros(3))
    return DrivenWorld(world, np.array([1.0, 1.0, 0.0]), Mount(np.array([LASER_X_M, 0.0, 0.0])), start_ns=0, seed=1,
                       model=EXACT)  # fmt: skip


def ahead_m(driven, now_ns, count=400):
    """The mean range straight ahead at an instant."""
    ranges = driven(np.full(count, now_ns, np.int64), np.zeros(count))
    return float(ranges[ranges > 0.0].mean())


def test_ranges_shrink_by_what_is_driven_and_stay_where_the_car_stands(driven):
    assert ahead_m(driven, 100_000_000) == pytest.approx(3.0 - LASER_X_M, abs=0.005)
    driven.command(DriveCommand(0.5, 0.0), 200_000_000)
    assert ahead_m(driven, 1_200_000_000) == pytest.approx(2.5 - LASER_X_M, abs=0.01)
    driven.command(DriveCommand(0.0, 0.0), 1_200_000_000)
    assert ahead_m(driven, 5_000_000_000) == pytest.approx(2.5 - LASER_X_M, abs=0.015)


def test_each_sample_sees_the_car_where_it_was_then(driven):
    driven.command(DriveCommand(1.0, 0.0), 0)
    driven.advance(1_000_000_000)
    times = np.repeat(np.array([500_000_000, 1_000_000_000]), 300)
    ranges = driven(times, np.zeros(600))
    early, late = (part[part > 0.0].mean() for part in (ranges[:300], ranges[300:]))
    assert early - late == pytest.approx(0.5, abs=0.01)


def test_a_box_is_seen_from_the_moment_it_is_there(driven):
    assert ahead_m(driven, 10_000_000) > 2.5
    driven.put_box(np.array([[2.0, 0.8], [2.2, 0.8], [2.2, 1.2], [2.0, 1.2]]))
    assert ahead_m(driven, 20_000_000) == pytest.approx(1.0 - LASER_X_M, abs=0.03)


def test_the_truth_has_one_pose_every_ten_milliseconds(driven):
    driven.advance(1_005_000_000)
    stamps, poses, speeds = driven.truth
    assert set(np.diff(stamps)) == {10_000_000}
    assert stamps[-1] == 1_010_000_000
    assert poses.shape == (len(stamps), 3)
    assert not speeds.any()
