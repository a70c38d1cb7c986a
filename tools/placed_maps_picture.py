"""Maps in one frame, the walls of each in a colour of its own, on white or on a floor plan; drawn with OpenCV."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from fusion.resampling import Raster, known_corners
from mapping import se2
from mapping.grid import OccupancyGrid
from tools.lettering import INK_BGR
from tools.map_overlay import seen_on
from tools.pictures import Image

FloatArray = NDArray[np.float64]
Color = tuple[int, int, int]
_FREE_BGR = (235, 235, 235)
_TRIMMED = 0.003
_FREE_BELOW, _WALL_ABOVE = -0.62, 0.62  # log-odds of p = 0.35 and 0.65, as in the overlays


@dataclass(frozen=True, slots=True, eq=False)
class PlacedMap:
    """A map, the pose (3,) of its frame in the picture's, and the BGR colour of its walls."""

    grid: OccupancyGrid
    T_view_map: FloatArray
    color: Color


def corners_of(maps: Sequence[PlacedMap]) -> FloatArray:
    """Return the lower left and the upper right corner (2 N, 2) of each map's walls, in the picture's frame.

    Without the farthest few in a thousand, which rays through windows hit. Of what is known where there is no wall.
    """
    corners = []
    for each in maps:
        rows, cols = np.nonzero(each.grid.occupied)
        points = each.grid.cell_centers(rows, cols) if len(rows) else known_corners(each.grid)
        placed = se2.transform_points(each.T_view_map, points)
        corners.append(np.quantile(placed, (_TRIMMED, 1.0 - _TRIMMED), axis=0))
    return np.vstack(corners)


def paint_maps(
    picture: Image, raster: Raster, maps: Sequence[PlacedMap], stroke_px: int = 1, tint: float | None = None
) -> None:
    """Paint maps onto a picture (rows, cols, 3), row 0 highest, of a raster.

    Walls are stroke_px wide for a cell. Free space is gray, and walls that several maps saw are dark; with a tint, from
    0 to 1, free space has so much of its map's colour, mixed where several saw it, and walls stay as they are.
    """
    upright = picture[::-1]
    seen = [seen_on(each.grid, each.T_view_map, raster) for each in maps]
    for each, cells in zip(maps, seen, strict=True):
        if tint is not None:
            free = cells < _FREE_BELOW
            upright[free] = np.round(upright[free] * (1.0 - tint) + tint * np.array(each.color)).astype(np.uint8)
    if tint is None:
        upright[np.logical_or.reduce([cells < _FREE_BELOW for cells in seen])] = _FREE_BGR
    kernel, near = np.ones((stroke_px, stroke_px), np.uint8), np.zeros(raster.shape, np.int64)
    walls = [cv2.dilate((cells > _WALL_ABOVE).astype(np.uint8), kernel) > 0 for cells in seen]
    for each, wall in zip(maps, walls, strict=True):
        upright[wall] = each.color
        near += np.asarray(cv2.dilate(wall.astype(np.uint8), np.ones((3, 3), np.uint8)), np.uint8)
    if tint is None and len(maps) > 1:
        upright[np.logical_or.reduce(walls) & (near > 1)] = INK_BGR
