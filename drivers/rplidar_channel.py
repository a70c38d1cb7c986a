"""Questions and answers over a byte link that may hold stale bytes, a boot banner or a scan that still runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from drivers.errors import SilentPortError, WrongBaudError
from drivers.rplidar_protocol import Answer, Command, DeviceInfo, find_descriptor, parse_info, request
from drivers.sources import ByteLink

PROBE_BAUDS = (115200, 256000)  # A2M8 and older; A2M7, A2M12
ANSWER_TIMEOUT_S = 0.5
_QUIET_S = 0.03  # so long without a byte: the line is silent
_STOP_SETTLE_S = 0.005  # the device needs 1 ms to obey a stop
_REMEMBERED_BYTES = 4096  # how far back a descriptor is searched in a line that never falls silent


class RplidarChannel:
    """Requests and their answers on a link; clock gives monotonic ns, sleep takes seconds."""

    def __init__(self, link: ByteLink, clock: Callable[[], int], sleep: Callable[[float], None]) -> None:
        self.link = link
        self.bytes_heard = 0
        self._clock = clock
        self._sleep = sleep

    def quieten(self, limit_s: float = 0.5) -> bool:
        """Stop any scan and drop what arrives until the line is silent; False if it is not within limit_s."""
        self.link.write(request(Command.STOP))
        self._sleep(_STOP_SETTLE_S)
        return self.drain(limit_s)

    def drain(self, limit_s: float) -> bool:
        """Drop bytes until the line is silent; False if it is not within limit_s."""
        deadline = self._clock() + round(limit_s * 1e9)
        while self._clock() < deadline:
            data = self.link.read(_QUIET_S)
            if not data:
                return True
            self.bytes_heard += len(data)
        return False

    def ask(
        self,
        question: bytes,
        kind: int,
        size: int | None = None,
        *,
        attempts: int = 3,
        timeout_s: float = ANSWER_TIMEOUT_S,
        prefix: bytes = b"",
    ) -> bytes | None:
        """Send question until its single answer arrives: the payload, of `size` bytes if given; None if none came.

        prefix: what the payload begins with, to tell the answer from a late one to an earlier question.
        """

        def find(heard: bytes) -> bytes | None:
            return _find_answer(heard, kind, size, prefix)

        return self._insist(question, find, attempts, timeout_s)

    def begin(self, question: bytes, kind: int, size: int, *, attempts: int = 3) -> bytes | None:
        """Send question until its endless answer begins: the bytes behind the descriptor so far; None if none came."""

        def find(heard: bytes) -> bytes | None:
            found = find_descriptor(heard, kind, repeats=True, size=size)
            return None if found is None else heard[found[1] :]

        return self._insist(question, find, attempts, ANSWER_TIMEOUT_S)

    def _insist(
        self, question: bytes, find: Callable[[bytes], bytes | None], attempts: int, timeout_s: float
    ) -> bytes | None:
        for _ in range(attempts):
            answer = self._await(question, find, timeout_s)
            if answer is not None:
                return answer
            self.quieten()
        return None

    def _await(self, question: bytes, find: Callable[[bytes], bytes | None], timeout_s: float) -> bytes | None:
        self.link.write(question)
        deadline = self._clock() + round(timeout_s * 1e9)
        heard = b""
        while (left_ns := deadline - self._clock()) > 0:
            data = self.link.read(left_ns * 1e-9)
            self.bytes_heard += len(data)
            heard = (heard + data)[-_REMEMBERED_BYTES:]
            answer = find(heard)
            if answer is not None:
                return answer
        return None


def _find_answer(heard: bytes, kind: int, size: int | None, prefix: bytes) -> bytes | None:
    at = 0
    while (found := find_descriptor(heard[at:], kind, size=size)) is not None:
        descriptor, start = found
        payload = heard[at + start : at + start + descriptor.size]
        if len(payload) == descriptor.size and payload.startswith(prefix):
            return payload
        at += start
    return None


def probe_baud(channel: RplidarChannel, bauds: Sequence[int], port: str) -> tuple[int, DeviceInfo]:
    """The speed, of those given, at which the sensor answers GET_INFO, and its answer; the link is at bauds[0]."""
    channel.link.set_dtr(False)
    for place, baud in enumerate(bauds):
        if place:
            channel.link.set_baud(baud)
        channel.quieten()
        answer = channel.ask(request(Command.GET_INFO), Answer.INFO, 20, attempts=2)
        if answer is not None:
            return baud, parse_info(answer)
    tried = " and ".join(str(baud) for baud in bauds)
    omit = "omit the baud rate to try the usual ones, " if len(bauds) == 1 else ""
    if channel.bytes_heard:
        raise WrongBaudError(
            f"{port}: {channel.bytes_heard} bytes at {tried} baud make no sense as an RPLIDAR's: {omit}"
            f"an A2M8 runs at 115200, an A2M7 or A2M12 at 256000; or another device is on this port"
        )
    raise SilentPortError(
        f"{port}: nothing answers at {tried} baud: {omit}check that this is the lidar's port and its 5 V, 1.5 A supply"
    )
