"""Unplugging and plugging in again, in simulated time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from drivers.emulated_faults import FaultScript, parse_script
from drivers.emulated_link import EmulatedLink, SimulatedClock
from drivers.errors import DeviceLostError, MotorStalledError, PortMissingError, WrongDeviceError
from drivers.messages import LidarStream, Message
from drivers.reconnecting_lidar import ReconnectingLidar, ReconnectPolicy
from drivers.rplidar import Rplidar, connect
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import A2M8

S = 1_000_000_000


def wall(times_ns: np.ndarray, theta_rad: np.ndarray) -> np.ndarray:
    return np.full(theta_rad.shape, 3.0)


class Socket:
    """A place to plug a sensor in; empty until back_ns after a pull."""

    def __init__(self, script: str = "") -> None:
        self.clock = SimulatedClock(S)
        self.device = RplidarEmulator(A2M8, wall, script=FaultScript(parse_script(script)))
        self.link: EmulatedLink | None = None
        self.back_ns = 0
        self.tries = 0
        self.told: list[str] = []
        self.waits: list[float] = []

    def open(self) -> Rplidar:
        self.tries += 1
        if self.clock() < self.back_ns:
            raise PortMissingError("lidar: no such port")
        return connect(self.open_link, clock=self.clock, sleep=self.clock.sleep, baud=115200)

    def open_link(self, baud: int) -> EmulatedLink:
        self.link = EmulatedLink(self.device, self.clock, 115200, baud)
        return self.link

    def pull(self, seconds: float) -> None:
        assert self.link is not None
        self.link.unplug()
        self.back_ns = self.clock() + round(seconds * S)
        self.device.power_up(self.clock())

    def wait(self, seconds: float) -> bool:
        self.waits.append(seconds)
        self.clock.sleep(seconds)
        return False

    def resuming(self, give_up_s: float = 10.0) -> ReconnectingLidar:
        return ReconnectingLidar(
            self.open, ReconnectPolicy(give_up_s), clock=self.clock, wait=self.wait, tell=self.told.append
        )


def read(messages: Iterator[Message], count: int) -> list[Message]:
    return [next(messages) for _ in range(count)]


def test_it_goes_on_in_the_same_mode_after_the_sensor_is_back() -> None:
    socket = Socket()
    with socket.resuming() as lidar:
        lidar.start("Express", 700)
        messages = iter(lidar)
        read(messages, 20)
        socket.pull(3.0)
        later = read(messages, 20)
        streams = [message for message in later if isinstance(message, LidarStream)]
        assert [(stream.mode, stream.stamp_ns > 4 * S) for stream in streams] == [("Express", True)]
        assert lidar.losses == 1
        assert socket.waits == [0.2, 0.4, 0.8, 1.6]
        assert len(socket.told) == 2
        assert "back after 3" in socket.told[1]
        lidar.request_stop()
        assert list(messages) == []


def test_it_gives_up_in_time_and_says_why() -> None:
    socket = Socket()
    with socket.resuming(give_up_s=5.0) as lidar:
        lidar.start()
        messages = iter(lidar)
        read(messages, 5)
        socket.pull(60.0)
        before = socket.clock()
        with pytest.raises(DeviceLostError, match="not back within 5 s: lidar: no such port"):
            list(messages)
        assert 5 * S < socket.clock() - before < 8 * S


def test_without_patience_the_loss_itself_is_raised() -> None:
    socket = Socket()
    with socket.resuming(give_up_s=0.0) as lidar:
        lidar.start()
        messages = iter(lidar)
        read(messages, 5)
        socket.pull(1.0)
        with pytest.raises(DeviceLostError, match="unplugged"):
            list(messages)
    assert (socket.tries, lidar.losses, socket.told) == (1, 0, [])


def test_another_sensor_in_its_place_is_refused() -> None:
    socket = Socket()
    with socket.resuming() as lidar:
        lidar.start()
        messages = iter(lidar)
        read(messages, 5)
        socket.device = RplidarEmulator(replace(A2M8, serial=bytes(16)), wall)
        socket.pull(0.1)
        with pytest.raises(WrongDeviceError, match="another lidar, serial 0000"):
            list(messages)


def test_a_head_that_was_held_turns_on() -> None:
    socket = Socket("motor-stall@2+1.5")
    with socket.resuming() as lidar:
        lidar.start()
        messages = iter(lidar)
        streams = [message for message in read(messages, 250) if isinstance(message, LidarStream)]
        assert len(streams) == 2
        assert lidar.losses == 1


def test_a_head_that_stays_held_is_told_as_such() -> None:
    socket = Socket("motor-stall@2")
    with socket.resuming(give_up_s=0.0) as lidar:
        lidar.start()
        with pytest.raises(MotorStalledError):
            list(lidar)


def test_it_stops_while_it_waits() -> None:
    socket = Socket()
    lidar = socket.resuming()
    with lidar:
        lidar.start()
        messages = iter(lidar)
        read(messages, 5)
        socket.pull(60.0)
        stops = iter([False, False, True])
        lidar._wait = lambda _seconds: next(stops)
        with pytest.raises(DeviceLostError, match="unplugged"):
            list(messages)
