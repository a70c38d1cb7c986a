"""The simulated car's laser sees what its commands have brought it to."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.mavlink_constants import RoverMode
from drivers.mavlink_rover import MavlinkRover
from drivers.rover_dynamics import RoverDynamics, RoverModel
from drivers.vehicle import STANDSTILL, DriveCommand
from mapping.mount import Mount
from tools.driven_world import DrivenWorld
from tools.world import World

LASER_X_M = 0.1
EXACT = RoverModel(latency_s=0.0, acceleration_mps2=1000.0)


class CommandedCar:
    """A car that is given its commands without a link."""

    def __init__(self, pose, *, start_ns, model=None):
        self._dynamics, self._command, self._now_ns = RoverDynamics(pose, model), STANDSTILL, start_ns

    @property
    def state(self):
        return self._dynamics.state

    def command(self, command):
        """Give it a command, at the instant up to which it has driven."""
        self._command = command

    def pass_time(self, now_ns):
        if now_ns > self._now_ns:
            self._dynamics.step((now_ns - self._now_ns) * 1e-9, self._command)
            self._now_ns = now_ns


@pytest.fixture
def car():
    """A car at (1, 1)."""
    return CommandedCar(np.array([1.0, 1.0, 0.0]), start_ns=0, model=EXACT)


@pytest.fixture
def driven(car):
    """The car looks at the wall x = 4 m of a room of 5 m x 3 m."""
    occupied = np.zeros((150, 250), np.bool_)
    occupied[:, 200:] = True
    world = World(occupied, 0.02, np.zeros(3))
    return DrivenWorld(world, car, Mount(np.array([LASER_X_M, 0.0, 0.0])), start_ns=0, seed=1)


def ahead_m(driven, now_ns, count=400):
    """The mean range straight ahead at an instant."""
    ranges = driven(np.full(count, now_ns, np.int64), np.zeros(count))
    return float(ranges[ranges > 0.0].mean())


def command(driven, car, command, now_ns):
    """Let the time come and give a command."""
    driven.advance(now_ns)
    car.command(command)


def test_ranges_shrink_by_what_is_driven_and_stay_where_the_car_stands(driven, car):
    assert ahead_m(driven, 100_000_000) == pytest.approx(3.0 - LASER_X_M, abs=0.005)
    command(driven, car, DriveCommand(0.5, 0.0), 200_000_000)
    assert ahead_m(driven, 1_200_000_000) == pytest.approx(2.5 - LASER_X_M, abs=0.01)
    command(driven, car, DriveCommand(0.0, 0.0), 1_200_000_000)
    assert ahead_m(driven, 5_000_000_000) == pytest.approx(2.5 - LASER_X_M, abs=0.015)


def test_each_sample_sees_the_car_where_it_was_then(driven, car):
    command(driven, car, DriveCommand(1.0, 0.0), 0)
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


def test_without_noise_every_ray_measures_the_wall(driven, car):
    exact = DrivenWorld(driven.world, car, Mount(np.zeros(3)), start_ns=0, seed=1, noisy=False)
    ranges = exact(np.full(50, 10_000_000, np.int64), np.zeros(50))
    np.testing.assert_allclose(ranges, 3.0, atol=0.01)


def test_a_mavlink_rover_is_the_car_that_drives(driven):
    """One truth: the rover drives as time passes in the world, and the world's laser sees it."""
    dynamics = RoverDynamics(np.array([1.0, 1.0, 0.0]), EXACT)
    rover = MavlinkRover(dynamics)
    world = DrivenWorld(driven.world, rover, Mount(np.zeros(3)), start_ns=5_000_000_000, seed=1)
    rover.autopilot.set_mode(RoverMode.GUIDED)
    rover.autopilot.set_armed(True)
    rover.autopilot.set_target(0.5, 0.0, 5_000_000_000)
    assert ahead_m(world, 7_000_000_000) == pytest.approx(2.0, abs=0.02)
    np.testing.assert_allclose(world.truth[1][-1], rover.state.pose)
