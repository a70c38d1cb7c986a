"""Measurement packets of the RPLIDAR to samples: batched, integer-exact, without state.

Angles are in 1/64 deg ("q6"), clockwise, in [0, 23040); distances in 1/4 mm ("q2"), 0 = no measurement. The arithmetic
is that of Slamtec's SDK 2.1: floor shifts on 1/65536 deg ("q16"), sample index from 0. One thing differs: a turn ends
where the next packet's own start angle says so, because the interpolation can miss a crossing at a packet's edge.

A capsule gives its start angle only, so P + 1 consecutive packets give the samples of the first P.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.rplidar_protocol import PACKET_SAMPLES, Answer

IntArray = NDArray[np.int64]
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


def _vbs_table() -> tuple[IntArray, IntArray]:
    codes = np.arange(4096, dtype=np.int64)
    first, base, shift = np.array(_VBS_SECTIONS, dtype=np.int64).T
    section = np.searchsorted(first, codes, side="right") - 1
    return base[section] + ((codes - first[section]) << shift[section]), shift[section]


VBS_MM, VBS_SHIFT = _vbs_table()  # (4096,) distance and scale of every 12-bit code


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


def start_angles_q6(packets: Packets) -> IntArray:
    """(P,) start angles of capsules."""
    return packets[:, 2].astype(np.int64) | (packets[:, 3].astype(np.int64) & 0x7F) << 8


def restart_flags(packets: Packets) -> NDArray[np.bool_]:
    """(P,) True where a capsule is the first after a start or after lost angle tracking; not a new turn."""
    return (packets[:, 3] >> 7).astype(np.bool_)


def decode_nodes(packets: Packets) -> Samples:
    """Standard nodes (P, 5) to P samples; they carry their own angle, turn flag and quality."""
    b = packets.astype(np.int64)
    return Samples(
        angle_q6=b[:, 1] >> 1 | b[:, 2] << 7,
        distance_q2=b[:, 3] | b[:, 4] << 8,
        new_turn=(b[:, 0] & 1) != 0,
        quality=b[:, 0] >> 2,
    )


def decode_express(packets: Packets) -> Samples:
    """Express capsules (P + 1, 84) to 32 P samples."""
    cabins = packets[:-1, 4:].astype(np.int64).reshape(-1, 16, 5)
    words = cabins[:, :, 0:4:2] | cabins[:, :, 1:4:2] << 8  # (P, 16, 2)
    nibbles = np.stack((cabins[:, :, 4] & 15, cabins[:, :, 4] >> 4), axis=2)
    correction_q3 = nibbles | (words & 3) << 4  # unsigned: the document's "sign bit" does not exist in hardware
    count = len(cabins)
    return _capsule_samples(
        packets, Answer.EXPRESS, (words & 0xFFFC).reshape(count, 32), correction_q3.reshape(count, 32) << 13
    )


def decode_dense(packets: Packets) -> Samples:
    """Dense capsules (P + 1, 84) to 40 P samples."""
    body = packets[:-1, 4:].astype(np.int64)
    distance_mm = body[:, 0::2] | body[:, 1::2] << 8
    return _capsule_samples(packets, Answer.DENSE, distance_mm << 2, np.zeros_like(distance_mm))


def decode_ultra(packets: Packets) -> Samples:
    """Ultra capsules (P + 1, 132) to 96 P samples: 32 major distances each, two predictions between neighbours."""
    words = np.ascontiguousarray(packets[:, 4:]).view("<u4").astype(np.int64).reshape(-1)
    used = (len(packets) - 1) * 32
    major, scale = VBS_MM[words & 0xFFF], VBS_SHIFT[words & 0xFFF]
    here, after = major[:used], major[1 : used + 1]
    scale_here, scale_after = scale[:used], scale[1 : used + 1]
    first, second = (((words[:used] >> shift & 0x3FF) ^ 0x200) - 0x200 for shift in (12, 22))
    from_next = (here == 0) & (after > 0)
    predicted1 = (first << np.where(from_next, scale_after, scale_here)) + np.where(from_next, after, here)
    predicted2 = (second << scale_after) + after
    predicted1 = np.where(_is_invalid(first), 0, predicted1)
    predicted2 = np.where(_is_invalid(second), 0, predicted2)
    distance_mm = np.maximum(np.stack((here, predicted1, predicted2), axis=1), 0)
    distance_q2 = (distance_mm << 2).reshape(-1, 96)
    return _capsule_samples(packets, Answer.ULTRA, distance_q2, ultra_offset_q16(distance_q2))


def _is_invalid(prediction: IntArray) -> NDArray[np.bool_]:
    invalid: NDArray[np.bool_] = (prediction == _LOWEST_PREDICTION) | (prediction == _HIGHEST_PREDICTION)
    return invalid


def _capsule_samples(packets: Packets, kind: Answer, distance_q2: IntArray, offset_q16: IntArray) -> Samples:
    start_q6 = start_angles_q6(packets)
    head = head_angles_q16(start_q6, PACKET_SAMPLES[kind], kind)
    wrapped_q6 = start_q6[1:] + np.where(np.diff(start_q6) < 0, FULL_TURN_Q6, 0)
    head_after = np.column_stack((head[:, 1:], wrapped_q6 << Q6_TO_Q16))
    full_turn = FULL_TURN_Q6 << Q6_TO_Q16
    return Samples(
        angle_q6=(((head - offset_q16) >> Q6_TO_Q16) % FULL_TURN_Q6).reshape(-1),
        distance_q2=distance_q2.reshape(-1),
        new_turn=((head < full_turn) & (head_after >= full_turn)).reshape(-1),
    )


DECODERS: dict[int, Callable[[Packets], Samples]] = {
    Answer.NODES: decode_nodes,
    Answer.EXPRESS: decode_express,
    Answer.ULTRA: decode_ultra,
    Answer.DENSE: decode_dense,
}
