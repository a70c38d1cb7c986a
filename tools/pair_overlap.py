"""What two maps share at a pose: free space, and wall that is seen in both.

Overlap of free space is not information: open ground in common says nothing about the pose. Wall does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.spatial import cKDTree

from fusion.resampling import cut_to_known, raster_of, resample
from mapping import se2
from mapping.grid import OccupancyGrid

FloatArray = NDArray[np.float64]
_FREE_BELOW = -0.62  # log-odds of p = 0.35
_OCCUPIED_ABOVE = 0.62
_AROUND_M, _NEIGHBOURS = 0.5, 16  # where, and from how many cells, the direction of a wall is taken


@dataclass(frozen=True, slots=True)
class CommonFree:
    """Free space in m^2 that two maps share, and its share of the smaller map's free space."""

    area_m2: float
    share: float


def free_area_m2(grid: OccupancyGrid) -> float:
    """Return the area of the free cells, p < 0.35."""
    return float(np.count_nonzero(grid.log_odds < _FREE_BELOW)) * grid.resolution_m**2


def common_free(a: OccupancyGrid, b: OccupancyGrid, T_a_b: FloatArray) -> CommonFree:
    """Return the free space that two maps share at a pose (3,) of b in a."""
    seen_by_a = resample(a, se2.inverse(T_a_b), raster_of(b)) < _FREE_BELOW
    area_m2 = float(np.count_nonzero(seen_by_a & (b.log_odds < _FREE_BELOW))) * b.resolution_m**2
    smaller_m2 = min(free_area_m2(a), free_area_m2(b))
    return CommonFree(area_m2, area_m2 / smaller_m2 if smaller_m2 > 0.0 else 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class WallLine:
    """Boundary cells of a map: centres (N, 2) in m in the map frame, and the metres of wall (N,) each stands for."""

    points: FloatArray
    lengths_m: FloatArray


def wall_line(grid: OccupancyGrid) -> WallLine:
    """Return the occupied cells beside free ones: walls as their outline, without the inside of thick ones.

    A digital line of direction t has |cos t| + |sin t| cells a cell of its length: 41 % more in a diagonal. Each cell's
    length is corrected by the direction of the outline around it.
    """
    grid = cut_to_known(grid)
    free = grid.log_odds < _FREE_BELOW
    outline = (grid.log_odds > _OCCUPIED_ABOVE) & binary_dilation(free, np.ones((3, 3), np.bool_))
    rows, cols = np.nonzero(outline)
    if len(rows) == 0:
        return WallLine(np.empty((0, 2)), np.empty(0))
    direction = _directions(np.column_stack([cols, rows]).astype(np.float64), _AROUND_M / grid.resolution_m)
    staircase = np.abs(np.cos(direction)) + np.abs(np.sin(direction))
    return WallLine(grid.cell_centers(rows, cols), grid.resolution_m / staircase)


def common_wall_m(a: WallLine, b: WallLine, T_a_b: FloatArray, tolerance_m: float = 0.25) -> float:
    """Return the length in m of wall that is seen in both maps at a pose (3,) of b in a: the less of both directions.

    Wall of one map is seen in the other where that has wall within the tolerance.
    """
    if len(a.points) == 0 or len(b.points) == 0:
        return 0.0
    moved = se2.transform_points(T_a_b, b.points)
    lengths = []
    for here, there, each_m in ((moved, a.points, b.lengths_m), (a.points, moved, a.lengths_m)):
        distance, _ = cKDTree(there).query(here, distance_upper_bound=tolerance_m)
        lengths.append(float(each_m[np.isfinite(distance)].sum()))
    return min(lengths)


def _directions(cells: FloatArray, around: float) -> FloatArray:
    """Return the main direction (N,) in rad of the cells (N, 2), x and y in cells, near each of them."""
    nearest = min(_NEIGHBOURS, len(cells))
    distance, number = cKDTree(cells).query(cells, k=[*range(1, nearest + 1)], distance_upper_bound=around)
    near = np.isfinite(distance)[..., np.newaxis]
    offsets = np.where(near, cells[np.minimum(number, len(cells) - 1)] - cells[:, np.newaxis], 0.0)
    offsets -= np.where(near, offsets.sum(axis=1, keepdims=True) / near.sum(axis=1, keepdims=True), offsets)
    xx, yy = (offsets**2).sum(axis=1).T
    xy = offsets.prod(axis=2).sum(axis=1)
    return np.asarray(0.5 * np.arctan2(2.0 * xy, xx - yy))
