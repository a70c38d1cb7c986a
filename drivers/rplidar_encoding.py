"""Samples to measurement packets of the RPLIDAR: the inverse of drivers.rplidar_capsules, for emulator and tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.rplidar_capsules import MAX_DISTANCE_MM, VBS_MM, VBS_SHIFT, IntArray, Packets

MAX_PREDICTION = 510  # scaled steps; beyond that a prediction is marked invalid
_NO_PREDICTION = -512


def encode_nodes(angle_q6: IntArray, distance_q2: IntArray, quality: IntArray, new_turn: NDArray[np.bool_]) -> Packets:
    """Standard nodes (N, 5) of angles in 1/64 deg, distances in 1/4 mm (16 bits), quality 0 to 63 and turn flags."""
    first = quality << 2 | np.where(new_turn, 1, 2)
    fields = (first, (angle_q6 & 0x7F) << 1 | 1, angle_q6 >> 7, distance_q2 & 0xFF, distance_q2 >> 8)
    return np.stack(fields, axis=1).astype(np.uint8)


def encode_express(
    start_q6: IntArray, distance_mm: IntArray, correction_q3: IntArray, restart: NDArray[np.bool_]
) -> Packets:
    """Express capsules (P, 84) of start angles (P,), distances in mm below 16384 and corrections in 1/8 deg (P, 32)."""
    words = distance_mm << 2 | correction_q3 >> 4
    cabins = np.empty((len(start_q6), 16, 5), dtype=np.uint8)
    cabins[:, :, 0:4:2] = words.reshape(-1, 16, 2) & 0xFF
    cabins[:, :, 1:4:2] = words.reshape(-1, 16, 2) >> 8
    nibbles = correction_q3.reshape(-1, 16, 2) & 15
    cabins[:, :, 4] = nibbles[:, :, 0] | nibbles[:, :, 1] << 4
    return _sealed(start_q6, cabins.reshape(-1, 80), restart)


def encode_dense(start_q6: IntArray, distance_mm: IntArray, restart: NDArray[np.bool_]) -> Packets:
    """Dense capsules (P, 84) of start angles (P,) and distances in mm (P, 40)."""
    return _sealed(start_q6, distance_mm.astype("<u2").view(np.uint8).reshape(-1, 80), restart)


def encode_ultra(start_q6: IntArray, distance_mm: IntArray, restart: NDArray[np.bool_]) -> Packets:
    """Ultra capsules (P, 132) of start angles (P,) and distances in mm (96 P + 1,), the last being the next's first.

    The format keeps every third distance to its scale's step (1 mm below 512 mm, 2 below 2 m, 4, 8, 16) and the two
    between to the step of the neighbour they are predicted from; a jump beyond 510 steps is lost (no measurement).
    """
    code = vbs_code(distance_mm[::3])
    major, scale = VBS_MM[code], VBS_SHIFT[code]
    here, after, scale_here, scale_after = major[:-1], major[1:], scale[:-1], scale[1:]
    from_next = (here == 0) & (after > 0)
    between = distance_mm[:-1].reshape(-1, 3)
    first = _prediction(between[:, 1], np.where(from_next, after, here), np.where(from_next, scale_after, scale_here))
    second = _prediction(between[:, 2], after, scale_after)
    words = code[:-1] | (first & 0x3FF) << 12 | (second & 0x3FF) << 22
    return _sealed(start_q6, words.astype("<u4").view(np.uint8).reshape(-1, 128), restart)


def vbs_code(distance_mm: IntArray) -> IntArray:
    """The 12-bit code at or just below each distance in mm."""
    return np.searchsorted(VBS_MM, np.clip(distance_mm, 0, MAX_DISTANCE_MM), side="right") - 1


def _prediction(distance_mm: IntArray, base_mm: IntArray, scale: IntArray) -> IntArray:
    steps = (distance_mm - base_mm) >> scale
    usable = (distance_mm > 0) & (np.abs(steps) <= MAX_PREDICTION) & ((steps << scale) + base_mm > 0)
    return np.where(usable, steps, _NO_PREDICTION)


def _sealed(start_q6: IntArray, body: Packets, restart: NDArray[np.bool_]) -> Packets:
    """Put the head before each body: sync nibbles, checksum over all that follows, start angle, restart flag."""
    packets = np.empty((len(body), body.shape[1] + 4), dtype=np.uint8)
    packets[:, 2] = start_q6 & 0xFF
    packets[:, 3] = start_q6 >> 8 | np.where(restart, 0x80, 0)
    packets[:, 4:] = body
    check = np.bitwise_xor.reduce(packets[:, 2:], axis=1)
    packets[:, 0] = 0xA0 | check & 15
    packets[:, 1] = 0x50 | check >> 4
    return packets
