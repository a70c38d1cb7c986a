"""Whole maps as images for feature detection, and what chapter 4 does to them (thesis sections 4.1.3, 4.2.3)."""

from __future__ import annotations

import math

import cv2
import numpy as np

from fusion.free_space import Layer, free_layer
from mapping.grid import OccupancyGrid

OCCUPIED, FREE, UNKNOWN = 255, 128, 0  # 1, 0 and -1 of section 4.1.3, spread over the range of an image


def occupancy_image(grid: OccupancyGrid) -> Layer:
    """Return O (rows, cols): each cell as what it is more probably, occupied, free or unknown (section 4.1.3)."""
    image = np.full(grid.log_odds.shape, UNKNOWN, np.uint8)
    image[grid.log_odds > 0.0] = OCCUPIED
    image[grid.log_odds < 0.0] = FREE
    return image


def free_image(grid: OccupancyGrid, alpha: float) -> Layer:
    """Return O^free (rows, cols): 255 where a cell is free with at least alpha, above 0 (section 3.1), else 0.

    Section 4.1.3 makes a value of each state ("maximized"); Algorithm 3 keeps the probabilities of the free ones.
    """
    return np.where(free_layer(grid, alpha) > 0, 255, 0).astype(np.uint8)


def rescale_bicubic(image: Layer, from_m: float, to_m: float) -> Layer:
    """Return the image with cells of another size in m, of 4 by 4 old ones each, from the same lower-left corner.

    Method 1 of section 4.1.3.1. Cells of less than half a new one at the far edges are left out.
    """
    if from_m == to_m:
        return image
    factor = from_m / to_m
    return np.asarray(cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)


def turn_nearest(image: Layer, turn_rad: float) -> Layer:
    """Return the image turned counter-clockwise as seen with row 0 at the bottom, on a canvas that holds all of it.

    Cells are looked up, nearest neighbour (section 4.2.3); the corners outside are 0.
    """
    rows, cols = image.shape
    cos, sin = math.cos(turn_rad), math.sin(turn_rad)
    width, height = (math.ceil(abs(cos) * a + abs(sin) * b - 1e-9) for a, b in ((cols, rows), (rows, cols)))
    # A column is x and a row is y, both up, and OpenCV's coordinates are those of cells' centres.
    turn = np.array([[cos, -sin], [sin, cos]])
    shift = np.array([width - 1, height - 1]) / 2.0 - turn @ (np.array([cols - 1, rows - 1]) / 2.0)
    motion = np.column_stack([turn, shift])
    return np.asarray(
        cv2.warpAffine(image, motion, (width, height), flags=cv2.INTER_NEAREST, borderValue=0), dtype=np.uint8
    )
