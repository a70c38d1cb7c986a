"""Words of Dubins (Am. J. Math. 79, 1957): the shortest ways of a car that drives forwards only.

The same interface as `reeds_shepp`, whose `drive`, `sample` and `sample_count` take these words too. Formulas from the
vector between the circles on which the car turns at the start and at the end, as there.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from planning.reeds_shepp import PIECES, FloatArray, TurnArray

Best = tuple[float, int, int, int, float, float, float]  # cost in radii, turns, parameters in radii
_TOLERANCE = 1e-10  # rad, what rounding may take off a piece that is not there


@numba.njit(cache=True)
def shortest(
    x0: float,
    y0: float,
    yaw0: float,
    x1: float,
    y1: float,
    yaw1: float,
    radius: float,
    reverse_cost: float,
    cusp_cost: float,
) -> tuple[FloatArray, TurnArray, float]:
    """Return the shortest word as lengths (5,) in m, turns (5,) 1 left, -1 right, and its length, which is its cost.

    reverse_cost and cusp_cost do not matter: such a word has no cusp.
    """
    lengths, turns = np.zeros(PIECES), np.zeros(PIECES, np.int64)
    cost = shortest_into(x0, y0, yaw0, x1, y1, yaw1, radius, reverse_cost, cusp_cost, lengths, turns)
    return lengths, turns, cost


@numba.njit(cache=True)
def shortest_into(
    x0: float,
    y0: float,
    yaw0: float,
    x1: float,
    y1: float,
    yaw1: float,
    radius: float,
    reverse_cost: float,  # noqa: ARG001 - one signature for both kinds of words
    cusp_cost: float,  # noqa: ARG001 - likewise
    lengths: FloatArray,
    turns: TurnArray,
) -> float:
    """Write the word of `shortest` into lengths (5,) and turns (5,), and return its length."""
    cost, first, middle, last, t, u, v = _search(x0, y0, yaw0, x1, y1, yaw1, radius)
    lengths[:], turns[:] = 0.0, 0
    lengths[0], lengths[1], lengths[2] = t * radius, u * radius, v * radius
    turns[0], turns[1], turns[2] = first, middle, last
    return cost * radius


@numba.njit(cache=True)
def _search(x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float, radius: float) -> Best:
    cos, sin = math.cos(yaw0), math.sin(yaw0)
    dx, dy = (x1 - x0) / radius, (y1 - y0) / radius
    x, y = cos * dx + sin * dy, cos * dy - sin * dx
    phi = yaw1 - yaw0
    cos, sin = math.cos(phi), math.sin(phi)
    best = (math.inf, 0, 0, 0, 0.0, 0.0, 0.0)
    # From left circle to left and right; words that begin to the right are those in a mirror.
    best = _same_side(best, 1, x - sin, y - 1.0 + cos, phi)
    best = _same_side(best, -1, x + sin, -(y + 1.0 - cos), -phi)
    best = _other_side(best, 1, x + sin, y - 1.0 - cos, phi)
    return _other_side(best, -1, x - sin, -(y + 1.0 + cos), -phi)


@numba.njit(cache=True)
def _same_side(best: Best, side: int, xi: float, eta: float, phi: float) -> Best:
    """Try L S L, and L R L with more than half a turn to the right."""
    apart, theta = math.sqrt(xi * xi + eta * eta), math.atan2(eta, xi)
    t = _turn(theta)
    v = _turn(phi - t)
    if t + apart + v < best[0]:
        best = (t + apart + v, side, 0, side, t, apart, v)
    if apart <= 4.0:
        u = 2.0 * math.pi - 2.0 * math.asin(apart / 4.0)
        t = _turn(theta + u / 2.0)
        v = _turn(phi - t + u)
        if t + u + v < best[0]:
            best = (t + u + v, side, -side, side, t, u, v)
    return best


@numba.njit(cache=True)
def _other_side(best: Best, side: int, xi: float, eta: float, phi: float) -> Best:
    """Try L S R."""
    apart = math.sqrt(xi * xi + eta * eta)
    if apart < 2.0:
        return best
    u = math.sqrt(apart * apart - 4.0)
    t = _turn(math.atan2(eta, xi) + math.atan2(2.0, u))
    v = _turn(t - phi)
    return (t + u + v, side, 0, -side, t, u, v) if t + u + v < best[0] else best


@numba.njit(cache=True)
def _turn(angle: float) -> float:
    """Return the angle in [0, 2 pi), where what rounding leaves of a whole turn is none."""
    whole = 2.0 * math.pi
    turn = angle - whole * math.floor(angle / whole)
    return turn if turn < whole - _TOLERANCE else 0.0
