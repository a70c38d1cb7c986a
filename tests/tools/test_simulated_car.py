"""One truth: what leaves over the link is what the rover does and what the world's laser sees."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.rover_faults import RoverFaultKind
from drivers.vehicle import DriveCommand
from mapping.mount import Mount
from tools.simulated_car import SimulatedCar
from tools.world import World


@pytest.fixture
def car():
    """A car at (1, 1) that looks at the wall x = 4 m."""
    occupied = np.zeros((150, 250), np.bool_)
    occupied[:, 200:] = True
    return SimulatedCar(World(occupied, 0.02, np.zeros(3)), np.array([1.0, 1.0, 0.0]), Mount(), seed=1)


def drive(car, seconds, speed_mps=0.5):
    for _ in range(round(seconds / 0.05)):
        car.vehicle.drive(DriveCommand(speed_mps, 0.0))
        car.vehicle.poll()
        car.clock.sleep(0.05)


def test_setpoints_are_noted_driven_and_seen(car):
    with car.vehicle as vehicle:
        vehicle.arm()
        drive(car, 3.0)
        now_ns = car.clock()
        ahead = car.world(np.full(300, now_ns, np.int64), np.zeros(300))
    driven_m = car.rover.state.pose[0] - 1.0
    assert driven_m == pytest.approx(0.5 * (3.0 - 0.1) - 0.5**2 / 1.5 / 2.0, abs=0.03)
    assert ahead[ahead > 0.0].mean() == pytest.approx(3.0 - driven_m, abs=0.03)
    moving = [speed for _, speed in car.sent if speed]
    assert set(moving) == {0.5}
    assert len(moving) >= 60


def test_the_truth_is_even_though_the_link_moves_the_rover(car):
    """Each pose of the truth is that of its stamp, also where the rover was asked for its telemetry first."""
    with car.vehicle as vehicle:
        vehicle.arm()
        drive(car, 3.0)
        car.world.advance(car.clock())
    _, poses, speeds = car.world.truth
    np.testing.assert_allclose(np.diff(poses[:, 0]), 0.005 * (speeds[1:] + speeds[:-1]), atol=2e-5)


@pytest.mark.parametrize("kind", [RoverFaultKind.DEAF, RoverFaultKind.CUT])
def test_a_fault_may_begin_at_any_time(car, kind):
    with car.vehicle as vehicle:
        vehicle.arm()
        drive(car, 1.5)
        sent = len(car.sent)
        car.rover.begin(kind)
        drive(car, 0.3, 0.0)
        assert len(car.sent) > sent  # it left
        car.world.advance(car.clock())
        assert car.rover.state.speed_mps == pytest.approx(0.5)  # and was not heard
