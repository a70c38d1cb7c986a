"""The occupancy grid: a frozen map, and the builder that grows one from scans at known poses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.raycast import integrate_rays
from mapping.sensor_models import LidarModel

FloatArray = NDArray[np.float64]
LogOdds = NDArray[np.float32]

LOG_ODDS_CLAMP = 7.0
OCCUPIED_THRESHOLD = 0.65
_GROWTH_M = 6.0  # added beyond what is needed, so that growing stays rare
FREE_THRESHOLD = 0.196
OCCUPIED_LOG_ODDS, FREE_LOG_ODDS = (np.float32(math.log(p / (1.0 - p))) for p in (OCCUPIED_THRESHOLD, FREE_THRESHOLD))


@dataclass(frozen=True, slots=True, eq=False)
class OccupancyGrid:
    """Log-odds (rows, cols) float32, unknown exactly 0, row 0 at the lowest y.

    origin (3,) is the pose (x, y, yaw) of the lower-left corner of cell (0, 0) in the map frame; resolution_m is metres
    a cell. Raises ValueError for wrong shapes and values.
    """

    log_odds: LogOdds
    resolution_m: float
    origin: FloatArray

    def __post_init__(self) -> None:
        cells = np.array(self.log_odds, dtype=np.float32)
        origin = np.array(self.origin, dtype=np.float64)
        if cells.ndim != 2 or cells.size == 0:
            raise ValueError(f"log_odds has shape {cells.shape}, expected (rows, cols) with at least one cell")
        if not np.isfinite(cells).all():
            raise ValueError("log_odds holds values that are not finite")
        if origin.shape != (3,) or not np.isfinite(origin).all():
            raise ValueError(f"origin {origin} is not a finite pose (x, y, yaw)")
        if not (math.isfinite(self.resolution_m) and self.resolution_m > 0):
            raise ValueError(f"resolution {self.resolution_m} m is not positive")
        for name, array in (("log_odds", cells), ("origin", origin)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def probability(self) -> NDArray[np.float32]:
        """(rows, cols) occupancy probability; 0.5 where unknown (inverse of thesis eq. 2.7)."""
        return np.asarray(1.0 / (1.0 + np.exp(-self.log_odds)), dtype=np.float32)

    @property
    def known(self) -> NDArray[np.bool_]:
        """(rows, cols) True where there is any evidence."""
        return np.asarray(self.log_odds != 0.0)

    @property
    def occupied(self) -> NDArray[np.bool_]:
        """(rows, cols) True where a map_server would draw a wall."""
        return np.asarray(self.log_odds >= OCCUPIED_LOG_ODDS)

    @property
    def free(self) -> NDArray[np.bool_]:
        """(rows, cols) True where a map_server would draw free space."""
        return np.asarray(self.log_odds <= FREE_LOG_ODDS)

    def cell_coordinates(self, points: FloatArray) -> FloatArray:
        """Return map-frame points (N, 2) in cells (x, y) from the lower-left corner of cell (0, 0)."""
        return se2.transform_points(se2.inverse(self.origin), points) / self.resolution_m

    def cell_centers(self, rows: NDArray[np.intp], cols: NDArray[np.intp]) -> FloatArray:
        """Return the map-frame centres (N, 2) of the cells."""
        local = np.column_stack([cols + 0.5, rows + 0.5]) * self.resolution_m
        return se2.transform_points(self.origin, local)


class GrowingCells:
    """An unbounded grid, held as arrays (rows, cols) that grow: log-odds, and the last scan that visited each cell.

    low (2,): x and y, in the unbounded grid, of the arrays' lower-left cell.
    """

    def __init__(self, resolution_m: float) -> None:
        self.resolution_m = resolution_m
        self.low = np.zeros(2, dtype=np.int64)
        self.log_odds = np.zeros((0, 0), dtype=np.float32)
        self.visited = np.zeros((0, 0), dtype=np.int32)

    def grow_to(self, cells: NDArray[np.int64]) -> None:
        """Enlarge the arrays, with a margin, so that all cells (K, 2), x and y of the unbounded grid, lie inside."""
        lowest, highest = cells.min(axis=0), cells.max(axis=0) + 2  # one spare: x / resolution - low may round up
        low, high = self.low, self.low + self.log_odds.shape[::-1]
        begun = self.log_odds.size > 0
        if begun and (lowest >= low).all() and (highest <= high).all():
            return
        margin = math.ceil(_GROWTH_M / self.resolution_m)
        new_low, new_high = lowest - margin, highest + margin
        if begun:
            new_low = np.where(lowest < low, new_low, low)
            new_high = np.where(highest > high, new_high, high)
        else:
            low = high = new_low
        before, after = (low - new_low).tolist(), (new_high - high).tolist()
        padding = ((before[1], after[1]), (before[0], after[0]))
        self.log_odds, self.visited = np.pad(self.log_odds, padding), np.pad(self.visited, padding)
        self.low = new_low

    def grid(self) -> OccupancyGrid:
        """Return the map so far, cut to its known cells; its origin lies on whole cells."""
        rows, cols = np.nonzero(self.log_odds)
        if len(rows) == 0:
            return OccupancyGrid(np.zeros((1, 1), np.float32), self.resolution_m, np.zeros(3))
        cut = self.log_odds[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1]
        corner = (self.low + np.array([cols.min(), rows.min()])) * self.resolution_m
        return OccupancyGrid(cut, self.resolution_m, np.array([corner[0], corner[1], 0.0]))


class GridBuilder:
    """Grows an occupancy grid from points seen at known poses (thesis Algorithm 1)."""

    def __init__(self, resolution_m: float, model: LidarModel) -> None:
        self._model = model
        self._cells = GrowingCells(resolution_m)
        self._scans = 0

    def add_scan(self, sensor: FloatArray, points: FloatArray) -> None:
        """Add the evidence of points (N, 2) measured from sensor (2,), both in the map frame."""
        if len(points) == 0:
            return
        cells = self._cells
        rays = points - sensor
        ranges = np.hypot(rays[:, 0], rays[:, 1])
        is_hit = ranges <= self._model.max_range_m
        shortened = np.minimum(1.0, self._model.max_range_m / np.maximum(ranges, 1e-9))
        ends = sensor + rays * shortened[:, np.newaxis]
        cells.grow_to(np.floor(np.vstack([ends, sensor[np.newaxis, :]]) / cells.resolution_m).astype(np.int64))
        self._scans += 1
        integrate_rays(
            cells.log_odds,
            cells.visited,
            self._scans,
            sensor / cells.resolution_m - cells.low,
            ends / cells.resolution_m - cells.low,
            is_hit,
            self._model.hit_log_odds(ranges, cells.resolution_m),
            self._model.miss_log_odds,
            LOG_ODDS_CLAMP,
        )

    def grid(self) -> OccupancyGrid:
        """Return the map so far, cut to its known cells; its origin lies on whole cells."""
        return self._cells.grid()
