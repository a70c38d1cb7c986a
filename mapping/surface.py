"""Scans as surfaces: every sample with the straight piece of wall that it and its neighbours in angle lie on.

Point-to-line matching needs the direction of the wall at each sample: Censi, "An ICP variant using a point-to-line
metric" (ICRA 2008). The piece is a total-least-squares line through the neighbours that belong to the same surface.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_NEIGHBOURS = 4  # at most so many to each side
_LEAST_REACH_M = 0.15
_SPACINGS = 2.5  # neighbours may be apart by so many beam spacings at normal incidence
_THICKNESS_M = 0.03  # rms distance of the samples from their line
_THICKNESS_SHARE = 0.006  # and in proportion to the range
_FLATNESS = 0.25  # thickness / length at the most
_MOST_SAMPLES = 400  # more of one scan add cost, not accuracy


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A scan's samples in the order of their angle around the sensor.

    points (N, 2) in the body frame; angles (N,) around the sensor, rising, in [-pi, pi]; ranges (N,) from the sensor;
    normals (N, 2) of the wall, towards the sensor, (0, 0) where there is no straight wall; levels (N,): the wall is
    where normal . p = level; reaches (N,): so far along the wall the line is known, in m.
    """

    points: FloatArray
    angles: FloatArray
    ranges: FloatArray
    normals: FloatArray
    levels: FloatArray
    reaches: FloatArray


def surface_of(points: FloatArray, sensor: FloatArray) -> Surface:
    """Return the surface of a de-skewed scan (N, 2), seen from sensor (2,), all in the body frame.

    Lines are fitted to all samples; of more than _MOST_SAMPLES an even choice is returned.
    """
    _, whole = _whole_surface(points, sensor)
    some = slice(None, None, math.ceil(len(points) / _MOST_SAMPLES) or 1)
    return Surface(*(getattr(whole, field.name)[some] for field in fields(whole)))


def facings_of(points: FloatArray, sensor: FloatArray) -> FloatArray:
    """Return where the surface at each point (N, 2) of a scan seen from sensor (2,) faces: (N,) in rad.

    That is the direction of the wall's normal, towards the sensor's side; where there is no straight wall, the
    direction to the sensor.
    """
    order, whole = _whole_surface(points, sensor)
    straight = (whole.normals != 0.0).any(axis=1)
    facings = np.empty(len(points))
    facings[order] = np.where(straight, np.arctan2(whole.normals[:, 1], whole.normals[:, 0]), whole.angles + np.pi)
    return facings


def _whole_surface(points: FloatArray, sensor: FloatArray) -> tuple[NDArray[np.intp], Surface]:
    """Return the numbers (N,) of all points in the order of their angle, and the surface of them all."""
    rays = points - sensor
    angles = np.arctan2(rays[:, 1], rays[:, 0])
    order = np.argsort(angles, kind="stable")
    points, angles = np.ascontiguousarray(points[order], dtype=np.float64), np.ascontiguousarray(angles[order])
    ranges = np.hypot(rays[order, 0], rays[order, 1])
    spacing = float(np.median(np.diff(angles))) if len(points) > 2 else 0.0
    return order, Surface(points, angles, ranges, *_fit_lines(points, ranges, np.asarray(sensor, np.float64), spacing))


def share_across(normals: FloatArray) -> float:
    """Return the share, 0 to 0.5, of walls with normals (N, 2) that stand across the others: 0 in a plain corridor."""
    weak, strong = np.linalg.eigvalsh(normals.T @ normals)
    return float(weak / max(weak + strong, 1e-9))


@njit(cache=True, nogil=True)
def _fit_lines(
    points: FloatArray, ranges: FloatArray, sensor: FloatArray, spacing: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return normals (N, 2), levels (N,) and reaches (N,)."""
    count = points.shape[0]
    normals = np.zeros((count, 2))
    levels = np.zeros(count)
    reaches = np.zeros(count)
    most = min(_NEIGHBOURS, (count - 1) // 2)  # nobody is a neighbour on both sides
    for i in range(count):
        reach = max(_LEAST_REACH_M, _SPACINGS * spacing * ranges[i])
        n, sx, sy, sxx, sxy, syy = 1, 0.0, 0.0, 0.0, 0.0, 0.0
        for direction in (-1, 1):
            last_x, last_y = points[i, 0], points[i, 1]
            for step in range(1, most + 1):
                j = (i + direction * step) % count
                if math.hypot(points[j, 0] - last_x, points[j, 1] - last_y) > reach:
                    break
                last_x, last_y = points[j, 0], points[j, 1]
                dx, dy = last_x - points[i, 0], last_y - points[i, 1]
                n += 1
                sx += dx
                sy += dy
                sxx += dx * dx
                sxy += dx * dy
                syy += dy * dy
        if n < 3:
            continue
        mx, my = sx / n, sy / n
        cxx, cxy, cyy = sxx / n - mx * mx, sxy / n - mx * my, syy / n - my * my
        middle = 0.5 * (cxx + cyy)
        radius = math.hypot(0.5 * (cxx - cyy), cxy)
        thick, long = math.sqrt(max(middle - radius, 0.0)), math.sqrt(middle + radius)
        if thick > max(_THICKNESS_M, _THICKNESS_SHARE * ranges[i]) or thick > _FLATNESS * long:
            continue
        along = 0.5 * math.atan2(2.0 * cxy, cxx - cyy)
        nx, ny = -math.sin(along), math.cos(along)
        if nx * (sensor[0] - points[i, 0]) + ny * (sensor[1] - points[i, 1]) < 0.0:
            nx, ny = -nx, -ny
        normals[i, 0], normals[i, 1] = nx, ny
        levels[i] = nx * (points[i, 0] + mx) + ny * (points[i, 1] + my)
        reaches[i] = reach
    return normals, levels, reaches
