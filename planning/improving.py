"""Shortening a path that is already free: words instead of detours, and poses moved to where the way is shorter.

A path is a chain of pieces, each an arc of the turning radius or a straight line with a sign, and the pose at which
each begins. Pieces that are kept are never computed again from their ends: equally long words may be exchanged by
rounding, and then what was checked is not what is driven.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planning.costmap import Costmap
from planning.edges import DUBINS, REEDS_SHEPP, STEP_M, edge_is_free, steer
from planning.footprint import Distances, Mask
from planning.pieces import Pieces, cost_between
from planning.reeds_shepp import PIECES, TurnArray, drive

FloatArray = NDArray[np.float64]

_MOST_PIECES = 4096
_LEAST_PIECE_M = 1e-7
_LEAST_GAIN_M = 1e-5


class Improvement:
    """A path on its way to become cheaper."""

    def __init__(self, costmap: Costmap, pieces: Pieces) -> None:
        vehicle = costmap.vehicle
        self._map = (costmap.blocked, costmap.to_blocked_m, costmap.grid.resolution_m)
        self._body = (vehicle.corners, vehicle.outer_radius_m)
        self._costs = (vehicle.reverse_cost, vehicle.cusp_cost_m)
        self._steering = (DUBINS if vehicle.forward_only else REEDS_SHEPP, vehicle.turning_radius_m)
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
        return float(cost_between(self._lengths, 0, self._count, 0, 0, *self._costs))

    def attempt(self, tries: int, seed: int) -> None:
        """Try so many random changes; each keeps the path free and makes it cheaper, or is not made."""
        where = (*self._map, *self._body, *self._steering, *self._costs)
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
    new_lengths, new_turns = np.empty(4 * PIECES), np.empty(4 * PIECES, np.int64)
    first_lengths, first_turns = np.empty(PIECES), np.empty(PIECES, np.int64)
    second_lengths, second_turns = np.empty(PIECES), np.empty(PIECES, np.int64)
    total = 0.0
    for place in range(count):
        total += abs(lengths[place])
    for _ in range(tries):
        if count + 4 * PIECES > len(lengths):
            break
        span = 0.15 * math.exp(np.random.random() * math.log(max(total / 0.15, 1.0)))
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
        before = _sign(part_i) if part_i != 0.0 else (_sign(lengths[i - 1]) if i else 0)
        rest_k = lengths[k] - part_k
        after = _sign(rest_k) if rest_k != 0.0 else (_sign(lengths[k + 1]) if k + 1 < count else 0)
        old = _between(lengths, i, part_i, k, part_k, before, after, reverse_cost, cusp_cost)
        halves = np.random.random() < 0.6
        if halves:
            middle = begin + (0.2 + 0.6 * np.random.random()) * (end - begin)
            m, part_m = _locate(lengths, count, middle)
            mx, my, myaw = drive(starts[m, 0], starts[m, 1], starts[m, 2], part_m, turns[m], radius)
            aside = 0.3 * math.exp(-4.0 * np.random.random()) * (1.0 if np.random.random() < 0.5 else -1.0)
            turn = 0.4 * math.exp(-4.0 * np.random.random()) * (1.0 if np.random.random() < 0.5 else -1.0)
            along = 0.1 * (np.random.random() - 0.5)
            mx += along * math.cos(myaw) - aside * math.sin(myaw)
            my += along * math.sin(myaw) + aside * math.cos(myaw)
            myaw += turn
            if math.hypot(mx - ax, my - ay) + math.hypot(bx - mx, by - my) > old:
                continue
            way = steer(kind, ax, ay, ayaw, mx, my, myaw, radius, reverse_cost, cusp_cost, first_lengths, first_turns)
            if way > old:
                continue
            steer(kind, mx, my, myaw, bx, by, byaw, radius, reverse_cost, cusp_cost, second_lengths, second_turns)
        else:
            steer(kind, ax, ay, ayaw, bx, by, byaw, radius, reverse_cost, cusp_cost, first_lengths, first_turns)
        fresh = 0
        for piece in range(PIECES):
            if abs(first_lengths[piece]) > _LEAST_PIECE_M:
                new_lengths[fresh], new_turns[fresh] = first_lengths[piece], first_turns[piece]
                fresh += 1
        if halves:
            for piece in range(PIECES):
                if abs(second_lengths[piece]) > _LEAST_PIECE_M:
                    new_lengths[fresh], new_turns[fresh] = second_lengths[piece], second_turns[piece]
                    fresh += 1
        new = cost_between(new_lengths, 0, fresh, before, after, reverse_cost, cusp_cost)
        if new > old - _LEAST_GAIN_M:
            continue
        if not edge_is_free(
            blocked, distance_m, cell_m, corners, outer_radius_m, new_lengths[:fresh], new_turns[:fresh],
            ax, ay, ayaw, radius, STEP_M,
        ):  # fmt: skip
            continue
        count = _splice(starts, lengths, turns, count, i, part_i, k, part_k, new_lengths, new_turns, fresh, radius)
        total = 0.0
        for place in range(count):
            total += abs(lengths[place])
    return count


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
