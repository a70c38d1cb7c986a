"""Where the measurement packets lie in a stream of bytes, with resynchronisation after damage.

What is decided at a byte depends on the bytes before and after it, never on how they were cut into reads: where more
bytes are needed to decide, the search stops and is resumed at that byte.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from drivers.rplidar_capsules import Flags, IntArray, Packets, as_packets
from drivers.rplidar_node_tracking import find_nodes, fresh_state
from drivers.rplidar_protocol import PACKET_BYTES, Answer


class PacketRun(NamedTuple):
    """Consecutive sound packets: the byte where they begin, how many, and their bytes. A tuple: one a read at least."""

    start: int
    length: int
    data: bytes

    @property
    def end(self) -> int:
        """The byte after the last packet."""
        return self.start + len(self.data)

    @property
    def packets(self) -> Packets:
        """The packets as (length, size)."""
        return as_packets(self.data, len(self.data) // self.length)


class Framing(NamedTuple):
    """The runs found, and how many bytes are settled: the rest waits for more and is to be given again."""

    runs: list[PacketRun]
    used: int


class PacketFinder:
    """Finds the packets of one stream, which begins with a packet."""

    def __init__(self, kind: Answer) -> None:
        self._kind = kind
        self._size = PACKET_BYTES[kind]
        self._nodes = fresh_state()
        self._in_step = np.ones(1, dtype=np.bool_)  # does the pending byte follow on a sound capsule?
        self._runs = np.empty((64, 2), dtype=np.int64)

    def find(self, pending: bytes) -> Framing:
        """All sound packets in the bytes that are not settled yet."""
        most = len(pending) // self._size + 1
        if most > len(self._runs):
            self._runs = np.empty((most, 2), dtype=np.int64)
        if self._kind == Answer.NODES:
            count, used = find_nodes(pending, self._nodes, self._runs)
        else:
            count, used = find_capsules(pending, self._size, self._in_step, self._runs)
        found = [
            PacketRun(start, packets, pending[start : start + packets * self._size])
            for start, packets in self._runs[:count].tolist()
        ]
        return Framing(found, used)


@njit(cache=True, nogil=True)
def find_capsules(stream: bytes, size: int, in_step: Flags, runs: IntArray) -> tuple[int, int]:
    """Write runs of sound capsules (start, count) to runs (R, 2); return how many runs, and the bytes settled.

    in_step (1,): whether the first byte follows on a sound capsule; kept for the next call. Off the step a capsule
    needs a sound one behind it: in the bytes of a damaged one, every 65,536th place looks like one by chance.
    """
    count, at, length = 0, 0, len(stream)
    begun = at
    while at + 2 <= length:
        if stream[at] & 0xF0 != 0xA0 or stream[at + 1] & 0xF0 != 0x50:
            in_step[0] = False
            at += 1
            continue
        needed = size if in_step[0] else 2 * size
        if at + size > length:
            return count, at
        if not _is_sealed(stream, at, size):
            in_step[0] = False
            at += 1
            continue
        if at + needed > length:
            return count, at
        if not in_step[0] and not _is_sealed(stream, at + size, size):
            at += 1
            continue
        if in_step[0] and count and begun == at:
            runs[count - 1, 1] += 1
        else:
            runs[count, 0], runs[count, 1] = at, 1
            count += 1
        in_step[0] = True
        at += size
        begun = at
    return count, at


@njit(cache=True, nogil=True)
def _is_sealed(stream: bytes, at: int, size: int) -> bool:
    """Has the capsule here its two sync nibbles and the right checksum?"""
    if stream[at] & 0xF0 != 0xA0 or stream[at + 1] & 0xF0 != 0x50:
        return False
    check = stream[at] & 15 | (stream[at + 1] & 15) << 4
    for place in range(at + 2, at + size):
        check ^= stream[place]
    sealed: bool = check == 0
    return sealed
