"""Measurement packets of the RPLIDAR to samples: compiled, integer-exact, without state.

Angles are in 1/64 deg ("q6"), clockwise, in [0, 23040); distances in 1/4 mm ("q2"), 0 = no measurement. The arithmetic
is that of Slamtec's SDK 2.1: floor shifts on 1/65536 deg ("q16"), sample index from 0. One thing differs: a turn ends
where the next packet's own start angle says so, because the interpolation can miss a crossing at a packet's edge.

A capsule gives its start angle only, so P + 1 consecutive packets give the samples of the first P.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drivers.rplidar_protocol import Answer

IntArray = NDArray[np.int64]
Flags = NDArray[np.bool_]
Packets = NDArray[np.uint8]

FULL_TURN_Q6 = 360 * 64
Q6_TO_Q16 = 10  # bits from 1/64 to 1/65536 deg
MAX_DISTANCE_MM = 28656  # the largest major value an ultra capsule can carry
_LOWEST_PREDICTION, _HIGHEST_PREDICTION = -512, 511  # both say: no measurement
_UNKNOWN_OFFSET_RAD_Q16 = 8578  # 7.5 deg, in 1/65536 rad: too near for the model, or no measurement

# Variable bit scale of ultra capsules: (first code, first mm, shift) of each section.
_VBS_SECTIONS = ((0, 0, 0), (512, 512, 1), (1280, 2048, 2), (1792, 4096, 3), (3328, 16384, 4))


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Decoded samples in the order they were taken, all (N,); new_turn marks the first sample of a turn."""

    angle_q6: IntArray
    distance_q2: IntArray
    new_turn: NDArray[np.bool_]
    quality: IntArray | None = None

    def __len__(self) -> int:
        return len(self.angle_q6)

    def part(self, start: int, stop: int) -> Samples:
        """Return the samples from start to before stop."""
        quality = None if self.quality is None else self.quality[start:stop]
        return Samples(self.angle_q6[start:stop], self.distance_q2[start:stop], self.new_turn[start:stop], quality)


def _vbs_table() -> tuple[IntArray, IntArray]:
    codes = np.arange(4096, dtype=np.int64)
    first, base, shift = np.array(_VBS_SECTIONS, dtype=np.int64).T
    section = np.searchsorted(first, codes, side="right") - 1
    return base[section] + ((codes - first[section]) << shift[section]), shift[section]


VBS_MM, VBS_SHIFT = _vbs_table()  # (4096,) distance and scale of every 12-bit code


def as_packets(data: bytes, size: int) -> Packets:
    """Whole packets, one behind the other, to (P, size); writable, as all that is compiled for."""
    return np.frombuffer(bytearray(data), dtype=np.uint8).reshape(-1, size)


def ultra_offset_q16(distance_q2: IntArray) -> IntArray:
    """Angle between the head and the ray of an ultra sample in 1/65536 deg: the triangulation geometry, by distance."""
    reciprocal = 98361 // np.maximum(distance_q2, 1)
    radians_q16 = np.where(
        distance_q2 < 200, _UNKNOWN_OFFSET_RAD_Q16, 9150 - (reciprocal << 6) - reciprocal**3 // 98304
    )
    return np.trunc(radians_q16 * 180.0 / 3.14159265).astype(np.int64)


def head_angles_q16(start_q6: IntArray, samples: int, kind: int) -> IntArray:
    """Interpolated head angles (P, samples) of P + 1 start angles, growing past 360 deg within a packet."""
    first = start_q6[:-1]
    turned = np.diff(start_q6)
    turned = np.where(turned < 0, turned + FULL_TURN_Q6, turned)
    if kind == Answer.EXPRESS:
        step = turned << 5
    elif kind == Answer.ULTRA:
        step = (turned << 5) // 3
    else:
        step = (turned << Q6_TO_Q16) // samples
    return (first << Q6_TO_Q16)[:, None] + np.arange(samples) * step[:, None]


def decode_nodes(packets: Packets) -> Samples:
    """Standard nodes (P, 5) to P samples; they carry their own angle, turn flag and quality."""
    return Samples(*_nodes(packets))


def decode_express(packets: Packets) -> Samples:
    """Express capsules (P + 1, 84) to 32 P samples."""
    return Samples(*_express(packets))


def decode_dense(packets: Packets) -> Samples:
    """Dense capsules (P + 1, 84) to 40 P samples."""
    return Samples(*_dense(packets))


def decode_ultra(packets: Packets) -> Samples:
    """Ultra capsules (P + 1, 132) to 96 P samples: 32 major distances each, two predictions between neighbours."""
    return Samples(*_ultra(packets, VBS_MM, VBS_SHIFT))


DECODERS: dict[int, Callable[[Packets], Samples]] = {
    Answer.NODES: decode_nodes,
    Answer.EXPRESS: decode_express,
    Answer.ULTRA: decode_ultra,
    Answer.DENSE: decode_dense,
}


@njit(cache=True, nogil=True)
def start_q6(packets: Packets, place: int) -> int:
    """Start angle of one of capsules (P, size)."""
    return _word(packets[place, 2], packets[place, 3]) & 0x7FFF


@njit(cache=True, nogil=True)
def _nodes(packets: Packets) -> tuple[IntArray, IntArray, Flags, IntArray]:
    count = len(packets)
    angle_q6, distance_q2, quality = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count, np.int64)
    new_turn = np.empty(count, np.bool_)
    for place in range(count):
        node = packets[place]
        angle_q6[place] = _word(node[1], node[2]) >> 1
        distance_q2[place] = _word(node[3], node[4])
        new_turn[place] = node[0] & 1
        quality[place] = node[0] >> 2
    return angle_q6, distance_q2, new_turn, quality


@njit(cache=True, nogil=True)
def _express(packets: Packets) -> tuple[IntArray, IntArray, Flags]:
    angle_q6, distance_q2, new_turn = _for_samples((len(packets) - 1) * 32)
    for place in range(len(packets) - 1):
        head, turned = _start_and_turn(packets, place)
        step = turned << 5
        for k in range(32):
            cabin = packets[place, 4 + k // 2 * 5 : 9 + k // 2 * 5]
            word = _word(cabin[k % 2 * 2], cabin[k % 2 * 2 + 1])
            nibble = np.int64(cabin[4]) >> 4 if k % 2 else np.int64(cabin[4]) & 15
            correction_q3 = nibble | (word & 3) << 4  # unsigned: the document's sign bit does not exist in hardware
            sample = place * 32 + k
            angle_q6[sample] = _wrapped_q6(head + k * step - (correction_q3 << 13))
            distance_q2[sample] = word & 0xFFFC
        _flag_turn(new_turn, place * 32, 32, head, step, turned)
    return angle_q6, distance_q2, new_turn


@njit(cache=True, nogil=True)
def _dense(packets: Packets) -> tuple[IntArray, IntArray, Flags]:
    angle_q6, distance_q2, new_turn = _for_samples((len(packets) - 1) * 40)
    for place in range(len(packets) - 1):
        head, turned = _start_and_turn(packets, place)
        step = (turned << Q6_TO_Q16) // 40
        for k in range(40):
            sample = place * 40 + k
            angle_q6[sample] = _wrapped_q6(head + k * step)
            distance_q2[sample] = _word(packets[place, 4 + 2 * k], packets[place, 5 + 2 * k]) << 2
        _flag_turn(new_turn, place * 40, 40, head, step, turned)
    return angle_q6, distance_q2, new_turn


@njit(cache=True, nogil=True)
def _ultra(packets: Packets, mm_of: IntArray, shift_of: IntArray) -> tuple[IntArray, IntArray, Flags]:
    angle_q6, distance_q2, new_turn = _for_samples((len(packets) - 1) * 96)
    for place in range(len(packets) - 1):
        head, turned = _start_and_turn(packets, place)
        step = (turned << 5) // 3
        word = _ultra_word(packets, place, 0)
        for cabin in range(32):
            here, scale_here = mm_of[word & 0xFFF], shift_of[word & 0xFFF]
            next_word = _ultra_word(packets, place, cabin + 1)
            after, scale_after = mm_of[next_word & 0xFFF], shift_of[next_word & 0xFFF]
            base, scale = (after, scale_after) if here == 0 and after > 0 else (here, scale_here)
            for part in range(3):
                if part == 0:
                    distance = here
                elif part == 1:
                    distance = _predicted(word >> 12, base, scale)
                else:
                    distance = _predicted(word >> 22, after, scale_after)
                k = 3 * cabin + part
                sample = place * 96 + k
                distance_q2[sample] = distance << 2
                angle_q6[sample] = _wrapped_q6(head + k * step - _offset_q16(distance << 2))
            word = next_word
        _flag_turn(new_turn, place * 96, 96, head, step, turned)
    return angle_q6, distance_q2, new_turn


@njit(cache=True, nogil=True)
def _ultra_word(packets: Packets, place: int, cabin: int) -> int:
    """Return a cabin's 32 bits; the one behind the last is the next capsule's first."""
    at = 4 + 4 * (cabin % 32)
    place += cabin // 32
    low, high = _word(packets[place, at], packets[place, at + 1]), _word(packets[place, at + 2], packets[place, at + 3])
    return low | high << 16


@njit(cache=True, nogil=True)
def _predicted(bits: int, base_mm: int, scale: int) -> int:
    """Return the distance in mm that ten bits predict, 0 where they say that there is none; never below 0."""
    prediction = ((bits & 0x3FF) ^ 0x200) - 0x200
    if prediction in (_LOWEST_PREDICTION, _HIGHEST_PREDICTION):
        return 0
    return max((prediction << scale) + base_mm, 0)


@njit(cache=True, nogil=True)
def _offset_q16(distance_q2: int) -> int:
    """One value of ultra_offset_q16."""
    radians_q16 = _UNKNOWN_OFFSET_RAD_Q16
    if distance_q2 >= 200:
        reciprocal = 98361 // distance_q2
        radians_q16 = 9150 - (reciprocal << 6) - reciprocal**3 // 98304
    return int(radians_q16 * 180.0 / 3.14159265)


@njit(cache=True, nogil=True)
def _start_and_turn(packets: Packets, place: int) -> tuple[int, int]:
    """Return a capsule's start angle in 1/65536 deg and the turn to the next one's in 1/64 deg."""
    here = start_q6(packets, place)
    turned = start_q6(packets, place + 1) - here
    return here << Q6_TO_Q16, turned + FULL_TURN_Q6 if turned < 0 else turned


@njit(cache=True, nogil=True)
def _flag_turn(new_turn: Flags, first: int, count: int, head: int, step: int, turned: int) -> None:
    """Flag the last sample before the head passes zero, the next packet's start angle being the last word."""
    full = FULL_TURN_Q6 << Q6_TO_Q16
    for k in range(count):
        after = head + (k + 1) * step if k + 1 < count else head + (turned << Q6_TO_Q16)
        new_turn[first + k] = head + k * step < full <= after


@njit(cache=True, nogil=True)
def _word(low: np.uint8, high: np.uint8) -> int:
    word: int = np.int64(low) | np.int64(high) << 8
    return word


@njit(cache=True, nogil=True)
def _wrapped_q6(angle_q16: int) -> int:
    return (angle_q16 >> Q6_TO_Q16) % FULL_TURN_Q6


@njit(cache=True, nogil=True)
def _for_samples(count: int) -> tuple[IntArray, IntArray, Flags]:
    return np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count, np.bool_)
