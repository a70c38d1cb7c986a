"""What leaves our end, as pymavlink reads it."""

import math

import numpy as np
import pytest

from drivers.emulated_link import SimulatedClock
from drivers.errors import LinkFullError
from drivers.mavlink_codec import MavlinkCodec
from drivers.mavlink_constants import Command
from drivers.mavlink_link import MavlinkLink
from drivers.messages import LaserScan
from drivers.vehicle import DriveCommand

POSE, STILL = np.array([1.0, 2.0, 0.5]), np.zeros(3)


class Wire:
    """Keeps what is written; full: takes nothing."""

    def __init__(self) -> None:
        self.codec = MavlinkCodec(1, 1)
        self.sent: list = []
        self.incoming = b""
        self.full = False

    def read(self, timeout_s: float) -> bytes:
        data, self.incoming = self.incoming, b""
        return data

    def write(self, data: bytes) -> None:
        if self.full:
            raise LinkFullError("full")
        self.sent += self.codec.decode(data)

    def set_baud(self, baud: int) -> None: ...

    def set_dtr(self, asserted: bool) -> None: ...

    def set_rts(self, asserted: bool) -> None: ...

    def close(self) -> None: ...


@pytest.fixture
def wire() -> Wire:
    return Wire()


@pytest.fixture
def clock() -> SimulatedClock:
    return SimulatedClock(1_000_000_000)


@pytest.fixture
def link(wire, clock) -> MavlinkLink:
    link = MavlinkLink(wire, clock)
    link.target = (1, 1)
    return link


def kinds(wire: Wire) -> list[str]:
    return [message.get_type() for message in wire.sent]


def test_a_heartbeat_a_second_as_the_companion_that_the_failsafe_watches(link, wire, clock) -> None:
    for _ in range(51):
        link.exchange(0.0)
        clock.sleep(0.05)
    assert kinds(wire) == ["HEARTBEAT"] * 3
    heartbeat = wire.sent[0]
    assert (heartbeat.get_srcSystem(), heartbeat.get_srcComponent(), heartbeat.type) == (255, 191, 18)


def test_own_echo_is_not_heard(link, wire) -> None:
    wire.incoming = link.codec.encode("PARAM_REQUEST_LIST", target_system=1, target_component=1)
    wire.incoming += wire.codec.encode("PARAM_REQUEST_LIST", target_system=1, target_component=1)
    assert [message.get_srcSystem() for message in link.exchange(0.0)] == [1]


def test_setpoint_to_the_left_and_backwards(link, wire) -> None:
    link.setpoint(DriveCommand(0.5, 0.8))
    link.setpoint(DriveCommand(-0.5, 0.8))
    ahead, back = wire.sent
    assert (ahead.coordinate_frame, ahead.type_mask, ahead.target_system) == (8, 1511, 1)
    assert (ahead.vx, ahead.vy) == (0.5, 0.0)
    assert ahead.yaw_rate == pytest.approx(-0.4)  # left is counter-clockwise, which MAVLink counts as negative
    assert (back.vx, back.yaw_rate) == (-0.5, pytest.approx(0.4))


def test_pose_and_its_jumps(link, wire) -> None:
    link.odometry(POSE, np.array([0.3, 0.0, 0.2]), 0)
    link.odometry(POSE, STILL, 257)
    first, second = wire.sent
    assert (first.x, first.y, first.z) == (1.0, -2.0, 0.0)
    assert 2 * math.atan2(first.q[3], first.q[0]) == pytest.approx(-0.5)
    assert (first.vx, first.yawspeed) == (pytest.approx(0.3), pytest.approx(-0.2))
    assert (first.frame_id, first.child_frame_id, first.estimator_type) == (20, 12, 7)
    assert (first.reset_counter, second.reset_counter) == (0, 1)


def test_obstacles(link, wire) -> None:
    link.obstacles(LaserScan(0, np.array([math.pi / 2]), np.array([2.0]), STILL[:1], 0.15, 12.0), STILL)
    (message,) = wire.sent
    assert (message.distances[54], message.distances[0]) == (200, 65535)
    assert (message.min_distance, message.max_distance, message.increment, message.frame) == (15, 1200, 5, 12)


def test_commands_and_their_attempts(link, wire) -> None:
    link.command(Command.ARM_DISARM, 1.0, attempt=2)
    (message,) = wire.sent
    assert (message.command, message.param1, message.param7, message.confirmation) == (400, 1.0, 0.0, 2)


def test_on_a_slow_line_telemetry_yields_and_commands_do_not(wire, clock) -> None:
    link = MavlinkLink(wire, clock, bytes_per_s=5760)
    for _ in range(100):  # 10 s, at 20 Hz each
        for _ in range(2):
            link.setpoint(DriveCommand(0.1, 0.0))
            link.odometry(POSE, STILL, 0)
            clock.sleep(0.05)
    assert kinds(wire).count("SET_POSITION_TARGET_LOCAL_NED") == 200
    assert 100 <= kinds(wire).count("ODOMETRY") <= 0.6 * 5760 * 10.5 / 244


def test_a_full_line_costs_the_message_and_no_error(link, wire) -> None:
    wire.full = True
    link.setpoint(DriveCommand(0.1, 0.0))
    wire.full = False
    link.setpoint(DriveCommand(0.2, 0.0))
    assert [message.vx for message in wire.sent] == [pytest.approx(0.2)]
    assert link.unsent == 1
