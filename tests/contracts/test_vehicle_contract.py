"""What holds for every car: none, MAVLink over an emulated rover, and the QCar over a fake of its API."""

import time
from collections.abc import Callable

import numpy as np
import pytest

from drivers.emulated_link import EmulatedLink, SimulatedClock
from drivers.errors import DriverError
from drivers.mavlink_rover import MavlinkRover
from drivers.mavlink_vehicle import MavlinkVehicle
from drivers.messages import Imu, LaserScan, Odometry
from drivers.qcar_vehicle import QcarVehicle
from drivers.rover_dynamics import RoverDynamics
from drivers.vehicle import DriveCommand, NullVehicle, Vehicle, VehicleState
from tests.drivers.fake_qcar import FakeQcar

AHEAD = DriveCommand(0.4, 0.5)


class Bench:
    """A car, its clock, and how fast it really goes."""

    def __init__(self, kind: str) -> None:
        self.clock = SimulatedClock(3_000_000_000)
        self.vehicle: Vehicle
        self._move: Callable[[int], object] | None
        self._speed: Callable[[], float]
        if kind == "none":
            none = self.vehicle = NullVehicle(self.clock)
            self._move, self._speed = None, lambda: none.command.speed_mps
        elif kind == "mavlink":
            rover = MavlinkRover(RoverDynamics(np.zeros(3)))
            self.vehicle = MavlinkVehicle("rover", lambda: EmulatedLink(rover, self.clock, 115200, 115200), self.clock)
            self._move, self._speed = rover.pass_time, lambda: rover.state.speed_mps
        else:
            board = FakeQcar(self.clock)
            self.vehicle = QcarVehicle(self.clock, board=lambda: board)
            self._move, self._speed = lambda _: board.read(), lambda: board.speed_mps
        self.heard: list = []

    def speed_mps(self) -> float:
        """The true speed now."""
        if self._move is not None:
            self._move(self.clock())
        return self._speed()

    def poll(self, seconds: float, command: DriveCommand | None = None) -> None:
        for _ in range(round(seconds / 0.02)):
            if command is not None:
                self.vehicle.drive(command)
            self.heard += self.vehicle.poll()
            self.clock.sleep(0.02)

    @property
    def state(self) -> VehicleState:
        return [message for message in self.heard if isinstance(message, VehicleState)][-1]


@pytest.fixture(params=["none", "mavlink", "qcar"])
def bench(request) -> Bench:
    return Bench(request.param)


def test_not_armed_it_does_not_move(bench: Bench) -> None:
    with bench.vehicle:
        bench.poll(1.0, AHEAD)
        assert bench.speed_mps() == 0.0
        assert not bench.state.ready
        assert bench.state.reason


def test_armed_it_drives_as_commanded_and_says_that_it_is_ready(bench: Bench) -> None:
    with bench.vehicle as vehicle:
        vehicle.arm()
        bench.poll(2.0, AHEAD)
        assert bench.speed_mps() == pytest.approx(0.4, rel=0.05)
        assert bench.state == VehicleState(bench.state.stamp_ns, armed=True, mode=bench.state.mode, ready=True)


@pytest.mark.parametrize("how", ["emergency_stop", "disarm"])
def test_stopped_it_stands_whatever_is_commanded_until_armed_again(bench: Bench, how: str) -> None:
    with bench.vehicle as vehicle:
        vehicle.arm()
        bench.poll(1.0, AHEAD)
        getattr(vehicle, how)()
        bench.poll(1.5, AHEAD)
        assert bench.speed_mps() == 0.0
        assert not bench.state.ready
        vehicle.arm()
        bench.poll(2.0, AHEAD)
        assert bench.speed_mps() == pytest.approx(0.4, rel=0.05)


def test_stop_stands(bench: Bench) -> None:
    with bench.vehicle as vehicle:
        vehicle.arm()
        bench.poll(1.0, AHEAD)
        vehicle.stop()
        bench.poll(1.5)
        assert bench.speed_mps() == 0.0


def test_leaving_stops_and_it_opens_again(bench: Bench) -> None:
    for _ in range(2):
        with bench.vehicle as vehicle:
            vehicle.arm()
            bench.poll(1.0, AHEAD)
        bench.clock.sleep(1.5)
        assert bench.speed_mps() == 0.0


def test_stamps_rise_and_shapes_are_right(bench: Bench) -> None:
    with bench.vehicle as vehicle:
        vehicle.arm()
        bench.poll(2.0, AHEAD)
    for kind in (Odometry, Imu):
        stamps = [message.stamp_ns for message in bench.heard if isinstance(message, kind)]
        assert np.all(np.diff(stamps) > 0)
        assert not stamps or stamps[-1] == pytest.approx(bench.clock(), abs=2e8)


def test_calls_that_must_not_block_let_no_time_pass(bench: Bench) -> None:
    scan = LaserScan(0, np.zeros(200), np.ones(200), np.zeros(200), 0.15, 12.0)
    with bench.vehicle as vehicle:
        vehicle.arm()
        vehicle.poll()
        calls = (
            lambda: vehicle.drive(AHEAD),
            vehicle.poll,
            lambda: vehicle.tell_pose(0, np.zeros(3), np.zeros(3), jumped=True),
            lambda: vehicle.tell_scan(scan, np.zeros(3)),
            vehicle.stop,
            vehicle.emergency_stop,
        )
        before = bench.clock()
        shortest_s = []
        for call in calls:
            began = time.perf_counter()
            call()
            shortest_s.append(time.perf_counter() - began)
        assert bench.clock() == before
        assert sorted(shortest_s)[len(calls) // 2] < 0.005  # the median: a busy computer may hold one up


def test_outside_its_context_a_real_car_is_not_there(bench: Bench) -> None:
    if isinstance(bench.vehicle, NullVehicle):
        assert bench.vehicle.poll() == ()
    else:
        with pytest.raises(DriverError, match="with block"):
            bench.vehicle.poll()
