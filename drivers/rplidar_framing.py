"""Where the measurement packets lie in a stream of bytes, with resynchronisation after damage. Pure functions.

What is decided at a byte depends on the bytes after it alone, never on how they were cut into reads: where more bytes
are needed to decide, the search stops and is resumed at that byte.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.rplidar_capsules import FULL_TURN_Q6, IntArray, Packets
from drivers.rplidar_protocol import PACKET_BYTES, Answer

# A standard node has two bits of redundancy: one random frame in four passes. To lock on, a chain of good frames must
# turn by small steps and advance as a whole; in lock a frame counts once its successor fits. A chain of 12 turns by 8
# deg at the slowest, further than another field misread as an angle stays plausible.
LOCK_FRAMES = 12
_MAX_STEP_Q6 = 16 * 64  # between neighbours: 2.7 deg at 15 Hz plus up to 8 deg of triangulation geometry
_MIN_ADVANCE_Q6 = 64  # over a chain: a constant byte misread as an angle does not advance
_TURN_FLAG_WINDOW_Q6 = 20 * 64  # a turn begins near 0 deg

_NODE = PACKET_BYTES[Answer.NODES]


@dataclass(frozen=True, slots=True, eq=False)
class PacketRun:
    """Consecutive sound packets (P, size), the first of them at byte `start`."""

    start: int
    packets: Packets

    @property
    def end(self) -> int:
        """The byte after the last packet."""
        return self.start + self.packets.size


@dataclass(frozen=True, slots=True, eq=False)
class Framing:
    """The runs found, how many bytes are settled (the rest waits for more), and whether the next packet follows on."""

    runs: list[PacketRun]
    used: int
    locked: bool


def find_packets(data: bytes, kind: int, locked: bool) -> Framing:
    """All sound packets of this answer type in data; locked: a packet is expected at byte 0."""
    stream = np.frombuffer(data, dtype=np.uint8)
    return _find_nodes(stream, locked) if kind == Answer.NODES else _find_capsules(stream, PACKET_BYTES[Answer(kind)])


def _find_capsules(stream: Packets, size: int) -> Framing:
    heads = np.flatnonzero((stream[:-1] & 0xF0 == 0xA0) & (stream[1:] & 0xF0 == 0x50))
    runs: list[PacketRun] = []
    at = 0
    while at + 2 <= len(stream):
        count = _leading_capsules(stream[at:], size)
        if count:
            runs.append(PacketRun(at, _frames(stream, at, count, size)))
            at += count * size
        following = heads[np.searchsorted(heads, at) :]
        if len(following) and following[0] == at:
            if at + size > len(stream):
                return Framing(runs, at, locked=True)
            following = following[1:]  # complete and unsound
        elif at + 2 > len(stream):
            break
        at = int(following[0]) if len(following) else max(at, len(stream) - 1)
    return Framing(runs, at, locked=True)


def _leading_capsules(stream: Packets, size: int) -> int:
    frames = _frames(stream, 0, len(stream) // size, size)
    check = frames[:, 0] & 15 | frames[:, 1] << 4
    synced = (frames[:, 0] & 0xF0 == 0xA0) & (frames[:, 1] & 0xF0 == 0x50)
    return _leading_true(synced & (np.bitwise_xor.reduce(frames[:, 2:], axis=1) == check))


def _find_nodes(stream: Packets, locked: bool) -> Framing:
    linked = _linked_nodes(stream)
    runs: list[PacketRun] = []
    at = 0
    while True:
        if not locked:
            hunted = _first_chain(stream, linked, at)
            if hunted is None:
                return Framing(runs, max(at, len(stream) - LOCK_FRAMES * _NODE + 1), locked=False)
            at, locked = hunted + _NODE, True  # the first may straddle the damage: it only vouches for the second
        decidable = linked[at::_NODE]
        count = _leading_true(decidable)
        if count:
            runs.append(PacketRun(at, _frames(stream, at, count, _NODE)))
            at += count * _NODE
        if count == len(decidable):
            return Framing(runs, at, locked=True)
        at, locked = at + 1, False


def _linked_nodes(stream: Packets) -> NDArray[np.bool_]:
    """For each byte: is it the start of a good node that is followed by a good node a small step further?"""
    if len(stream) < 2 * _NODE:
        return np.zeros(0, dtype=np.bool_)
    angle = _node_angles(stream)
    first = stream[: len(angle)]
    checked = ((first ^ first >> 1) & 1 == 1) & (stream[1 : len(angle) + 1] & 1 == 1) & (angle < FULL_TURN_Q6)
    near_zero = (angle < _TURN_FLAG_WINDOW_Q6) | (angle > FULL_TURN_Q6 - _TURN_FLAG_WINDOW_Q6)
    good = checked & ((first & 1 == 0) | near_zero)
    linked: NDArray[np.bool_] = good[:-_NODE] & good[_NODE:] & (np.abs(_turned(angle, _NODE)) <= _MAX_STEP_Q6)
    return linked


def _first_chain(stream: Packets, linked: NDArray[np.bool_], start: int) -> int | None:
    links = LOCK_FRAMES - 1
    positions = len(linked) - (links - 1) * _NODE
    if positions <= start:
        return None
    chained = np.ones(positions, dtype=np.bool_)
    for link in range(links):
        chained &= linked[link * _NODE : link * _NODE + positions]
    chained &= _turned(_node_angles(stream), links * _NODE)[:positions] >= _MIN_ADVANCE_Q6
    found = np.flatnonzero(chained[start:])
    return start + int(found[0]) if len(found) else None


def _node_angles(stream: Packets) -> IntArray:
    """Angle field of the node that would start at each byte that five bytes follow."""
    return (stream[1:-3] >> 1).astype(np.int64) | stream[2:-2].astype(np.int64) << 7


def _turned(angle_q6: IntArray, bytes_apart: int) -> IntArray:
    """Signed turn from each byte's node to the one so many bytes later, within half a turn."""
    half = FULL_TURN_Q6 // 2
    return (angle_q6[bytes_apart:] - angle_q6[:-bytes_apart] + half) % FULL_TURN_Q6 - half


def _frames(stream: Packets, start: int, count: int, size: int) -> Packets:
    return stream[start : start + count * size].reshape(count, size)


def _leading_true(flags: NDArray[np.bool_]) -> int:
    return len(flags) if flags.all() else int(np.argmin(flags))
