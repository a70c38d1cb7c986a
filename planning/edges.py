"""Edges of a search in compiled code: the word between two poses, and whether the car may drive all of it.

Both kinds of words behind one number, so that one kernel serves cars that reverse and cars that do not. Arguments and
coordinates are those of `footprint`.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from planning import dubins, reeds_shepp
from planning.footprint import Distances, Mask, free_length_m, is_free
from planning.reeds_shepp import PIECES, FloatArray, TurnArray
from planning.vehicle import Vehicle

REEDS_SHEPP, DUBINS = 0, 1  # kinds of words
STEP_M = 0.01  # between two checked poses the car stays within its margin
FINER = 10  # times more poses are checked near walls: a swinging corner cuts up to 4 mm deep between two 1 cm apart
Discs = tuple[float, float, float, float, int]  # in m: x of the first, between two, y, radius; and how many
_ROUNDING_M = 1e-9
_NOTHING_M = 1e-300
_ROOM_M = 0.02  # where the discs leave less, the outline itself is asked
_MOST_DISCS = 6
_HALF_DIAGONAL = 0.7072  # of a cell, its square reaches so far from its centre


def steering(vehicle: Vehicle) -> tuple[int, float, float, float]:
    """Return the kind of words, their radius, and what a metre backwards and a cusp cost, in the order of `steer`."""
    kind = DUBINS if vehicle.forward_only else REEDS_SHEPP
    return kind, vehicle.turning_radius_m, vehicle.reverse_cost, vehicle.cusp_cost_m


@numba.njit(cache=True)
def steer(
    kind: int,
    x0: float,
    y0: float,
    yaw0: float,
    x1: float,
    y1: float,
    yaw1: float,
    radius: float,
    reverse_cost: float,
    cusp_cost: float,
    lengths: FloatArray,
    turns: TurnArray,
) -> float:
    """Write the word of least cost into lengths (5,) and turns (5,), and return its cost in m."""
    if kind == DUBINS:
        return dubins.shortest_into(x0, y0, yaw0, x1, y1, yaw1, radius, reverse_cost, cusp_cost, lengths, turns)
    return reeds_shepp.shortest_into(x0, y0, yaw0, x1, y1, yaw1, radius, reverse_cost, cusp_cost, lengths, turns)


@numba.njit(cache=True)
def edge_is_free(
    blocked: Mask,
    distance_m: Distances,
    cell_m: float,
    corners: FloatArray,
    outer_radius_m: float,
    lengths: FloatArray,
    turns: TurnArray,
    x0: float,
    y0: float,
    yaw0: float,
    radius: float,
    step_m: float,
) -> bool:
    """Whether the car is free at all poses that `reeds_shepp.sample` makes of a word with step_m, both ends included.

    And at FINER poses for each of those. Poses are left out only where the room around an earlier one proves them free,
    whatever point of the car moves most.
    """
    x, y, yaw = x0, y0, yaw0
    for piece in range(len(lengths)):
        x, y, yaw = reeds_shepp.drive(x, y, yaw, lengths[piece], turns[piece], radius)
    if not is_free(blocked, distance_m, cell_m, x, y, yaw, corners):  # most edges that are not free end badly
        return False
    x, y, yaw = x0, y0, yaw0
    discs = _discs(corners)
    room_m = _room_m(blocked, distance_m, cell_m, corners, outer_radius_m, discs, x, y, yaw)
    if room_m < 0.0:
        return False
    for piece in range(len(lengths)):
        steps = math.ceil(abs(lengths[piece]) / step_m) * FINER
        if steps == 0:
            continue
        moves_m = max(_swing(corners, turns[piece], radius) * abs(lengths[piece]) / steps, _NOTHING_M)
        step = 0
        while step < steps:
            proven = min((room_m - _ROUNDING_M) / moves_m, float(steps))  # as a float: of next to no length, no integer
            if step + int(proven) >= steps:
                break
            step += max(int(proven), 1)
            part = lengths[piece] * (step / steps)
            at_x, at_y, at_yaw = reeds_shepp.drive(x, y, yaw, part, turns[piece], radius)
            room_m = _room_m(blocked, distance_m, cell_m, corners, outer_radius_m, discs, at_x, at_y, at_yaw)
            if room_m < 0.0:
                return False
        room_m -= (steps - step) * moves_m
        x, y, yaw = reeds_shepp.drive(x, y, yaw, lengths[piece], turns[piece], radius)
    return True


@numba.njit(cache=True)
def way_is_free(
    blocked: Mask,
    distance_m: Distances,
    cell_m: float,
    corners: FloatArray,
    outer_radius_m: float,
    kind: int,
    x0: float,
    y0: float,
    yaw0: float,
    x1: float,
    y1: float,
    yaw1: float,
    radius: float,
    reverse_cost: float,
    cusp_cost: float,
) -> bool:
    """Whether the word that `steer` takes between two poses is free, as `edge_is_free` says."""
    lengths, turns = np.empty(PIECES), np.empty(PIECES, np.int64)
    steer(kind, x0, y0, yaw0, x1, y1, yaw1, radius, reverse_cost, cusp_cost, lengths, turns)
    return edge_is_free(
        blocked, distance_m, cell_m, corners, outer_radius_m, lengths, turns, x0, y0, yaw0, radius, STEP_M
    )


@numba.njit(cache=True)
def _discs(corners: FloatArray) -> Discs:
    """Return equal discs in a row along the car that cover it."""
    low_x, high_x, low_y, high_y = math.inf, -math.inf, math.inf, -math.inf
    for k in range(len(corners)):
        low_x, high_x = min(low_x, corners[k, 0]), max(high_x, corners[k, 0])
        low_y, high_y = min(low_y, corners[k, 1]), max(high_y, corners[k, 1])
    length_m, width_m = high_x - low_x, high_y - low_y
    count = min(math.ceil(length_m / width_m), _MOST_DISCS)
    apart = length_m / count
    return low_x + apart / 2.0, apart, (low_y + high_y) / 2.0, math.hypot(apart, width_m) / 2.0, count


@numba.njit(cache=True)
def _room_m(
    blocked: Mask,
    distance_m: Distances,
    cell_m: float,
    corners: FloatArray,
    outer_radius_m: float,
    discs: Discs,
    x: float,
    y: float,
    yaw: float,
) -> float:
    """Return what `free_length_m` does, or where discs around the car leave enough, what they leave: much cheaper."""
    first, apart, side, radius, count = discs
    cos, sin = math.cos(yaw), math.sin(yaw)
    rows, cols = blocked.shape
    width_m, height_m = cols * cell_m, rows * cell_m
    room_m = math.inf
    for number in range(count):
        along = first + number * apart
        disc_x, disc_y = x + cos * along - sin * side, y + sin * along + cos * side
        room_m = min(room_m, min(disc_x, width_m - disc_x, disc_y, height_m - disc_y) - radius)
        if room_m < _ROOM_M:
            break
        row, col = int(disc_y / cell_m), int(disc_x / cell_m)
        off_x, off_y = disc_x - (col + 0.5) * cell_m, disc_y - (row + 0.5) * cell_m
        off = math.sqrt(off_x * off_x + off_y * off_y) + _HALF_DIAGONAL * cell_m
        room_m = min(room_m, distance_m[row, col] - off - radius)
    if room_m >= _ROOM_M:
        return room_m
    return free_length_m(blocked, distance_m, cell_m, x, y, yaw, corners, outer_radius_m)


@numba.njit(cache=True)
def _swing(corners: FloatArray, turn: int, radius: float) -> float:
    """Return how far the point of the car that moves most moves in a metre driven."""
    if turn == 0:
        return 1.0
    most = radius * radius
    for k in range(len(corners)):
        x, y = corners[k, 0], corners[k, 1] - turn * radius
        most = max(most, x * x + y * y)
    return math.sqrt(most) / radius
