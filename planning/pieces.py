"""A path as a chain of pieces: arcs of the turning radius and straight lines, driven forwards or backwards.

Pieces once checked are never computed again from their ends: equally long words may be exchanged by rounding, and then
what was checked would not be what is driven.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planning.edges import STEP_M, steer
from planning.reeds_shepp import PIECES, TurnArray, drive, sample, sample_count

FloatArray = NDArray[np.float64]
Gears = NDArray[np.int8]


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """starts (K + 1, 3), the poses at which pieces begin and the last one's end, local; lengths (K,) in m, below zero
    backwards; turns (K,) 1 left, -1 right, 0 straight on.
    """

    starts: FloatArray
    lengths: FloatArray
    turns: TurnArray

    @property
    def length_m(self) -> float:
        """What is driven, forwards and backwards."""
        return float(np.abs(self.lengths).sum())

    def cost_m(self, reverse_cost: float, cusp_cost_m: float) -> float:
        """Return the length with a metre backwards at reverse_cost, and cusp_cost_m for every change of gear."""
        arguments = (self.lengths, 0, len(self.lengths), 0, 0, reverse_cost, cusp_cost_m)
        return float(cost_between(*arguments))

    def followed_by(self, other: Pieces) -> Pieces:
        """Return this chain and another, which begins where it ends."""
        return Pieces(
            np.concatenate((self.starts[:-1], other.starts)),
            np.concatenate((self.lengths, other.lengths)),
            np.concatenate((self.turns, other.turns)),
        )

    def sampled(self, radius_m: float) -> tuple[FloatArray, Gears]:
        """Return poses (N, 3) at most STEP_M apart, piece by piece from its start, and the gear (N,) that leaves each.

        Headings are within half a turn.
        """
        count = int(sample_count(self.lengths, STEP_M))
        poses, gears = np.empty((count, 3)), np.ones(count, np.int8)
        _sample(self.starts, self.lengths, self.turns, radius_m, poses, gears)
        poses[:, 2] = (poses[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
        return poses, gears


def words_between(poses: FloatArray, kind: int, radius_m: float, reverse_cost: float, cusp_cost_m: float) -> Pieces:
    """Return the words of least cost from each of poses (M, 3), M >= 1, to the next, as one chain."""
    starts = np.empty((PIECES * len(poses) + 1, 3))
    lengths, turns = np.empty(PIECES * len(poses)), np.empty(PIECES * len(poses), np.int64)
    count = _spell_all(poses, kind, radius_m, reverse_cost, cusp_cost_m, starts, lengths, turns)
    return Pieces(starts[: count + 1].copy(), lengths[:count].copy(), turns[:count].copy())


@njit(cache=True)
def cost_between(
    lengths: FloatArray, start: int, stop: int, before: int, after: int, reverse_cost: float, cusp_cost: float
) -> float:
    """Return what pieces [start, stop) cost between gears before and after, 0 where nothing is driven there."""
    total, gear = 0.0, before
    for place in range(start, stop):
        length = lengths[place]
        if length == 0.0:
            continue
        now = 1 if length > 0.0 else -1
        total += length if now > 0 else -length * reverse_cost
        if gear not in (0, now):
            total += cusp_cost
        gear = now
    if gear != 0 and after not in (0, gear):
        total += cusp_cost
    return total


@njit(cache=True)
def _spell_all(
    poses: FloatArray,
    kind: int,
    radius: float,
    reverse_cost: float,
    cusp_cost: float,
    starts: FloatArray,
    lengths: FloatArray,
    turns: TurnArray,
) -> int:
    word_lengths, word_turns = np.empty(PIECES), np.empty(PIECES, np.int64)
    count = 0
    for place in range(len(poses) - 1):
        x, y, yaw = poses[place, 0], poses[place, 1], poses[place, 2]
        to_x, to_y, to_yaw = poses[place + 1, 0], poses[place + 1, 1], poses[place + 1, 2]
        steer(kind, x, y, yaw, to_x, to_y, to_yaw, radius, reverse_cost, cusp_cost, word_lengths, word_turns)
        for piece in range(PIECES):
            if word_lengths[piece] == 0.0:
                continue
            starts[count, 0], starts[count, 1], starts[count, 2] = x, y, yaw
            lengths[count], turns[count] = word_lengths[piece], word_turns[piece]
            x, y, yaw = drive(x, y, yaw, word_lengths[piece], word_turns[piece], radius)
            count += 1
    starts[count] = poses[-1]
    return count


@njit(cache=True)
def _sample(
    starts: FloatArray, lengths: FloatArray, turns: TurnArray, radius: float, poses: FloatArray, gears: Gears
) -> None:
    last = 0
    for piece in range(len(lengths)):
        x, y, yaw = starts[piece, 0], starts[piece, 1], starts[piece, 2]
        part = slice(piece, piece + 1)
        last += sample(x, y, yaw, lengths[part], turns[part], radius, STEP_M, poses[last:], gears[last:]) - 1
    poses[len(poses) - 1] = starts[len(lengths)]
