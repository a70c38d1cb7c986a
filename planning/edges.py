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

REEDS_SHEPP, DUBINS = 0, 1  # kinds of words
STEP_M = 0.01  # between two checked poses the car stays within its margin
_ROUNDING_M = 1e-9


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

    Poses are left out only where the room around an earlier one proves them free, whatever point of the car moves most.
    """
    x, y, yaw = x0, y0, yaw0
    for piece in range(len(lengths)):
        x, y, yaw = reeds_shepp.drive(x, y, yaw, lengths[piece], turns[piece], radius)
    if not is_free(blocked, distance_m, cell_m, x, y, yaw, corners):  # most edges that are not free end badly
        return False
    x, y, yaw = x0, y0, yaw0
    room_m = free_length_m(blocked, distance_m, cell_m, x, y, yaw, corners, outer_radius_m)
    if room_m < 0.0:
        return False
    for piece in range(len(lengths)):
        steps = math.ceil(abs(lengths[piece]) / step_m)
        if steps == 0:
            continue
        moves_m = _swing(corners, turns[piece], radius) * abs(lengths[piece]) / steps
        step = 0
        while step + int((room_m - _ROUNDING_M) / moves_m) < steps:
            step += max(int((room_m - _ROUNDING_M) / moves_m), 1)
            part = lengths[piece] * (step / steps)
            at_x, at_y, at_yaw = reeds_shepp.drive(x, y, yaw, part, turns[piece], radius)
            room_m = free_length_m(blocked, distance_m, cell_m, at_x, at_y, at_yaw, corners, outer_radius_m)
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
    """Whether the word that `steer` takes between two poses is free, at every centimetre."""
    lengths, turns = np.empty(PIECES), np.empty(PIECES, np.int64)
    steer(kind, x0, y0, yaw0, x1, y1, yaw1, radius, reverse_cost, cusp_cost, lengths, turns)
    return edge_is_free(
        blocked, distance_m, cell_m, corners, outer_radius_m, lengths, turns, x0, y0, yaw0, radius, STEP_M
    )


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
