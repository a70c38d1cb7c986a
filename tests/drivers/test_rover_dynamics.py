"""The car's motion against circles, ramps and itself in finer steps."""

import math

import numpy as np
import pytest

from drivers.rover_dynamics import NoisyOdometry, RoverDynamics, RoverModel
from drivers.vehicle import STANDSTILL, DriveCommand

AT_ONCE = RoverModel(steering_rate_radps=1e6, acceleration_mps2=1e6, latency_s=0.0)


@pytest.mark.parametrize(("speed_mps", "curvature_1pm"), [(0.5, 1.0), (0.5, -1.0), (-0.4, 1.5), (0.5, 0.0)])
def test_drives_the_arc_that_was_commanded(speed_mps: float, curvature_1pm: float) -> None:
    start = np.array([1.0, -2.0, 0.7])
    car = RoverDynamics(start, AT_ONCE)
    car.step(0.0, DriveCommand(0.0, curvature_1pm))
    state = car.step(3.0, DriveCommand(speed_mps, curvature_1pm))
    way, turn = speed_mps * 3.0, speed_mps * 3.0 * curvature_1pm
    ahead = math.sin(turn) / curvature_1pm if curvature_1pm else way
    left = (1 - math.cos(turn)) / curvature_1pm if curvature_1pm else 0.0
    cos, sin = math.cos(0.7), math.sin(0.7)
    # The first substep still steers and speeds up: a hundredth of the way at most.
    expected = [1.0 + cos * ahead - sin * left, -2.0 + sin * ahead + cos * left]
    np.testing.assert_allclose(state.pose[:2], expected, atol=0.005)
    assert state.pose[2] == pytest.approx(math.remainder(0.7 + turn, 2 * math.pi), abs=0.01)
    assert state.yaw_rate_radps == pytest.approx(speed_mps * curvature_1pm)


def test_turns_no_tighter_than_its_steering_allows() -> None:
    car = RoverDynamics(np.zeros(3), AT_ONCE)
    state = car.step(1.0, DriveCommand(0.5, 10.0))
    assert state.speed_mps / state.yaw_rate_radps == pytest.approx(0.256 / math.tan(math.radians(30)))


def test_command_takes_hold_after_the_latency_and_braking_takes_its_time() -> None:
    model = RoverModel(acceleration_mps2=1.0, latency_s=0.1)
    car = RoverDynamics(np.zeros(3), model)
    ahead = DriveCommand(0.5, 0.0)
    assert car.step(0.1, ahead).speed_mps == 0.0
    assert car.step(0.5, ahead).speed_mps == pytest.approx(0.5)
    assert car.step(0.1, STANDSTILL).speed_mps == pytest.approx(0.5)
    assert car.step(0.25, STANDSTILL).speed_mps == pytest.approx(0.25)
    before = car.state.pose[0]
    state = car.step(1.0, STANDSTILL)
    assert state.speed_mps == 0.0
    assert state.pose[0] - before == pytest.approx(0.25**2 / 2)


def test_a_wall_stops_the_car_and_counts_once_until_it_comes_free() -> None:
    car = RoverDynamics(np.zeros(3), AT_ONCE, fits=lambda pose: bool(pose[0] <= 0.4))
    for _ in range(200):
        state = car.step(0.01, DriveCommand(0.5, 0.0))
    assert state.pose[0] == pytest.approx(0.4, abs=0.5 * 0.005)
    assert state.speed_mps == 0.0
    assert car.contacts == 1
    assert car.step(0.5, DriveCommand(-0.4, 0.0)).pose[0] == pytest.approx(0.2, abs=0.01)
    assert car.step(1.0, DriveCommand(0.5, 0.0)).speed_mps == 0.0
    assert car.contacts == 2


def test_what_stands_is_not_pushing() -> None:
    car = RoverDynamics(np.zeros(3), AT_ONCE, fits=lambda _pose: False)
    car.step(1.0, DriveCommand(0.0, 1.0))
    assert car.contacts == 0


def test_steering_turns_at_its_rate() -> None:
    car = RoverDynamics(np.zeros(3), RoverModel(steering_rate_radps=2.0, latency_s=0.0))
    assert car.step(0.1, DriveCommand(0.0, 2.0)).steering_rad == pytest.approx(0.2)


def test_how_time_is_cut_changes_little() -> None:
    commands = [DriveCommand(0.5, 1.2), DriveCommand(0.5, -1.2), DriveCommand(-0.4, 0.5)]
    poses = []
    for dt_s in (0.05, 0.01):
        car = RoverDynamics(np.zeros(3))
        for command in commands:
            for _ in range(round(1.0 / dt_s)):
                car.step(dt_s, command)
        poses.append(car.state.pose)
    np.testing.assert_allclose(poses[0], poses[1], atol=1e-9)


def driven(odometry: NoisyOdometry) -> tuple[np.ndarray, np.ndarray]:
    car = RoverDynamics(np.array([3.0, 1.0, 2.0]))
    measured = odometry.measure(0, car.state)
    start = car.state.pose
    for k in range(200):
        measured = odometry.measure(k, car.step(0.02, DriveCommand(0.5, 1.0)))
    x, y = car.state.pose[:2] - start[:2]
    cos, sin = math.cos(start[2]), math.sin(start[2])
    turn = math.remainder(car.state.pose[2] - start[2], 2 * math.pi)
    return measured.pose, np.array([cos * x + sin * y, cos * y - sin * x, turn])


def test_odometry_without_noise_is_the_drive_from_its_start() -> None:
    measured, true = driven(NoisyOdometry(seed=0, way_noise_m=0.0, turn_noise_rad=0.0))
    np.testing.assert_allclose(measured, true, atol=1e-3)


def test_odometry_drifts_by_its_noise_and_the_same_for_a_seed() -> None:
    errors = np.array([measured - true for measured, true in (driven(NoisyOdometry(seed=k)) for k in range(40))])
    np.testing.assert_array_equal(driven(NoisyOdometry(seed=5))[0], driven(NoisyOdometry(seed=5))[0])
    # Way and turn are about 1.9 m and 1.9 rad, so the heading's deviation is about 0.01 * sqrt(3.8).
    assert np.std(errors[:, 2]) == pytest.approx(0.01 * math.sqrt(3.8), rel=0.4)
