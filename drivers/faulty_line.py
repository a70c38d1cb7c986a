"""A bad line between an emulated device and its host: bytes flipped, lost, held back, cut into pieces or late."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from drivers.emulated_faults import FaultKind, FaultScript
from drivers.emulated_link import PoweredDevice
from drivers.uart import BITS_PER_BYTE


class FaultyLine:
    """The device behind it as the host hears it; what the host sends arrives unharmed.

    Which bytes are hit depends on their number and the seed, not on how often the line is asked.
    """

    def __init__(self, device: PoweredDevice, script: FaultScript, baud: int) -> None:
        self._device = device
        self._script = script
        self._byte_ns = BITS_PER_BYTE * 1e9 / baud
        self._random = {kind: np.random.default_rng((script.seed, place)) for place, kind in enumerate(FaultKind)}
        self._held: deque[tuple[float, bytes]] = deque()  # from when on (ns) which bytes may be read, in order
        self._free_ns = -math.inf  # nothing that follows may be read before

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Pass on what the host sends; return what it may read by now."""
        answer = self._device.receive(data, now_ns)
        slow = self._script.active(FaultKind.SLOW, now_ns)
        self._send(answer, now_ns, 0.0 if slow is None else slow.numbers[0] * 1e9)
        return self._arrived(now_ns)

    def due(self, now_ns: int) -> bytes:
        """What the host may read by now."""
        self._send(self._device.due(now_ns), now_ns, 0.0)
        return self._arrived(now_ns)

    def power_up(self, now_ns: int) -> None:
        """The device was unplugged: what was under way is gone."""
        self._held.clear()
        self._free_ns = -math.inf
        self._device.power_up(now_ns)

    def _send(self, data: bytes, now_ns: int, late_ns: float) -> None:
        if not data or self._script.active(FaultKind.SILENCE, now_ns) is not None:
            return
        data = self._damaged(data, now_ns)
        chunk = self._script.active(FaultKind.CHUNK, now_ns)
        size = len(data) if chunk is None else int(chunk.numbers[0])
        for at in range(0, len(data), max(size, 1)):
            piece = data[at : at + size]
            free_ns = self._when(now_ns + late_ns + (at * self._byte_ns if chunk else 0.0), now_ns)
            self._free_ns = max(self._free_ns, free_ns)
            self._held.append((self._free_ns, piece))

    def _when(self, at_ns: float, now_ns: int) -> float:
        """When a byte that reaches the adapter at a time may be read."""
        latency = self._script.active(FaultKind.LATENCY, now_ns)
        if latency is not None and latency.numbers[0] > 0:
            period_ns = latency.numbers[0] * 1e9
            at_ns = math.ceil(at_ns / period_ns) * period_ns
        stall = self._script.active(FaultKind.STALL, now_ns)
        return at_ns if stall is None else max(at_ns, self._script.span_ns(stall)[1])

    def _damaged(self, data: bytes, now_ns: int) -> bytes:
        octets = np.frombuffer(data, dtype=np.uint8)
        flip = self._script.active(FaultKind.FLIP, now_ns)
        if flip is not None:
            drawn = self._random[FaultKind.FLIP].random((len(octets), 2))
            bits = np.left_shift(1, (drawn[:, 1] * 8).astype(np.int64)).astype(np.uint8)
            octets = np.where(drawn[:, 0] < flip.numbers[0], octets ^ bits, octets)
        drop = self._script.active(FaultKind.DROP, now_ns)
        if drop is not None:
            octets = octets[self._random[FaultKind.DROP].random(len(octets)) >= drop.numbers[0]]
        return octets.tobytes()

    def _arrived(self, now_ns: int) -> bytes:
        arrived = b""
        while self._held and self._held[0][0] <= now_ns:
            arrived += self._held.popleft()[1]
        return arrived
