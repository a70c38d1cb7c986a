from __future__ import annotations

from drivers.emulated_link import EmulatedLink, SimulatedClock
from drivers.rplidar_channel import RplidarChannel
from drivers.rplidar_protocol import Answer, Command, Descriptor, request

INFO = Descriptor(20, False, Answer.INFO).encode() + bytes(range(20))


class Scripted:
    """Answers the nth question with the nth text; chatters every 10 ms if told to."""

    def __init__(self, *answers: bytes, chatter: bytes = b"") -> None:
        self.answers = list(answers)
        self.chatter = chatter
        self.next_ns = 0

    def receive(self, data: bytes, now_ns: int) -> bytes:
        if data == request(Command.STOP):
            return b""
        return self.answers.pop(0) if self.answers else b""

    def due(self, now_ns: int) -> bytes:
        if now_ns < self.next_ns:
            return b""
        self.next_ns = now_ns + 10_000_000
        return self.chatter


def channel(device: Scripted) -> tuple[RplidarChannel, SimulatedClock]:
    clock = SimulatedClock()
    return RplidarChannel(EmulatedLink(device, clock, 115200, 115200), clock, clock.sleep), clock


def ask(device: Scripted) -> bytes | None:
    return channel(device)[0].ask(request(Command.GET_INFO), Answer.INFO, 20)


def test_the_answer_is_found_behind_stale_bytes() -> None:
    assert ask(Scripted(b"\xa5\x5a\x03\0\0\0\x06\0\0\0 noise" + INFO)) == bytes(range(20))


def test_a_lost_or_cut_answer_is_asked_for_again() -> None:
    assert ask(Scripted(b"", INFO[:15], INFO)) == bytes(range(20))


def test_no_answer() -> None:
    assert ask(Scripted()) is None


def test_a_line_that_never_falls_silent_does_not_hang() -> None:
    link, clock = channel(Scripted(chatter=b"x"))
    assert not link.quieten(0.5)
    assert 0.5e9 <= clock() < 0.7e9
    assert link.bytes_heard > 0


def test_the_bytes_behind_a_stream_s_descriptor_are_kept() -> None:
    device = Scripted(Descriptor(84, True, Answer.EXPRESS).encode() + b"first")
    assert channel(device)[0].begin(b"\xa5\x82", Answer.EXPRESS, 84) == b"first"
