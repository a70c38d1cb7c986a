"""The QCar adapter on a fake of Quanser's API; never on a car."""

import math

import numpy as np
import pytest

from drivers.emulated_link import SimulatedClock
from drivers.errors import SilentPortError
from drivers.messages import Imu, Odometry
from drivers.qcar_vehicle import METRES_PER_COUNT, QcarSettings, QcarVehicle, SpeedControl
from drivers.vehicle import ArmingRefusedError, DriveCommand, VehicleState
from tests.drivers.fake_qcar import FakeQcar


class Car:
    def __init__(self, **options: float) -> None:
        self.clock = SimulatedClock(1_000_000_000)
        self.board = FakeQcar(self.clock, **options)
        self.vehicle = QcarVehicle(self.clock, board=lambda: self.board)
        self.heard: list = []

    def poll(self, seconds: float, command: DriveCommand | None = None) -> None:
        for _ in range(round(seconds / 0.02)):
            if command is not None:
                self.vehicle.drive(command)
            self.heard += self.vehicle.poll()
            self.clock.sleep(0.02)


def test_a_turn_of_the_wheel_is_its_circumference() -> None:
    motor_turns = 70 * 37 / (13 * 19)
    assert 2880 * motor_turns * METRES_PER_COUNT == pytest.approx(2 * math.pi * 0.033)


@pytest.mark.parametrize(("speed_mps", "curvature_1pm"), [(0.5, 1.0), (-0.3, 1.0), (0.2, -2.0)])
def test_reaches_speed_and_curve_in_both_directions(speed_mps: float, curvature_1pm: float) -> None:
    car = Car()
    with car.vehicle as vehicle:
        vehicle.arm()
        car.poll(3.0, DriveCommand(speed_mps, curvature_1pm))
        assert car.board.speed_mps == pytest.approx(speed_mps, rel=0.03)
        assert car.board.yaw_rate_radps == pytest.approx(speed_mps * curvature_1pm, rel=0.03)


def test_keeps_to_its_limits() -> None:
    car = Car()
    with car.vehicle as vehicle:
        vehicle.arm()
        car.poll(3.0, DriveCommand(2.0, 9.0))
        assert car.board.speed_mps == pytest.approx(0.5, rel=0.03)
        assert car.board.steering_rad == pytest.approx(math.radians(30))


def test_odometry_follows_the_car_and_learns_the_gyroscopes_zero() -> None:
    car = Car(gyro_zero=0.05)
    with car.vehicle as vehicle:
        car.poll(5.0)
        vehicle.arm()
        car.poll(4.0, DriveCommand(0.4, 0.5))
    odometry = [message for message in car.heard if isinstance(message, Odometry)][-1]
    yaw = car.board.yaw_rad
    assert odometry.pose[2] == pytest.approx(yaw, abs=0.02)
    np.testing.assert_allclose(odometry.pose[:2], [math.sin(yaw) / 0.5, (1 - math.cos(yaw)) / 0.5], atol=0.03)
    assert any(isinstance(message, Imu) for message in car.heard)


@pytest.mark.parametrize("how", ["stop", "emergency_stop", "disarm"])
def test_stops_at_once_and_until_armed(how: str) -> None:
    car, ahead = Car(), DriveCommand(0.5, 0.0)
    with car.vehicle as vehicle:
        vehicle.arm()
        car.poll(1.0, ahead)
        getattr(vehicle, how)()
        assert car.board.throttle == 0.0
        car.poll(1.0, ahead)
        assert car.board.speed_mps == 0.0
        assert not [m for m in car.heard if isinstance(m, VehicleState)][-1].ready
        vehicle.arm()
        car.poll(1.0, ahead)
        assert car.board.speed_mps > 0.4


def test_a_command_lives_half_a_second() -> None:
    car = Car()
    with car.vehicle as vehicle:
        vehicle.arm()
        car.poll(1.0, DriveCommand(0.5, 0.0))
        car.poll(0.4)
        assert car.board.throttle > 0.0
        car.poll(0.2)
        assert car.board.throttle == 0.0


def test_leaving_stops_the_motor_and_releases_the_board() -> None:
    car = Car()
    with car.vehicle as vehicle:
        vehicle.arm()
        car.poll(1.0, DriveCommand(0.5, 0.0))
    assert (car.board.throttle, car.board.terminated) == (0.0, True)


def test_typed_errors() -> None:
    with pytest.raises(SilentPortError, match="0 V"), Car(volts=0.0).vehicle:
        pass
    with Car(volts=10.0).vehicle as vehicle, pytest.raises(ArmingRefusedError, match="charge it"):
        vehicle.arm()


def test_speed_control_does_not_wind_up() -> None:
    control = SpeedControl(QcarSettings())
    for _ in range(500):
        assert control.throttle(0.5, 0.0, 0.02) <= 0.3  # a held car
    for _ in range(60):  # once let go, it is back from the limit within about a second
        throttle = control.throttle(0.5, 0.8, 0.02)
    assert throttle == 0.0
