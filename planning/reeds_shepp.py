"""Words of Reeds and Shepp (Pacific J. Math. 145, 1990, section 8): how a car that may reverse gets from pose to pose.

A word is up to five pieces, each an arc of the turning radius or a straight line, driven forwards or backwards. All 48
words follow from few formulas by going the other way in time, by mirroring left and right, and by driving the word from
its end to its start. Every formula depends only on the vector from the circle that the car turns on at the start to the
one that it turns on at the end, so that four vectors (left or right at either end) do for all words.

Without fastmath: words of the same length are many, and which is taken must not hang on how a sum was rounded.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
TurnArray = NDArray[np.int64]
Best = tuple[float, int, float, float, float]  # cost and parameters in radii, word by the numbers below

PIECES = 5
_TOLERANCE = 1e-10  # rad, what rounding may take off a piece that is not there
_FLIP, _MIRROR, _BACKWARDS = 8, 16, 32  # added to the number of a formula
_LSL, _LSR, _LRL, _LRLR_ONE_CUSP, _LRLR_TWO_CUSPS, _LRSL, _LRSR, _LRSLR = range(8)
_QUARTER = math.pi / 2.0


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
    """Return the word of least cost as lengths (5,) in m, below zero backwards, turns (5,) 1 left, -1 right, and cost.

    A metre backwards counts reverse_cost, a change of gear cusp_cost in m; with 1 and 0 the cost is the length of the
    shortest path. Pieces that a word does not have are zero.
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
    reverse_cost: float,
    cusp_cost: float,
    lengths: FloatArray,
    turns: TurnArray,
) -> float:
    """Write the word of `shortest` into lengths (5,) and turns (5,), and return its cost."""
    best = _search(x0, y0, yaw0, x1, y1, yaw1, radius, reverse_cost, cusp_cost)
    _spell(best, radius, lengths, turns)
    return best[0] * radius


@numba.njit(cache=True)
def _search(
    x0: float,
    y0: float,
    yaw0: float,
    x1: float,
    y1: float,
    yaw1: float,
    radius: float,
    reverse_cost: float,
    cusp_cost: float,
) -> Best:
    cos, sin = math.cos(yaw0), math.sin(yaw0)
    dx, dy = (x1 - x0) / radius, (y1 - y0) / radius
    x, y = cos * dx + sin * dy, cos * dy - sin * dx
    phi = _wrap(yaw1 - yaw0)
    cos, sin = math.cos(phi), math.sin(phi)
    cusp = cusp_cost / radius
    best = (math.inf, 0, 0.0, 0.0, 0.0)
    # From left circle to left, from right to right; the mirrored word sees the second one mirrored.
    best = _same_side(best, x - sin, y - 1.0 + cos, phi, 0, reverse_cost, cusp)
    best = _same_side(best, x + sin, -(y + 1.0 - cos), -phi, _MIRROR, reverse_cost, cusp)
    best = _other_side(best, x + sin, y - 1.0 - cos, phi, 0, reverse_cost, cusp)
    return _other_side(best, x - sin, -(y + 1.0 + cos), -phi, _MIRROR, reverse_cost, cusp)


@numba.njit(cache=True)
def _same_side(best: Best, xi: float, eta: float, phi: float, mirror: int, reverse_cost: float, cusp: float) -> Best:
    """Try the words whose last circle is on the same side as the first: formulas 8.1, 8.3, 8.4 and 8.9."""
    apart, theta = math.sqrt(xi * xi + eta * eta), math.atan2(eta, xi)
    turned = 2.0 * math.asin(apart / 4.0) if apart <= 4.0 else 0.0
    tangent = math.sqrt(apart * apart - 4.0) if apart >= 2.0 else 0.0
    tilt = math.atan2(tangent, -2.0)
    for flip in range(2):
        ahead, back = (1.0, reverse_cost) if flip == 0 else (reverse_cost, 1.0)
        word = mirror + flip * _FLIP
        if flip == 1:
            theta, phi = math.pi - theta, -phi
        best = _lsl(best, apart, theta, phi, word, ahead)
        # Driven from its end, a word sees the circles in the direction phi - theta.
        if apart <= 4.0:
            best = _lrl(best, turned, theta, phi, word, ahead, back, cusp)
            best = _lrl(best, turned, phi - theta, phi, word + _BACKWARDS, ahead, back, cusp)
        if tangent >= 2.0:
            best = _lrsl(best, tangent, theta + tilt, phi, word, ahead, back, cusp)
            best = _lrsl(best, tangent, phi - theta + tilt, phi, word + _BACKWARDS, ahead, back, cusp)
    return best


@numba.njit(cache=True)
def _other_side(best: Best, xi: float, eta: float, phi: float, mirror: int, reverse_cost: float, cusp: float) -> Best:
    """Try the words whose last circle is on the other side than the first: 8.2, 8.7, 8.8, 8.10 and 8.11."""
    apart, theta = math.sqrt(xi * xi + eta * eta), math.atan2(eta, xi)
    tangent = math.sqrt(apart * apart - 4.0) if apart >= 2.0 else 0.0
    lean = math.atan2(2.0, tangent)
    cosine = (20.0 - apart * apart) / 16.0
    for flip in range(2):
        ahead, back = (1.0, reverse_cost) if flip == 0 else (reverse_cost, 1.0)
        word = mirror + flip * _FLIP
        if flip == 1:
            theta, phi = math.pi - theta, -phi
        if apart >= 2.0:
            best = _lsr(best, tangent, theta + lean, phi, word, ahead)
            best = _lrsr(best, apart, theta, phi, word, ahead, back, cusp)
            # Driven from its end, the mirrored word has these circles: from the left to the right.
            from_end = (word ^ _MIRROR) + _BACKWARDS
            best = _lrsr(best, apart, theta - phi, -phi, from_end, ahead, back, cusp)
        else:
            best = _lrlr_one_cusp(best, apart, theta, phi, word, ahead, back, cusp)
        if 0.0 <= cosine <= 1.0:
            best = _lrlr_two_cusps(best, cosine, theta, phi, word, ahead, back, cusp)
        if tangent >= 4.0:
            best = _lrslr(best, tangent, theta + lean + _QUARTER, phi, word, ahead, back, cusp)
    return best


@numba.njit(cache=True)
def _lsl(best: Best, apart: float, theta: float, phi: float, word: int, ahead: float) -> Best:
    """L+ S+ L+, formula 8.1."""
    t = _ahead(theta)
    v = _ahead(phi - t)
    if t < 0.0 or v < 0.0:
        return best
    return _better(best, ahead * (t + apart + v), word + _LSL, t, apart, v)


@numba.njit(cache=True)
def _lsr(best: Best, tangent: float, toward: float, phi: float, word: int, ahead: float) -> Best:
    """L+ S+ R+, formula 8.2."""
    t = _ahead(toward)
    v = _ahead(t - phi)
    if t < 0.0 or v < 0.0:
        return best
    return _better(best, ahead * (t + tangent + v), word + _LSR, t, tangent, v)


@numba.njit(cache=True)
def _lrl(
    best: Best, turned: float, theta: float, phi: float, word: int, ahead: float, back: float, cusp: float
) -> Best:
    """L+ R- L+ and L+ R- L-, formulas 8.3 and 8.4."""
    t = _ahead(theta - turned / 2.0 + math.pi)
    if t < 0.0:
        return best
    v = _wrap(phi - t - turned)
    if abs(v) < _TOLERANCE:
        v = 0.0
    last = ahead * v + cusp if v > 0.0 else -back * v
    return _better(best, ahead * t + back * turned + cusp + last, word + _LRL, t, -turned, v)


@numba.njit(cache=True)
def _lrlr_one_cusp(
    best: Best, apart: float, theta: float, phi: float, word: int, ahead: float, back: float, cusp: float
) -> Best:
    """L+ R+u L-u R-, formula 8.7."""
    u = math.acos((2.0 + apart) / 4.0)
    t = _ahead(theta + u + _QUARTER)
    v = _ahead(phi - t + 2.0 * u)
    if t < 0.0 or v < 0.0:
        return best
    return _better(best, ahead * (t + u) + back * (u + v) + cusp, word + _LRLR_ONE_CUSP, t, u, -v)


@numba.njit(cache=True)
def _lrlr_two_cusps(
    best: Best, cosine: float, theta: float, phi: float, word: int, ahead: float, back: float, cusp: float
) -> Best:
    """L+ R-u L-u R+, formula 8.8."""
    u = math.acos(cosine)
    t = _ahead(theta + _QUARTER + math.atan2(math.sqrt(1.0 - cosine * cosine), 2.0 - cosine))
    v = _ahead(t - phi)
    if t < 0.0 or v < 0.0:
        return best
    return _better(best, ahead * (t + v) + back * 2.0 * u + 2.0 * cusp, word + _LRLR_TWO_CUSPS, t, -u, v)


@numba.njit(cache=True)
def _lrsl(
    best: Best, tangent: float, toward: float, phi: float, word: int, ahead: float, back: float, cusp: float
) -> Best:
    """L+ R-quarter S- L-, formula 8.9."""
    t = _ahead(toward)
    v = _ahead(t + _QUARTER - phi)
    if t < 0.0 or v < 0.0:
        return best
    u = tangent - 2.0
    return _better(best, ahead * t + back * (_QUARTER + u + v) + cusp, word + _LRSL, t, -u, -v)


@numba.njit(cache=True)
def _lrsr(
    best: Best, apart: float, theta: float, phi: float, word: int, ahead: float, back: float, cusp: float
) -> Best:
    """L+ R-quarter S- R-, formula 8.10."""
    t = _ahead(theta + _QUARTER)
    v = _ahead(phi - t - _QUARTER)
    if t < 0.0 or v < 0.0:
        return best
    u = apart - 2.0
    return _better(best, ahead * t + back * (_QUARTER + u + v) + cusp, word + _LRSR, t, -u, -v)


@numba.njit(cache=True)
def _lrslr(
    best: Best, tangent: float, toward: float, phi: float, word: int, ahead: float, back: float, cusp: float
) -> Best:
    """L+ R-quarter S- L-quarter R+, formula 8.11."""
    t = _ahead(toward)
    v = _ahead(t - phi)
    if t < 0.0 or v < 0.0:
        return best
    u = tangent - 4.0
    return _better(best, ahead * (t + v) + back * (math.pi + u) + 2.0 * cusp, word + _LRSLR, t, -u, v)


@numba.njit(cache=True)
def _better(best: Best, cost: float, word: int, t: float, u: float, v: float) -> Best:
    return (cost, word, t, u, v) if cost < best[0] else best


@numba.njit(cache=True)
def _wrap(angle: float) -> float:
    """Return the angle in [-pi, pi)."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@numba.njit(cache=True)
def _ahead(angle: float) -> float:
    """Return the angle in [0, pi], or -1 where that is not possible."""
    wrapped = _wrap(angle)
    if wrapped >= 0.0:
        return wrapped
    if wrapped > -_TOLERANCE:
        return 0.0
    return math.pi if wrapped < _TOLERANCE - math.pi else -1.0


@numba.njit(cache=True)
def _spell(best: Best, radius: float, lengths: FloatArray, turns: TurnArray) -> None:
    """Write a word's pieces into lengths (5,) in m and turns (5,)."""
    _, word, t, u, v = best
    formula = word & 7
    lengths[:], turns[:] = 0.0, 0
    count = 3
    lengths[0], lengths[1], lengths[2] = t, u, v
    turns[0], turns[1], turns[2] = 1, -1, 1
    if formula in (_LSL, _LSR):
        turns[1] = 0
        turns[2] = 1 if formula == _LSL else -1
    elif formula in (_LRLR_ONE_CUSP, _LRLR_TWO_CUSPS):
        count = 4
        lengths[2], lengths[3] = (-u if formula == _LRLR_ONE_CUSP else u), v
        turns[3] = -1
    elif formula in (_LRSL, _LRSR):
        count = 4
        lengths[1], lengths[2], lengths[3] = -_QUARTER, u, v
        turns[2], turns[3] = 0, (1 if formula == _LRSL else -1)
    elif formula == _LRSLR:
        count = 5
        lengths[1], lengths[2], lengths[3], lengths[4] = -_QUARTER, u, -_QUARTER, v
        turns[2], turns[3], turns[4] = 0, 1, -1
    if word & _BACKWARDS:
        for i in range(count // 2):
            j = count - 1 - i
            lengths[i], lengths[j] = lengths[j], lengths[i]
            turns[i], turns[j] = turns[j], turns[i]
    scale, side = (-radius if word & _FLIP else radius), (-1 if word & _MIRROR else 1)
    for i in range(count):
        lengths[i] *= scale
        turns[i] *= side


@numba.njit(cache=True)
def drive(x: float, y: float, yaw: float, length_m: float, turn: int, radius: float) -> tuple[float, float, float]:
    """Return the pose after one piece from a pose; yaw goes on, beyond pi if need be."""
    if turn == 0:
        return x + length_m * math.cos(yaw), y + length_m * math.sin(yaw), yaw
    # The chord, whose direction is that of the middle of the arc.
    half = length_m / (2.0 * radius)
    chord, middle = 2.0 * radius * math.sin(half), yaw + turn * half
    return x + chord * math.cos(middle), y + chord * math.sin(middle), yaw + turn * 2.0 * half


@numba.njit(cache=True)
def sample_count(lengths: FloatArray, step_m: float) -> int:
    """Return how many poses `sample` makes of lengths (5,)."""
    count = 1
    for piece in range(len(lengths)):
        count += math.ceil(abs(lengths[piece]) / step_m)
    return count


@numba.njit(cache=True)
def sample(
    x0: float,
    y0: float,
    yaw0: float,
    lengths: FloatArray,
    turns: TurnArray,
    radius: float,
    step_m: float,
    out: FloatArray,
    gears: NDArray[np.int8],
) -> int:
    """Write poses along a word into out (N, 3), N of `sample_count` or more, and gears (N,); return how many.

    The first is the start as given, the last the end, and each piece's end is one of them; neighbours are at most
    step_m of driving apart. A gear, 1 or -1, is that of the motion that leaves its pose, at the last one of that which
    reached it. yaw goes on, beyond pi if need be. Raises ValueError where there is no room.
    """
    x, y, yaw = x0, y0, yaw0
    if len(out) < sample_count(lengths, step_m) or len(gears) < len(out):
        raise ValueError("sample: less room than sample_count says")
    out[0, 0], out[0, 1], out[0, 2] = x, y, yaw
    gears[0] = 1
    count = 1
    for piece in range(len(lengths)):
        steps = math.ceil(abs(lengths[piece]) / step_m)
        gear = 1 if lengths[piece] > 0.0 else -1
        for step in range(1, steps + 1):
            part = lengths[piece] * (step / steps)
            out[count, 0], out[count, 1], out[count, 2] = drive(x, y, yaw, part, turns[piece], radius)
            gears[count - 1] = gears[count] = gear
            count += 1
        x, y, yaw = out[count - 1, 0], out[count - 1, 1], out[count - 1, 2]
    return count
