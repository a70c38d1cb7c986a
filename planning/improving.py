"""Shortening a path that is already free: words instead of detours, and poses moved to where the way is shorter.

Pieces that are kept are never computed again from their ends (see `pieces`).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planning.costmap import Costmap
from planning.edges import STEP_M, edge_is_free, steer, steering
from planning.footprint import Distances, Mask
from planning.pieces import Pieces, cost_between
from planning.reeds_shepp import PIECES, TurnArray, drive

FloatArray = NDArray[np.float64]

_MOST_PIECES = 4096
_LEAST_PIECE_M = 1e-7
_LEAST_GAIN_M = 1e-5
_LEAST_SPAN_M = 0.15  # of a stretch that is replaced, up to the whole path
_VIA = 0.6  # share of the tries that lead by a pose beside the path


class Improvement:
    """A path on its way to become cheaper."""

    def __init__(self, costmap: Costmap, pieces: Pieces) -> None:
        vehicle = costmap.vehicle
        self._map = (costmap.blocked, costmap.to_blocked_m, costmap.grid.resolution_m)
        self._body = (vehicle.corners, vehicle.outer_radius_m)
        self._steering = steering(vehicle)
        self._count = len(pieces.lengths)
        room = self._count + _MOST_PIECES
        self._starts, self._lengths = np.zeros((room + 1, 3)), np.zeros(room)
        self._turns = np.zeros(room, np.int64)
        self._starts[: self._count + 1] = pieces.starts
        self._lengths[: self._count], self._turns[: self._count] = pieces.lengths, pieces.turns

    @property
    def pieces(self) -> Pieces:
        """The path as it is now."""
        count = self._count
        return Pieces(self._starts[: count + 1].copy(), self._lengths[:count].copy(), self._turns[:count].copy())

    @property
    def cost_m(self) -> float:
        """What it costs now."""
        return float(cost_between(self._lengths, 0, self._count, 0, 0, *self._steering[2:]))

    def attempt(self, tries: int, seed: int) -> None:
        """Try so many random changes; each keeps the path free and makes it cheaper, or is not made."""
        where = (*self._map, *self._body, *self._steering)
        chain = (self._starts, self._lengths, self._turns, self._count)
        self._count = int(improve(*where, *chain, tries, seed))


@njit(cache=True)
def improve(
    blocked: Mask,
    distance_m: Distances,
    cell_m: float,
    corners: FloatArray,
    outer_radius_m: float,
    kind: int,
    radius: float,
    reverse_cost: float,
    cusp_cost: float,
    starts: FloatArray,
    lengths: FloatArray,
    turns: TurnArray,
    count: int,
    tries: int,
    seed: int,
) -> int:
    """Try so many random changes on pieces [0, count) of starts (M + 1, 3), lengths (M,), turns (M,), in place.

    starts[count] is the goal. Returns how many pieces there are then.
    """
    np.random.seed(seed)
    new_lengths, new_turns = np.empty(2 * PIECES), np.empty(2 * PIECES, np.int64)
    word_lengths, word_turns = np.empty(PIECES), np.empty(PIECES, np.int64)
    total = np.abs(lengths[:count]).sum()
    for _ in range(tries):
        if count + 2 * PIECES + 1 > len(lengths):
            break
        span = _LEAST_SPAN_M * math.exp(np.random.random() * math.log(max(total / _LEAST_SPAN_M, 1.0)))
        begin = np.random.random() * (total + span) - span
        end = min(begin + span, total)
        begin = max(begin, 0.0)
        i, part_i = _locate(lengths, count, begin)
        k, part_k = _locate(lengths, count, end)
        ax, ay, ayaw = drive(starts[i, 0], starts[i, 1], starts[i, 2], part_i, turns[i], radius)
        bx, by, byaw = drive(starts[k, 0], starts[k, 1], starts[k, 2], part_k, turns[k], radius)
        if end >= total:
            k, part_k = count - 1, lengths[count - 1]
            bx, by, byaw = starts[count, 0], starts[count, 1], starts[count, 2]
        before, after = _gears_around(lengths, count, i, part_i, k, part_k)
        old = _between(lengths, i, part_i, k, part_k, before, after, reverse_cost, cusp_cost)
        x, y, yaw, fresh = ax, ay, ayaw, 0
        if np.random.random() < _VIA:
            m, part_m = _locate(lengths, count, begin + (0.2 + 0.6 * np.random.random()) * (end - begin))
            x, y, yaw = drive(starts[m, 0], starts[m, 1], starts[m, 2], part_m, turns[m], radius)
            x, y, yaw = _nearby(x, y, yaw)
            if math.hypot(x - ax, y - ay) + math.hypot(bx - x, by - y) > old:
                continue
            way = steer(kind, ax, ay, ayaw, x, y, yaw, radius, reverse_cost, cusp_cost, word_lengths, word_turns)
            if way > old:
                continue
            fresh = _append(word_lengths, word_turns, new_lengths, new_turns, fresh)
        steer(kind, x, y, yaw, bx, by, byaw, radius, reverse_cost, cusp_cost, word_lengths, word_turns)
        fresh = _append(word_lengths, word_turns, new_lengths, new_turns, fresh)
        new = cost_between(new_lengths, 0, fresh, before, after, reverse_cost, cusp_cost)
        if new > old - _LEAST_GAIN_M or not edge_is_free(
            blocked, distance_m, cell_m, corners, outer_radius_m, new_lengths[:fresh], new_turns[:fresh],
            ax, ay, ayaw, radius, STEP_M,
        ) or not _cuts_are_free(
            blocked, distance_m, cell_m, corners, outer_radius_m, starts, lengths, turns, i, part_i, k, part_k, radius
        ):  # fmt: skip
            continue
        count = _splice(starts, lengths, turns, count, i, part_i, k, part_k, new_lengths, new_turns, fresh, radius)
        total = np.abs(lengths[:count]).sum()
    return count


@njit(cache=True)
def _cuts_are_free(
    blocked: Mask,
    distance_m: Distances,
    cell_m: float,
    corners: FloatArray,
    outer_radius_m: float,
    starts: FloatArray,
    lengths: FloatArray,
    turns: TurnArray,
    i: int,
    part_i: float,
    k: int,
    part_k: float,
    radius: float,
) -> bool:
    """Whether what is left of pieces i and k is free: sampled from new ends it has other poses than the whole had."""
    left, turn = np.empty(1), np.empty(1, np.int64)
    left[0], turn[0] = part_i, turns[i]
    x, y, yaw = starts[i, 0], starts[i, 1], starts[i, 2]
    if abs(part_i) > _LEAST_PIECE_M and not edge_is_free(
        blocked, distance_m, cell_m, corners, outer_radius_m, left, turn, x, y, yaw, radius, STEP_M
    ):
        return False
    left[0], turn[0] = lengths[k] - part_k, turns[k]
    x, y, yaw = drive(starts[k, 0], starts[k, 1], starts[k, 2], part_k, turns[k], radius)
    return abs(left[0]) <= _LEAST_PIECE_M or edge_is_free(
        blocked, distance_m, cell_m, corners, outer_radius_m, left, turn, x, y, yaw, radius, STEP_M
    )


@njit(cache=True)
def _nearby(x: float, y: float, yaw: float) -> tuple[float, float, float]:
    """Return a random pose near one, mostly very near."""
    aside = 0.3 * math.exp(-4.0 * np.random.random()) * (1.0 if np.random.random() < 0.5 else -1.0)
    turn = 0.4 * math.exp(-4.0 * np.random.random()) * (1.0 if np.random.random() < 0.5 else -1.0)
    along = 0.1 * (np.random.random() - 0.5)
    cos, sin = math.cos(yaw), math.sin(yaw)
    return x + along * cos - aside * sin, y + along * sin + aside * cos, yaw + turn


@njit(cache=True)
def _append(lengths: FloatArray, turns: TurnArray, new_lengths: FloatArray, new_turns: TurnArray, count: int) -> int:
    """Write the pieces of a word behind count new ones; return how many there are then."""
    for piece in range(PIECES):
        if abs(lengths[piece]) > _LEAST_PIECE_M:
            new_lengths[count], new_turns[count] = lengths[piece], turns[piece]
            count += 1
    return count


@njit(cache=True)
def _gears_around(lengths: FloatArray, count: int, i: int, part_i: float, k: int, part_k: float) -> tuple[int, int]:
    """Return the gears before part_i of piece i and after part_k of piece k, 0 where nothing is driven there."""
    before, after = 0, 0
    rest_k = lengths[k] - part_k
    if part_i != 0.0:
        before = _sign(part_i)
    elif i > 0:
        before = _sign(lengths[i - 1])
    if rest_k != 0.0:
        after = _sign(rest_k)
    elif k + 1 < count:
        after = _sign(lengths[k + 1])
    return before, after


@njit(cache=True)
def _sign(length: float) -> int:
    return 1 if length > 0.0 else -1


@njit(cache=True)
def _locate(lengths: FloatArray, count: int, along: float) -> tuple[int, float]:
    """Return the piece so far along a path, and how much of it, with its sign, lies before."""
    for place in range(count):
        here = abs(lengths[place])
        if along < here:
            return place, along if lengths[place] > 0.0 else -along
        along -= here
    return count - 1, lengths[count - 1]


@njit(cache=True)
def _between(
    lengths: FloatArray,
    i: int,
    part_i: float,
    k: int,
    part_k: float,
    before: int,
    after: int,
    reverse_cost: float,
    cusp_cost: float,
) -> float:
    """Return what the path costs from part_i of piece i to part_k of piece k."""
    saved_i, saved_k = lengths[i], lengths[k]
    if i == k:
        lengths[i] = part_k - part_i
    else:
        lengths[i] = saved_i - part_i
        lengths[k] = part_k
    cost = cost_between(lengths, i, k + 1, before, after, reverse_cost, cusp_cost)
    lengths[i] = saved_i
    lengths[k] = saved_k
    return cost


@njit(cache=True)
def _splice(
    starts: FloatArray,
    lengths: FloatArray,
    turns: TurnArray,
    count: int,
    i: int,
    part_i: float,
    k: int,
    part_k: float,
    new_lengths: FloatArray,
    new_turns: TurnArray,
    fresh: int,
    radius: float,
) -> int:
    """Put new pieces in the place of those from part_i of piece i to part_k of piece k; return how many there are."""
    ax, ay, ayaw = drive(starts[i, 0], starts[i, 1], starts[i, 2], part_i, turns[i], radius)
    rest_k, turn_k = lengths[k] - part_k, turns[k]
    cx, cy, cyaw = drive(starts[k, 0], starts[k, 1], starts[k, 2], part_k, turns[k], radius)
    keep_i, keep_k = abs(part_i) > _LEAST_PIECE_M, abs(rest_k) > _LEAST_PIECE_M
    head, tail = i + (1 if keep_i else 0), k + 1
    grown = head + fresh + (1 if keep_k else 0)
    shift = grown - tail
    if shift > 0:
        for place in range(count, tail - 1, -1):
            starts[place + shift] = starts[place]
            if place < count:
                lengths[place + shift], turns[place + shift] = lengths[place], turns[place]
    elif shift < 0:
        for place in range(tail, count + 1):
            starts[place + shift] = starts[place]
            if place < count:
                lengths[place + shift], turns[place + shift] = lengths[place], turns[place]
    if keep_i:
        lengths[i] = part_i
    x, y, yaw = ax, ay, ayaw
    for piece in range(fresh):
        place = head + piece
        starts[place, 0], starts[place, 1], starts[place, 2] = x, y, yaw
        lengths[place], turns[place] = new_lengths[piece], new_turns[piece]
        x, y, yaw = drive(x, y, yaw, lengths[place], turns[place], radius)
    if keep_k:
        place = head + fresh
        starts[place, 0], starts[place, 1], starts[place, 2] = cx, cy, cyaw
        lengths[place], turns[place] = rest_k, turn_k
    return count + shift
