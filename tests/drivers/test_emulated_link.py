from __future__ import annotations

import pytest

from drivers.emulated_link import EmulatedLink, SimulatedClock
from drivers.errors import DeviceLostError


class Echo:
    """Answers at once, and once a second of its own accord."""

    def __init__(self) -> None:
        self.heard: list[bytes] = []
        self.next_ns = 1_000_000_000

    def receive(self, data: bytes, now_ns: int) -> bytes:
        self.heard.append(data)
        return data

    def due(self, now_ns: int) -> bytes:
        if now_ns < self.next_ns:
            return b""
        self.next_ns += 1_000_000_000
        return b"tick"


def test_waiting_lets_time_pass_until_the_first_byte() -> None:
    clock = SimulatedClock()
    link = EmulatedLink(Echo(), clock, 115200, 115200)
    assert link.read(0.25) == b""
    assert clock() == 250_000_000
    assert link.read(5.0) == b"tick"
    assert clock() == 1_000_000_000


def test_the_speeds_must_agree() -> None:
    device = Echo()
    link = EmulatedLink(device, SimulatedClock(), 115200, 256000)
    link.write(b"hello")
    assert device.heard[0] != b"hello"
    link.set_baud(115200)
    assert link.read(0.0) == b""
    link.write(b"hello")
    assert link.read(0.0) == b"hello"


def test_unplugged_and_closed() -> None:
    for end in (EmulatedLink.unplug, EmulatedLink.close):
        link = EmulatedLink(Echo(), SimulatedClock(), 115200, 115200)
        end(link)
        with pytest.raises(DeviceLostError):
            link.read(0.1)
        with pytest.raises(DeviceLostError):
            link.write(b"x")
