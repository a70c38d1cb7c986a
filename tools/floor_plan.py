"""A floor plan: the drawing of a building, over maps of it, and how far their walls are from its lines."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from fusion.resampling import Raster, raster_around
from mapping import se2
from tools.errors import ToolError
from tools.map_data_set import FloorPlan
from tools.pictures import Image

FloatArray = NDArray[np.float64]
_LINE_BELOW = 128  # gray of a line
PLAN_BGR = (20, 20, 20)


def plan_lines(plan: FloorPlan) -> FloatArray:
    """Return the lines of a plan with known scale and pose as points (N, 2) in m in the set's frame, one a pixel.

    Dark is a line, whatever is transparent white. Raises ToolError where the image cannot be read or has no line.
    """
    assert plan.resolution_m is not None
    assert plan.pose is not None, "only plans with a scale and a pose can be drawn"
    gray = _read_gray(plan.image)
    rows, cols = np.nonzero(gray < _LINE_BELOW)
    if len(rows) == 0:
        raise ToolError(f"{plan.image}: no dark pixel in it: give a drawing with dark lines on white")
    pixels = np.column_stack([cols + 0.5, gray.shape[0] - rows - 0.5])
    return se2.transform_points(plan.pose, pixels * plan.resolution_m)


def draw_plan(picture: Image, raster: Raster, lines: FloatArray, pixel_m: float) -> None:
    """Draw the plan's lines (N, 2), dots of pixel_m each, onto a picture of a raster, row 0 highest."""
    cells = np.floor((lines - raster.origin[:2]) / raster.resolution_m).astype(np.int64)
    col, row = cells[((cells >= 0) & (cells < np.array(raster.shape[::-1]))).all(axis=1)].T
    drawn = np.zeros(raster.shape, np.uint8)
    drawn[row, col] = 1
    wide = math.ceil(pixel_m / raster.resolution_m)
    closed = cv2.morphologyEx(drawn, cv2.MORPH_CLOSE, np.ones((wide + 1, wide + 1), np.uint8))
    picture[closed[::-1] > 0] = PLAN_BGR


def _read_gray(path: Path) -> NDArray[np.uint8]:
    """Read an image of any kind as gray on white."""
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise ToolError(f"{path}: cannot be read as an image: give a PNG or JPEG of the plan")
    if image.dtype != np.uint8:
        image = (image / 257).astype(np.uint8)
    if image.ndim == 2:
        return np.asarray(image, dtype=np.uint8)
    gray = cv2.cvtColor(image[:, :, :3], cv2.COLOR_BGR2GRAY).astype(np.float64)
    opaque = image[:, :, 3] / 255.0 if image.shape[2] == 4 else 1.0
    return np.asarray(np.round(gray * opaque + 255.0 * (1.0 - opaque)), dtype=np.uint8)


def distance_m(points: FloatArray, lines: FloatArray, pixel_m: float) -> FloatArray:
    """Return how far points (N, 2) are from the nearest line of a plan, in m, to about a pixel of pixel_m."""
    raster = raster_around(np.vstack([points, lines]), pixel_m)
    rows, cols = _cells(lines, raster)
    empty = np.ones(raster.shape, np.uint8)
    empty[rows, cols] = 0
    apart = cv2.distanceTransform(empty, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(apart[_cells(points, raster)], dtype=np.float64) * pixel_m


def _cells(points: FloatArray, raster: Raster) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows and cols of points that lie in a raster."""
    col, row = np.floor((points - raster.origin[:2]) / raster.resolution_m).astype(np.int64).T
    return np.clip(row, 0, raster.shape[0] - 1), np.clip(col, 0, raster.shape[1] - 1)
