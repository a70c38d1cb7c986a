"""The car that is none, and commands."""

import math

import pytest

from drivers.errors import DriverError
from drivers.vehicle import STANDSTILL, DriveCommand, LostVehicleError, NullVehicle, VehicleState


def test_yaw_rate_is_the_speed_on_the_arc() -> None:
    # A circle of radius 2 m, backwards with the wheels to the right: the car turns left, once a round.
    command = DriveCommand(-0.5, -1 / 2.0)
    circle_s = 2 * math.pi * 2.0 / 0.5
    assert command.yaw_rate_radps == pytest.approx(2 * math.pi / circle_s)


@pytest.mark.parametrize("values", [(math.nan, 0.0), (0.0, math.inf)])
def test_commands_that_are_no_numbers_are_refused(values: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="expected finite values"):
        DriveCommand(*values)


def test_errors_of_the_link_are_errors_of_a_device() -> None:
    assert issubclass(LostVehicleError, DriverError)


def test_no_car_keeps_commands_only_while_it_is_armed() -> None:
    car, ahead = NullVehicle(lambda: 7), DriveCommand(0.3, 0.1)
    with car:
        car.drive(ahead)
        assert car.command == STANDSTILL
        car.arm()
        car.drive(ahead)
        assert car.command == ahead
        car.emergency_stop()
        car.drive(ahead)
        assert car.command == STANDSTILL
        car.arm()
        car.drive(ahead)
        assert car.command == ahead
    assert car.command == STANDSTILL


def test_no_car_tells_its_state_when_it_changes() -> None:
    with NullVehicle(lambda: 7) as car:
        assert [message.reason for message in car.poll() if isinstance(message, VehicleState)] == ["not armed"]
        assert car.poll() == ()
        car.arm()
        (state,) = car.poll()
        assert state == VehicleState(7, armed=True, mode="none", ready=True)
