"""Walls laid on a map that is bent against theirs: a rigid pose and a gentle deformation, found together.

A map made by odometry over tens of metres, or by a hand-held tablet, is bent: no rigid motion brings all of its walls
onto another map's. A right pose of a bent map then looks like a wrong one. What tells them apart is how much wall comes
together once a little bending is allowed: at the right place nearly all of it, at a wrong one hardly more than before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapping.map_agreement import place
from mapping.map_matching import distance_at
from mapping.wall_map import Distances, WallMap

FloatArray = NDArray[np.float64]

_TERMS = 6  # 1, x, y, x^2, xy, y^2
_LENGTH_M = 10.0  # unit of x and y
_SHIFT_M, _BEND_M = 3.0, 0.5  # standard deviations of the shift, and of every other term at one unit
_MEETS_M = 1.0  # points so near a wall tell where the maps meet
_RANGE_M, _DEPENDENT_M = 0.1, 2.0  # a wall's standard deviation, and how much of it errs alike
_SCALES_M = (1.0, 0.8, 0.6, 0.5, 0.4, 0.3, 0.25, 0.2, 0.2, 0.2)


@dataclass(frozen=True, slots=True, eq=False)
class Bent:
    """placed (K, N, 2): the points in the grid's frame, moved and bent; strain_m (K,): rms way that bending moved the
    points that met a wall, a best rigid shift apart.
    """

    placed: FloatArray
    strain_m: FloatArray


def bend_each(walls: WallMap, points: FloatArray, lengths: FloatArray, poses: FloatArray) -> Bent:
    """Lay points (N, 2), which stand for lengths (N,) of wall in m, on a map's walls from each of poses (K, 3).

    Gauss-Newton on the interpolated distance field with Geman-McClure weights of falling scale, over two polynomials of
    degree 2 about the middle of the points that meet walls. All terms but the shift are held at 0 by a standard
    deviation of 0.5 m at 10 m.
    """
    placed, strain_m = place(points, poses), np.empty(len(poses))
    _bend_each(walls.distances, walls.resolution_m, lengths, np.array(_SCALES_M), placed, strain_m)
    return Bent(placed, strain_m)


@njit(cache=True, nogil=True)
def _bend_each(
    distances: Distances,
    resolution_m: float,
    lengths: FloatArray,
    scales_m: FloatArray,
    placed: FloatArray,
    strain_m: FloatArray,
) -> None:
    """Bend the points at places (K, N, 2) where they are, and fill strain_m (K,)."""
    terms, moved = np.empty((placed.shape[1], _TERMS)), np.empty((placed.shape[1], 2))
    for k in range(placed.shape[0]):
        _fill_terms(distances, resolution_m, lengths, placed[k], terms)
        factors = np.zeros((2, _TERMS))
        for scale_m in scales_m:
            _move(terms, factors, moved)
            factors -= _step(distances, resolution_m, lengths, placed[k] + moved, terms, factors, scale_m)
        _move(terms, factors, moved)
        placed[k] += moved
        strain_m[k] = _strain(distances, resolution_m, lengths, placed[k], moved)


@njit(cache=True, nogil=True)
def _fill_terms(
    distances: Distances, resolution_m: float, lengths: FloatArray, placed: FloatArray, terms: FloatArray
) -> None:
    """Fill the polynomials' terms (N, 6) about the middle of the points that meet walls."""
    x, y, total = 0.0, 0.0, 1e-9
    for n in range(placed.shape[0]):
        if distance_at(distances, placed[n, 0] / resolution_m, placed[n, 1] / resolution_m)[0] < _MEETS_M:
            x, y, total = x + lengths[n] * placed[n, 0], y + lengths[n] * placed[n, 1], total + lengths[n]
    for n in range(placed.shape[0]):
        u, v = (placed[n, 0] - x / total) / _LENGTH_M, (placed[n, 1] - y / total) / _LENGTH_M
        terms[n, 0], terms[n, 1], terms[n, 2] = 1.0, u, v
        terms[n, 3], terms[n, 4], terms[n, 5] = u * u, u * v, v * v


@njit(cache=True, nogil=True)
def _move(terms: FloatArray, factors: FloatArray, moved: FloatArray) -> None:
    """Fill the way (N, 2) that each point is moved."""
    for n in range(terms.shape[0]):
        x = y = 0.0
        for i in range(_TERMS):
            x, y = x + factors[0, i] * terms[n, i], y + factors[1, i] * terms[n, i]
        moved[n, 0], moved[n, 1] = x, y


@njit(cache=True, nogil=True)
def _step(
    distances: Distances,
    resolution_m: float,
    lengths: FloatArray,
    placed: FloatArray,
    terms: FloatArray,
    factors: FloatArray,
    scale_m: float,
) -> FloatArray:
    """Return the Gauss-Newton step (2, 6), to be taken off the factors."""
    matrix, slope = np.zeros((2 * _TERMS, 2 * _TERMS)), np.zeros(2 * _TERMS)
    for n in range(placed.shape[0]):
        d, gx, gy = distance_at(distances, placed[n, 0] / resolution_m, placed[n, 1] / resolution_m)
        if d >= 4.0 * scale_m:
            continue
        gx, gy = gx / resolution_m, gy / resolution_m
        weight = lengths[n] / (_DEPENDENT_M * _RANGE_M**2 * (1.0 + (d / scale_m) ** 2) ** 2)
        xx, xy, yy = weight * gx * gx, weight * gx * gy, weight * gy * gy
        for i in range(_TERMS):
            slope[i] += weight * gx * d * terms[n, i]
            slope[_TERMS + i] += weight * gy * d * terms[n, i]
            for j in range(i + 1):
                product = terms[n, i] * terms[n, j]
                matrix[i, j] += product * xx
                matrix[_TERMS + i, _TERMS + j] += product * yy
                matrix[_TERMS + i, j] += product * xy
    for i in range(_TERMS):
        held = 1.0 / (_SHIFT_M if i == 0 else _BEND_M) ** 2
        for half in range(2):
            matrix[half * _TERMS + i, half * _TERMS + i] += held
            slope[half * _TERMS + i] += held * factors[half, i]
        for j in range(i):
            matrix[_TERMS + j, i] = matrix[_TERMS + i, j]
    _solve(matrix, slope)
    return slope.reshape(2, _TERMS)


@njit(cache=True, nogil=True)
def _solve(matrix: FloatArray, vector: FloatArray) -> None:
    """Replace the vector by the solution of a positive definite system, of which the lower half is read.

    Cholesky; the library's solver differs in the last bit from call to call, by where its arrays lie in memory.
    """
    size = len(vector)
    for i in range(size):
        for j in range(i + 1):
            rest = matrix[i, j]
            for k in range(j):
                rest -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = math.sqrt(rest) if i == j else rest / matrix[j, j]
    for i in range(size):
        for k in range(i):
            vector[i] -= matrix[i, k] * vector[k]
        vector[i] /= matrix[i, i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            vector[i] -= matrix[k, i] * vector[k]
        vector[i] /= matrix[i, i]


@njit(cache=True, nogil=True)
def _strain(
    distances: Distances, resolution_m: float, lengths: FloatArray, placed: FloatArray, moved: FloatArray
) -> float:
    """Return the rms way in m of the points on walls, less their mean way."""
    total, x, y, squares = 1e-9, 0.0, 0.0, 0.0
    for n in range(placed.shape[0]):
        if distance_at(distances, placed[n, 0] / resolution_m, placed[n, 1] / resolution_m)[0] < 2.0 * _RANGE_M:
            total += lengths[n]
            x, y = x + lengths[n] * moved[n, 0], y + lengths[n] * moved[n, 1]
            squares += lengths[n] * (moved[n, 0] ** 2 + moved[n, 1] ** 2)
    return math.sqrt(max(squares / total - (x / total) ** 2 - (y / total) ** 2, 0.0))
