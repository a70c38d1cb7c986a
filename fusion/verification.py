"""Stage 5 of Algorithm 3: is the motion to be believed (thesis section 3.6.1)?

The thesis asks for enough inliers and a high acceptance index. Ratios alone do not tell a right pose from a wrong one
that overlaps by little, and two wings of one building look alike in their free space; what tells them apart are
walls: how many metres of wall both maps show in one place, and how much wall one map has where the other saw through.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from fusion.identity import known_area_m2
from fusion.resampling import Raster, raster_of, resample
from mapping import se2
from mapping.grid import OccupancyGrid

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]
_FREE_BELOW, _OCCUPIED_ABOVE = -0.62, 0.62  # log-odds of p = 0.35 and 0.65: the rest says neither
_WALL_TOLERANCE_M = 0.15  # two walls this close are one
_CONFLICT_M = 0.30  # a wall this far from any other, where the other map is free, contradicts it
_TOLERANCE_CELLS, _CONFLICT_CELLS = 2.0, 4.0  # at the least, for coarse maps


@dataclass(frozen=True, slots=True)
class Agreement:
    """What two maps say about each other at one pose.

    acceptance is omega (3.15); overlap the cells known in both, of the known cells of the smaller map; wall_m the
    length of the wall that both confirm; conflict the share of the walls, of either map and within the other's known
    cells, that stand in the other's free space.
    """

    acceptance: float
    overlap: float
    wall_m: float
    conflict: float


@dataclass(frozen=True, slots=True)
class AcceptanceRule:
    """What a motion must reach to be believed; conflict is at most max_conflict."""

    min_inliers: int
    min_acceptance: float
    min_wall_m: float = 0.0
    max_conflict: float = 1.0


def compare(a: OccupancyGrid, b: OccupancyGrid, T_a_b: FloatArray) -> Agreement:
    """Count where two maps agree at a pose; both are looked up on the cells of the coarser one."""
    if a.resolution_m < b.resolution_m:
        a, b, T_a_b = b, a, se2.inverse(T_a_b)
    raster = raster_of(a)
    cells_a, cells_b = a.log_odds, _without_lost_walls(b, T_a_b, raster)
    known_a, known_b = cells_a != 0.0, cells_b != 0.0
    free_a, free_b = cells_a < _FREE_BELOW, cells_b < _FREE_BELOW
    wall_a, wall_b = cells_a > _OCCUPIED_ABOVE, cells_b > _OCCUPIED_ABOVE
    agreeing = np.count_nonzero((free_a & free_b) | (wall_a & wall_b))
    disagreeing = np.count_nonzero((free_a & wall_b) | (wall_a & free_b))
    cell_m2 = a.resolution_m**2
    smaller = min(known_area_m2(a), known_area_m2(b)) / cell_m2
    confirmed_a, against_a = _confirmation(wall_a, wall_b, free_b, a.resolution_m)
    confirmed_b, against_b = _confirmation(wall_b, wall_a, free_a, a.resolution_m)
    judged = confirmed_a + confirmed_b + against_a + against_b
    return Agreement(
        acceptance=agreeing / (agreeing + disagreeing) if agreeing else 0.0,
        overlap=min(1.0, np.count_nonzero(known_a & known_b) / smaller) if smaller else 0.0,
        wall_m=min(confirmed_a, confirmed_b) * a.resolution_m,
        conflict=(against_a + against_b) / judged if judged else 0.0,
    )


def objection(agreement: Agreement, inliers: int, rule: AcceptanceRule) -> str | None:
    """Return the first condition that is not met, as text; None if the motion is to be believed."""
    if inliers < rule.min_inliers:
        return f"{inliers} matches agree on the best motion, {rule.min_inliers} are needed"
    if agreement.acceptance < rule.min_acceptance:
        return f"the acceptance index is {agreement.acceptance:.3f}, {rule.min_acceptance:g} is needed"
    if agreement.wall_m < rule.min_wall_m:
        return f"{agreement.wall_m:.1f} m of wall are seen in both maps, {rule.min_wall_m:g} m are needed"
    if agreement.conflict > rule.max_conflict:
        return (
            f"{agreement.conflict:.0%} of the walls stand where the other map saw free space, "
            f"at most {rule.max_conflict:.0%} may"
        )
    return None


def _without_lost_walls(b: OccupancyGrid, T_a_b: FloatArray, raster: Raster) -> NDArray[np.float32]:
    """Return b on the raster; a wall thinner than the raster's cell is kept although no cell's centre hits it."""
    cells = resample(b, T_a_b, raster)
    if b.resolution_m >= raster.resolution_m:
        return cells
    rows, cols = np.nonzero(b.log_odds > _OCCUPIED_ABOVE)
    corner = se2.inverse(raster.origin)
    points = se2.transform_points(se2.compose(corner, T_a_b), b.cell_centers(rows, cols)) / raster.resolution_m
    col, row = np.floor(points).astype(np.int64).T
    inside = (col >= 0) & (col < raster.shape[1]) & (row >= 0) & (row < raster.shape[0])
    cells[row[inside], col[inside]] = b.log_odds[rows[inside], cols[inside]]
    return cells


def _confirmation(wall: Mask, other_wall: Mask, other_free: Mask, resolution_m: float) -> tuple[int, int]:
    """Return how many wall cells lie on the other map's walls, and how many clearly in its free space."""
    if not other_wall.any():
        return 0, int(np.count_nonzero(wall & other_free))
    distance_cells = cv2.distanceTransform((~other_wall).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
    near = max(_WALL_TOLERANCE_M / resolution_m, _TOLERANCE_CELLS)
    far = max(_CONFLICT_M / resolution_m, _CONFLICT_CELLS)
    confirmed = np.count_nonzero(wall & (distance_cells <= near))
    return int(confirmed), int(np.count_nonzero(wall & other_free & (distance_cells > far)))
