"""The car: the outline of its body around base_link (the middle of the rear axle), how it turns, what it avoids."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from planning.errors import PlanningError

FloatArray = NDArray[np.float64]
Corners = tuple[tuple[float, float], ...]

LEAST_RADIUS_M = 0.2
BETWEEN_POSES_M = 5e-4  # between two poses a millimetre apart a swinging corner comes so much nearer at most
_QCAR: Corners = ((-0.0845, -0.096), (0.3405, -0.096), (0.3405, 0.096), (-0.0845, 0.096))


@dataclass(frozen=True, slots=True)
class Vehicle:
    """Lengths in m, poses of base_link.

    footprint: corners (x, y) of the body from base_link, which lies inside; of an outline that is not convex the hull
    counts, and is kept, counter-clockwise. margin_m is added to every side while planning (corners stay sharp), and
    half a millimetre for what lies between two poses that are checked.
    reverse_cost: what a metre backwards costs in metres forwards; cusp_cost_m: what a change of gear costs.

    Defaults: Quanser QCar, wheel base 0.256 m and steering of 30 deg (Quanser's configuration files), which turns on
    0.443 m; 1.3 times that leaves the follower something to steer with. The body, 0.425 m x 0.192 m, is not in any
    source found and should be measured. Raises PlanningError for values that make no car.

    corners (K, 2) with the margin and body (K, 2) without follow, as do inradius_m and outer_radius_m, the largest
    circle about base_link inside `corners` and the smallest around it. The arrays are not to be written to; they are
    not marked so because compiled code would then be compiled once more, for arrays that came out of a pickle.
    """

    footprint: Corners = _QCAR
    turning_radius_m: float = 0.576
    margin_m: float = 0.01
    reverse_cost: float = 1.5
    cusp_cost_m: float = 0.3
    forward_only: bool = False
    body: FloatArray = field(init=False, repr=False, compare=False)
    corners: FloatArray = field(init=False, repr=False, compare=False)
    inradius_m: float = field(init=False, repr=False, compare=False)
    outer_radius_m: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        radius_m = self.turning_radius_m
        if not (math.isfinite(radius_m) and radius_m >= LEAST_RADIUS_M):
            raise PlanningError(
                f"vehicle: turning_radius_m is {radius_m}, expected {LEAST_RADIUS_M} or more: paths are checked every "
                "centimetre, too coarse for tighter turns"
            )
        for name, least in (("margin_m", 0.0), ("reverse_cost", 1.0), ("cusp_cost_m", 0.0)):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= least):
                raise PlanningError(f"vehicle: {name} is {value}, expected {least:g} or more")
        body = np.array(_hull(self.footprint))
        corners = _grown(body, self.margin_m + BETWEEN_POSES_M)
        derived = {
            "footprint": tuple((float(x), float(y)) for x, y in body),
            "body": body,
            "corners": corners,
            "inradius_m": float(_depths(corners).min()),
            "outer_radius_m": float(np.hypot(corners[:, 0], corners[:, 1]).max()),
        }
        if _depths(body).min() <= 0.0:
            raise PlanningError(
                f"vehicle: base_link (0, 0) is not inside the footprint {derived['footprint']}: give the corners in m "
                "from the middle of the rear axle"
            )
        for name, value in derived.items():
            object.__setattr__(self, name, value)

    @property
    def area_m2(self) -> float:
        """The area of the body."""
        x, y = self.body.T
        return float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2.0)


def _hull(points: Corners) -> list[tuple[float, float]]:
    """Return the convex hull counter-clockwise, without corners on straight sides (Andrew 1979)."""
    try:
        ordered = sorted({(float(x), float(y)) for x, y in points})
    except (TypeError, ValueError) as error:
        raise PlanningError(f"vehicle: footprint is {points!r}, expected corners (x, y) in m") from error
    if not all(math.isfinite(value) for point in ordered for value in point):
        raise PlanningError(f"vehicle: footprint {points} has a corner that is not finite, expected x and y in m")
    lower, upper = _chain(ordered), _chain(ordered[::-1])
    hull = lower[:-1] + upper[:-1]
    if len(hull) < 3:
        raise PlanningError(f"vehicle: footprint {points} encloses no area: give three corners or more")
    return hull


def _chain(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    chain: list[tuple[float, float]] = []
    for x, y in points:
        while len(chain) > 1:
            (ax, ay), (bx, by) = chain[-2:]
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 1e-12:
                break
            chain.pop()
        chain.append((x, y))
    return chain


def _normals(corners: FloatArray) -> FloatArray:
    """Return the outward unit normal (K, 2) of the side that begins at each corner."""
    sides = np.roll(corners, -1, axis=0) - corners
    return np.column_stack([sides[:, 1], -sides[:, 0]]) / np.hypot(sides[:, 0], sides[:, 1])[:, np.newaxis]


def _depths(corners: FloatArray) -> FloatArray:
    """Return how far (K,) inside each side base_link lies."""
    return np.asarray((_normals(corners) * corners).sum(axis=1))


def _grown(body: FloatArray, margin_m: float) -> FloatArray:
    """Move every side outwards; a corner goes to where its two sides then meet."""
    after = _normals(body)
    before = np.roll(after, 1, axis=0)
    share = 1.0 + (before * after).sum(axis=1, keepdims=True)
    return np.ascontiguousarray(body + margin_m * (before + after) / share)
