"""What is sent when, on a simulated clock; the link's other end keeps each setpoint."""

from __future__ import annotations

import pytest

from drivers.emulated_link import EmulatedLink, SimulatedClock
from drivers.mavlink_codec import MavlinkCodec
from drivers.mavlink_link import MavlinkLink
from drivers.mavlink_setpoints import Setpoints
from drivers.mavlink_settings import MavlinkSettings
from drivers.vehicle import DriveCommand

AHEAD = DriveCommand(0.5, 0.2)


class Ear:
    """A device that keeps the speeds that it is sent."""

    def __init__(self) -> None:
        self.codec = MavlinkCodec(1, 1)
        self.speeds: list[float] = []

    def receive(self, data: bytes, now_ns: int) -> bytes:
        self.speeds += [message.vx for message in self.codec.decode(data)]
        return b""

    def due(self, now_ns: int) -> bytes:
        return b""


class Bench:
    def __init__(self) -> None:
        self.clock, self.ear = SimulatedClock(1_000_000_000), Ear()
        link = MavlinkLink(EmulatedLink(self.ear, self.clock, 115200, 115200), self.clock)
        self.setpoints = Setpoints(link, self.clock, MavlinkSettings())

    def run(self, seconds: float) -> list[float]:
        """The speeds that are sent meanwhile."""
        first = len(self.ear.speeds)
        for _ in range(round(seconds / 0.01)):
            self.clock.sleep(0.01)
            self.setpoints.repeat()
        return self.ear.speeds[first:]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_not_engaged_nothing_is_sent(bench: Bench) -> None:
    bench.setpoints.drive(AHEAD)
    assert bench.run(1.0) == []


def test_a_command_lives_for_half_a_second(bench: Bench) -> None:
    bench.setpoints.engage()
    bench.setpoints.drive(AHEAD)
    assert set(bench.run(0.49)) == {0.5}
    bench.run(0.05)
    later = bench.run(2.0)
    assert set(later) == {0.0}
    assert len(later) == pytest.approx(40, abs=2)


def test_held_it_stands_and_then_goes_on(bench: Bench) -> None:
    bench.setpoints.engage()
    bench.setpoints.held = True
    bench.setpoints.drive(AHEAD)
    assert set(bench.run(0.3)) == {0.0}
    bench.setpoints.held = False
    assert set(bench.run(0.1)) == {0.5}


def test_a_burst_comes_at_once_and_standstill_for_a_second_after_it(bench: Bench) -> None:
    bench.setpoints.engage()
    bench.setpoints.drive(AHEAD)
    bench.setpoints.disengage()
    bench.setpoints.burst()
    assert bench.ear.speeds[1:] == [0.0] * 3
    assert set(bench.run(1.0)) == {0.0}
    assert bench.run(1.0) == []


def test_engaged_anew_an_old_command_is_forgotten(bench: Bench) -> None:
    bench.setpoints.engage()
    bench.setpoints.drive(AHEAD)
    bench.setpoints.disengage()
    bench.setpoints.engage()
    assert set(bench.run(0.3)) == {0.0}
