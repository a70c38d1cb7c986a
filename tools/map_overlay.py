"""Two maps laid over each other as pixels: what each saw, what both saw, and where they contradict each other.

Maps are looked up on the pixels of the picture; a map of finer cells is reduced first, so that a wall of one cell never
vanishes between two pixels and the work is bounded by the picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType

import cv2
import numpy as np
from numpy.typing import NDArray

from fusion.resampling import Raster, resample
from mapping import se2
from mapping.grid import LogOdds, OccupancyGrid
from tools.pictures import Image

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Okabe and Ito's blue and orange, black and a crimson: told apart by the colour-blind too.
COLORS_BGR = MappingProxyType(
    {  # in the order in which one covers the other
        "unknown": (226, 226, 226),
        "free a": (247, 226, 200),
        "free b": (190, 228, 253),
        "free both": (255, 255, 255),
        "wall a": (178, 104, 0),
        "wall b": (0, 140, 230),
        "wall both": (34, 34, 34),
        "conflict": (100, 20, 235),
    }
)
_WALL_ABOVE, _FREE_BELOW = 0.62, -0.62  # log-odds of p = 0.65 and 0.35, as in the verification
_SAME_WALL_M, _CONFLICT_M = 0.15, 0.30  # likewise
_SAME_WALL_PX, _CONFLICT_PX = 1.5, 3.0  # at the least
_LOG_ODDS_OF_KIND = np.array([0.0, -5.0, 5.0], np.float32)  # unknown, free, wall, in the order in which they prevail
_ROWS_AT_ONCE = 512  # of a large map that is reduced: bounds the memory
_ZOOM_BELOW = 0.3  # of the view: a map smaller than that is zoomed at
_ZOOMED_VIEW = 2.2  # the view's size by the smaller map's


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The part of a frame that is shown: corners low and high (2,) in m; zoomed: not all of both maps is in it."""

    low: FloatArray
    high: FloatArray
    zoomed: bool = False

    @property
    def corners(self) -> FloatArray:
        """(4, 2) in m, counter-clockwise."""
        (x0, y0), (x1, y1) = self.low, self.high
        return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


def view_of(grid: OccupancyGrid) -> View:
    """Return the view, in the map's frame, of all known cells; of the whole grid where nothing is known."""
    corners = _corners(grid)
    return View(corners.min(axis=0), corners.max(axis=0))


def view_of_both(a: OccupancyGrid, b: OccupancyGrid, T_a_b: FloatArray) -> View:
    """Return the view in a's frame of both maps; of the smaller one's surroundings if it is much smaller."""
    boxes = [_corners(a), se2.transform_points(T_a_b, _corners(b))]
    boxes.sort(key=lambda box: float(np.ptp(box, axis=0).max()))
    (small_low, small_high), (large_low, large_high) = ((box.min(axis=0), box.max(axis=0)) for box in boxes)
    low, high = np.minimum(small_low, large_low), np.maximum(small_high, large_high)
    size_m = float((small_high - small_low).max())
    apart = (small_low > large_high).any() or (small_high < large_low).any()
    if apart or size_m >= _ZOOM_BELOW * float((high - low).max()):
        return View(low, high)
    middle, half_m = (small_low + small_high) / 2.0, size_m * _ZOOMED_VIEW / 2.0
    return View(np.maximum(low, middle - half_m), np.minimum(high, middle + half_m), zoomed=True)


def raster_for(view: View, shape: tuple[int, int], margin: float = 0.04) -> Raster:
    """Return the raster of shape (rows, cols) pixels that shows the view in its middle, with a margin around it."""
    rows, cols = shape
    size = np.maximum(view.high - view.low, 1e-6) * (1.0 + 2.0 * margin)
    pixel_m = float(max(size[0] / cols, size[1] / rows))
    corner = (view.low + view.high) / 2.0 - np.array([cols, rows]) * pixel_m / 2.0
    return Raster(shape, pixel_m, np.array([*corner, 0.0]))


def pixels_of(raster: Raster, points: FloatArray) -> FloatArray:
    """Return points (N, 2) of the raster's frame as pixels (N, 2), x to the right and y down."""
    pixels = (points - raster.origin[:2]) / raster.resolution_m
    return np.column_stack([pixels[:, 0], raster.shape[0] - pixels[:, 1]])


def reduced(grid: OccupancyGrid, factor: int) -> OccupancyGrid:
    """Return the map on cells `factor` times as large: wall if there is any in one, else free if any of it is."""
    if factor <= 1:
        return grid
    return OccupancyGrid(_reduced_cells(grid.log_odds, factor), grid.resolution_m * factor, grid.origin)


def reduction(grid: OccupancyGrid, pixel_m: float) -> int:
    """Return the largest factor that leaves a map's cells no larger than a pixel; 1 for coarser maps."""
    cells = math.floor(pixel_m / grid.resolution_m + 1e-9)
    return int(min(max(1, cells), max(grid.log_odds.shape)))


def seen_on(grid: OccupancyGrid, T_view_map: FloatArray, raster: Raster) -> LogOdds:
    """Return the map's log-odds (rows, cols) at the pixels of a raster, row 0 lowest; no wall is lost."""
    low, high = _cells_around(grid, T_view_map, raster)
    if (low >= high).any():
        return np.zeros(raster.shape, np.float32)
    factor = reduction(grid, raster.resolution_m)
    cells = _reduced_cells(grid.log_odds[low[1] : high[1], low[0] : high[0]], factor)
    corner = se2.compose(grid.origin, np.array([*(low * grid.resolution_m), 0.0]))
    part = OccupancyGrid(cells, grid.resolution_m * factor, corner)
    values = resample(part, T_view_map, raster)
    rows, cols = np.nonzero(part.log_odds > _WALL_ABOVE)
    points = se2.transform_points(T_view_map, part.cell_centers(rows, cols)) - raster.origin[:2]
    col, row = np.floor(points / raster.resolution_m).astype(np.int64).T
    inside = (col >= 0) & (col < raster.shape[1]) & (row >= 0) & (row < raster.shape[0])
    values[row[inside], col[inside]] = part.log_odds[rows[inside], cols[inside]]
    return values


def overlay_image(a: LogOdds, b: LogOdds, pixel_m: float, stroke_px: int = 1) -> Image:
    """Return two maps on the same pixels (rows, cols), row 0 lowest, as a BGR picture with row 0 highest.

    stroke_px is the least width of a wall; conflicts are drawn wider, so that they catch the eye.
    """
    free_a, free_b, wall_a, wall_b = a < _FREE_BELOW, b < _FREE_BELOW, a > _WALL_ABOVE, b > _WALL_ABOVE
    far_a, far_b = _distance_px(wall_a), _distance_px(wall_b)
    same = max(_SAME_WALL_M / pixel_m, _SAME_WALL_PX)
    apart = max(_CONFLICT_M / pixel_m, _CONFLICT_PX)
    both = (wall_a & (far_b <= same)) | (wall_b & (far_a <= same))
    conflict = (wall_a & free_b & (far_b > apart)) | (wall_b & free_a & (far_a > apart))
    kinds = np.zeros(a.shape, np.uint8)  # the number of the colour; what comes later covers what came before
    widths = [1, 1, 1, stroke_px, stroke_px, stroke_px, stroke_px + 1]
    masks = [free_a, free_b, free_a & free_b, wall_a, wall_b, both, conflict]
    for number, (mask, width_px) in enumerate(zip(masks, widths, strict=True), start=1):
        kinds[_widened(mask, width_px)] = number
    return np.take(np.array(list(COLORS_BGR.values()), np.uint8), kinds[::-1], axis=0)


def _corners(grid: OccupancyGrid) -> FloatArray:
    """Return the corners (4, 2) in the map frame of the box around the known cells, else of the grid."""
    rows, cols = (np.flatnonzero(grid.log_odds.any(axis=axis)) for axis in (1, 0))
    height, width = grid.log_odds.shape
    x0, x1, y0, y1 = (cols[0], cols[-1] + 1, rows[0], rows[-1] + 1) if len(rows) else (0, width, 0, height)
    cells = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], dtype=np.float64)
    return se2.transform_points(grid.origin, cells * grid.resolution_m)


def _cells_around(
    grid: OccupancyGrid, T_view_map: FloatArray, raster: Raster
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first and one past the last cell (x, y) of the map that a raster may show; empty if they lie apart."""
    rows, cols = raster.shape
    corners = raster.origin[:2] + np.array([(0, 0), (cols, 0), (cols, rows), (0, rows)]) * raster.resolution_m
    cells = grid.cell_coordinates(se2.transform_points(se2.inverse(T_view_map), corners))
    last = grid.log_odds.shape[::-1]
    low = np.clip(np.floor(cells.min(axis=0)) - 1.0, 0, last).astype(np.int64)
    return low, np.clip(np.ceil(cells.max(axis=0)) + 1.0, 0, last).astype(np.int64)


def _reduced_cells(log_odds: LogOdds, factor: int) -> LogOdds:
    """Return blocks of `factor` x `factor` cells as one: wall if any is, else free if any is, else unknown."""
    if factor <= 1:
        return log_odds
    step = factor * max(1, _ROWS_AT_ONCE // factor)
    bands = []
    for first in range(0, len(log_odds), step):
        band = log_odds[first : first + step]
        kinds = np.where(band > _WALL_ABOVE, np.uint8(2), (band < _FREE_BELOW).view(np.uint8))
        bands.append(_largest_of_rows(_largest_of_rows(kinds, factor).T, factor).T)
    return np.asarray(_LOG_ODDS_OF_KIND[np.vstack(bands)], dtype=np.float32)


def _largest_of_rows(kinds: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    """Return each `factor` rows as one."""
    result: NDArray[np.uint8] = kinds[::factor].copy()
    for offset in range(1, factor):
        rows = kinds[offset::factor]
        np.maximum(result[: len(rows)], rows, out=result[: len(rows)])
    return result


def _distance_px(wall: Mask) -> NDArray[np.float32]:
    """Return how far each pixel is from a wall; infinite without one."""
    if not wall.any():
        return np.full(wall.shape, np.inf, np.float32)
    distance = cv2.distanceTransform((~wall).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
    return np.asarray(distance, dtype=np.float32)


def _widened(mask: Mask, width_px: int) -> Mask:
    if width_px <= 1:
        return mask
    kernel = np.ones((width_px, width_px), np.uint8)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), kernel), dtype=np.bool_)
