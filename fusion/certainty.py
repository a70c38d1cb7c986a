"""Stage 6 of Algorithm 3: the cells of two maps joined by Bayes' rule (thesis section 3.6.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.identity import precedes, same_evidence
from fusion.resampling import cut_to_known, known_corners, raster_around, resample
from mapping import se2
from mapping.grid import LOG_ODDS_CLAMP, LogOdds, OccupancyGrid

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FusedMap:
    """The global map, the poses (3,) of both maps' frames in its frame, and whether both were one and the same map."""

    grid: OccupancyGrid
    T_global_a: FloatArray
    T_global_b: FloatArray
    counted_once: bool


def fuse_log_odds(a: LogOdds, b: LogOdds) -> LogOdds:
    """Return Bayes' rule (3.16) for independent evidence in log-odds (rows, cols): the sum, clamped as every grid is.

    Associative and commutative up to the clamp, as (3.17) is; unknown, 0, changes nothing.
    """
    return np.asarray(np.clip(a + b, -LOG_ODDS_CLAMP, LOG_ODDS_CLAMP), dtype=np.float32)


def fuse_pair(a: OccupancyGrid, b: OccupancyGrid, T_a_b: FloatArray) -> FusedMap:
    """Fuse two maps at a known relative pose (3,); each must have a known cell.

    The global frame is that of the map with more known area, the resolution the finer of the two, the origin on whole
    cells: the order of the two maps changes nothing. The same map twice is one evidence and counts once.
    """
    swapped = precedes(b, a)
    first, second, T_first_second = (b, a, se2.inverse(T_a_b)) if swapped else (a, b, np.asarray(T_a_b, np.float64))
    once = same_evidence(a, b)
    corners = [known_corners(first)]
    if not once:
        corners.append(se2.transform_points(T_first_second, known_corners(second)))
    raster = raster_around(np.vstack(corners), min(a.resolution_m, b.resolution_m))
    cells = resample(first, se2.IDENTITY, raster)
    if not once:
        cells = fuse_log_odds(cells, resample(second, T_first_second, raster))
    grid = cut_to_known(OccupancyGrid(cells, raster.resolution_m, raster.origin))
    T_global_a, T_global_b = (T_first_second, se2.IDENTITY) if swapped else (se2.IDENTITY, T_first_second)
    return FusedMap(grid, T_global_a, T_global_b, once)
