from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from drivers.emulated_link import EmulatedLink, SimulatedClock
from drivers.errors import DeviceLostError
from drivers.messages import Message
from drivers.rplidar import Rplidar, connect
from drivers.rplidar_emulator import RplidarEmulator
from drivers.rplidar_models import A2M8
from drivers.scan_reader import ScanReader, turn_rate_hz


def wall(times_ns: np.ndarray, theta_rad: np.ndarray) -> np.ndarray:
    return np.full(theta_rad.shape, 3.0)


class Finite:
    """So many messages of a sensor in simulated time, as fast as they are taken, then its end or an error."""

    def __init__(self, count: int, error: Exception | None = None) -> None:
        clock = SimulatedClock(10**9)
        device = RplidarEmulator(A2M8, wall)
        self.lidar: Rplidar = connect(
            lambda baud: EmulatedLink(device, clock, 115200, baud), clock=clock, sleep=clock.sleep
        )
        self.count, self.error = count, error
        self.stopped, self.exhausted = threading.Event(), threading.Event()

    def __iter__(self) -> Iterator[Message]:
        messages = iter(self.lidar)
        for _ in range(self.count):
            yield next(messages)
        self.exhausted.set()
        if self.error is not None:
            raise self.error
        self.stopped.wait(10.0)

    def request_stop(self) -> None:
        self.stopped.set()


class Slow:
    """The same with a moment between its messages, so that a consumer can keep up."""

    def __init__(self, lidar: Finite) -> None:
        self.lidar = lidar
        self.request_stop = lidar.request_stop

    def __iter__(self) -> Iterator[Message]:
        for message in self.lidar:
            time.sleep(0.02)
            yield message


def test_every_scan_in_order_then_the_error() -> None:
    with ScanReader(Finite(200, DeviceLostError("port: gone")), queue_scans=1000) as reader:
        stamps = []

        def take_all() -> None:
            for scan in reader:
                stamps.append(scan.stamp_ns)  # noqa: PERF401 - what came before the error counts

        with pytest.raises(DeviceLostError, match="gone"):
            take_all()
        assert len(stamps) > 20
        assert stamps == sorted(stamps)
        assert reader.dropped == 0


def test_a_slow_consumer_gets_the_newest_and_the_others_are_counted() -> None:
    lidar = Finite(300)
    with ScanReader(lidar, queue_scans=3) as reader:
        assert lidar.exhausted.wait(60.0)
        dropped = reader.dropped
        newest = reader.latest()
        assert newest is not None
        assert reader.latest(0.05) is None
        assert reader.dropped == dropped >= 20
        assert reader.speed_hz == pytest.approx(10.0, rel=0.01)


def test_the_speed_is_that_of_whole_turns_from_the_first_on() -> None:
    speeds = []
    with ScanReader(Slow(Finite(120)), queue_scans=1000) as reader:
        for _ in range(10):
            assert reader.latest(5.0) is not None
            speeds.append(reader.speed_hz)
    assert speeds[0] is None
    measured = [speed for speed in speeds if speed is not None]
    assert len(measured) > 3
    assert measured == pytest.approx([10.0] * len(measured), rel=0.02)


def test_closing_ends_the_iteration_and_may_be_done_twice() -> None:
    reader = ScanReader(Finite(100), queue_scans=1000)
    first = next(iter(reader))
    reader.close()
    reader.close()
    rest = list(reader)
    assert all(scan.stamp_ns > first.stamp_ns for scan in rest)
    assert reader.latest(1.0) is None


def test_an_error_comes_after_the_last_scan() -> None:
    with ScanReader(Finite(100, DeviceLostError("port: gone")), queue_scans=2) as reader:
        while True:
            try:
                scan = reader.latest()
            except DeviceLostError:
                break
            assert scan is not None


def test_the_rate_of_turns() -> None:
    assert turn_rate_hz([0, 100_000_000, 200_000_000, 500_000_000]) == pytest.approx(10.0)
    assert turn_rate_hz([5]) is None
