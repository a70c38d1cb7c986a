"""Where do seen points fit a saved map? Refinement of a pose below a cell, and how firmly the walls hold it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapping import se2
from mapping.place_evidence import HIT_M
from mapping.wall_faces import WallFaces, facing_layer
from mapping.wall_map import FAR_M, Distances, WallMap

FloatArray = NDArray[np.float64]

_RANGE_M = 0.05  # standard deviation of a point's distance to the map's wall
_NORMAL_RAD = 0.2  # scatter of the walls' directions on a grid
_STEP_M, _STEP_RAD = 0.3, 0.1  # of one iteration at the most
_DEPENDENT = 10.0  # neighbouring points err alike: so many count as one


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A refined pose (3,), and the normal matrix (3, 3) of x, y in m and yaw in rad, about the pose's own origin.

    hits: share of the points (as many as `points`) that lie on walls.
    """

    pose: FloatArray
    information: FloatArray
    hits: float
    points: int


def refine(
    faces: WallFaces,
    points: FloatArray,
    facings_rad: FloatArray,
    pose: FloatArray,
    *,
    scales_m: tuple[float, ...] = (0.4, 0.3, 0.25, 0.2, 0.16, 0.13, 0.1, 0.1, 0.1, 0.1, 0.1),
    prior: FloatArray | None = None,
) -> Fit:
    """Return the pose in the grid's frame near `pose` (3,) at which the points (N, 2) lie best on walls.

    facings_rad (N,): where the surface that a point lies on faces, in the points' frame (surface.facings_of): only
    walls that can be seen so count for it. Gauss-Newton on the interpolated distance field with Geman-McClure weights
    of falling scale; prior (3, 3): the information with which `pose` itself holds.
    """
    held = np.zeros((3, 3)) if prior is None else prior
    scales = np.array(scales_m, dtype=np.float64)
    start = np.array(pose, dtype=np.float64)
    facings = np.ascontiguousarray(facings_rad, dtype=np.float64)
    resolution_m = faces.walls.resolution_m
    found, matrix, hits = _gauss_newton(faces.distances, resolution_m, points, facings, start, scales, held)
    found[2] = se2.wrap_angle(found[2])
    return Fit(found, matrix, hits / max(len(points), 1), len(points))


def refine_each(walls: WallMap, points: FloatArray, poses: FloatArray, scales_m: tuple[float, ...]) -> FloatArray:
    """Return the poses (K, 3) that `refine` reaches from each of poses (K, 3); angles are not wrapped.

    The points (N, 2) should lie about the origin of their frame: a step turns about it.
    """
    scales = np.array(scales_m, dtype=np.float64)
    field = walls.distances[np.newaxis]  # of all walls, whatever they face
    return _refine_each(field, walls.resolution_m, points, np.ascontiguousarray(poses), scales)


def structure(fit: Fit) -> float:
    """Return how firmly the walls hold a fit in its weakest direction, 0..0.5: mean square of the normals' component.

    Normals of a rough wall scatter and fake a hold along it: what a scatter of _NORMAL_RAD fakes is taken off.
    """
    weakest, total = _spread(fit)
    return float((weakest - _NORMAL_RAD**2 * total) * _DEPENDENT * _RANGE_M**2 / max(fit.points, 1))


def covariance_of(fit: Fit, turn_rad: float) -> FloatArray:
    """Return the covariance (3, 3) of the fit's x, y and yaw, in a frame in which the grid's frame is turned by that.

    Along the weakest direction it is as wide as the hold without what scattering normals fake allows.
    """
    values, vectors = np.linalg.eigh(fit.information[:2, :2])
    faked = max(values[0] - _NORMAL_RAD**2 * values.sum(), 1e-3 * values[0] + 1e-6)
    weak = np.array([*vectors[:, 0], 0.0])
    covariance = np.linalg.inv(fit.information + 1e-6 * np.eye(3))
    covariance += np.outer(weak, weak) * (1.0 / faked - 1.0 / max(values[0], faked))
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turn @ covariance @ turn.T)


def _spread(fit: Fit) -> tuple[float, float]:
    """Return the least eigenvalue and the trace of the normal matrix of x and y."""
    values = np.linalg.eigvalsh(fit.information[:2, :2])
    return float(values[0]), float(values.sum())


@njit(cache=True, nogil=True)
def distance_at(distances: Distances, x: float, y: float) -> tuple[float, float, float]:
    """Return the interpolated distance and its slope, in units of the field a cell, at x, y in cells."""
    fx, fy = x - 0.5, y - 0.5
    col, row = math.floor(fx), math.floor(fy)
    if col < 0 or row < 0 or col + 1 >= distances.shape[1] or row + 1 >= distances.shape[0]:
        return FAR_M, 0.0, 0.0
    u, v = fx - col, fy - row
    a, b = distances[row, col], distances[row, col + 1]
    c, d = distances[row + 1, col], distances[row + 1, col + 1]
    low, high = a + u * (b - a), c + u * (d - c)
    return low + v * (high - low), (1.0 - v) * (b - a) + v * (d - c), high - low


@njit(cache=True, nogil=True)
def _solve(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Return the solution (3,) of a symmetric positive definite system, by Cramer's rule."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 1], matrix[1, 2], matrix[2, 2]
    i, j, k = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * i + b * j + c * k
    p, q, r = a * f - c * c, b * c - a * e, a * d - b * b
    x, y, z = vector[0], vector[1], vector[2]
    solution = np.zeros(3)
    solution[0] = (i * x + j * y + k * z) / determinant
    solution[1] = (j * x + p * y + q * z) / determinant
    solution[2] = (k * x + q * y + r * z) / determinant
    return solution


@njit(cache=True, nogil=True)
def _gauss_newton(
    distances: Distances,
    resolution_m: float,
    points: FloatArray,
    facings: FloatArray,
    start: FloatArray,
    scales_m: FloatArray,
    held: FloatArray,
) -> tuple[FloatArray, FloatArray, int]:
    """Return the pose (3,), its information (3, 3) and the number of points on walls, after a step at each scale.

    distances (K, rows, cols): one layer a facing, or a single one for all.
    """
    found = start.copy()
    weight = 1.0 / (_DEPENDENT * _RANGE_M**2)
    matrix, gradient = np.zeros((3, 3)), np.zeros(3)
    for scale_m in scales_m:
        matrix[:], gradient[:] = 0.0, 0.0
        _accumulate(distances, resolution_m, points, facings, found, scale_m, matrix, gradient)
        away = found - start
        away[2] = (away[2] + math.pi) % (2.0 * math.pi) - math.pi
        damped = weight * matrix + held
        slope = weight * gradient + held @ away
        for i in range(3):
            damped[i, i] += 1e-6 + 1e-3 * damped[i, i]
        step = _solve(damped, slope)
        moved, turned = max(math.hypot(step[0], step[1]), 1e-12), max(abs(step[2]), 1e-12)
        found -= min(1.0, _STEP_M / moved, _STEP_RAD / turned) * step
    matrix[:], gradient[:] = 0.0, 0.0
    hits = _accumulate(distances, resolution_m, points, facings, found, scales_m[-1], matrix, gradient)
    return found, weight * matrix + held, hits


@njit(cache=True, nogil=True)
def _accumulate(
    distances: Distances,
    resolution_m: float,
    points: FloatArray,
    facings: FloatArray,
    pose: FloatArray,
    scale_m: float,
    matrix: FloatArray,
    gradient: FloatArray,
) -> int:
    """Add up matrix (3, 3) and gradient (3,) of the points' weighted squared distances; return the points on walls."""
    hits = 0
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    for n in range(points.shape[0]):
        rx, ry = cos * points[n, 0] - sin * points[n, 1], sin * points[n, 0] + cos * points[n, 1]
        layer = facing_layer(facings[n] + pose[2]) if distances.shape[0] > 1 else 0
        d, gx, gy = distance_at(distances[layer], (pose[0] + rx) / resolution_m, (pose[1] + ry) / resolution_m)
        if d >= 4.0 * scale_m:
            continue
        hits += d <= HIT_M
        gx, gy = gx / resolution_m, gy / resolution_m
        robust = 1.0 / (1.0 + (d / scale_m) ** 2) ** 2
        jacobian = (gx, gy, gy * rx - gx * ry)
        for i in range(3):
            gradient[i] += robust * jacobian[i] * d
            for j in range(3):
                matrix[i, j] += robust * jacobian[i] * jacobian[j]
    return hits


@njit(cache=True, nogil=True)
def _refine_each(
    distances: Distances, resolution_m: float, points: FloatArray, poses: FloatArray, scales_m: FloatArray
) -> FloatArray:
    refined = np.empty_like(poses)
    held, facings = np.zeros((3, 3)), np.zeros(points.shape[0])
    for k in range(poses.shape[0]):
        refined[k] = _gauss_newton(distances, resolution_m, points, facings, poses[k], scales_m, held)[0]
    return refined
