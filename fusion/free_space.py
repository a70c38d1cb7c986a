"""Stage 1 of Algorithm 3: the layer of obstacle-free space (thesis section 3.1), at any resolution (section 5.3)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapping.grid import OccupancyGrid

Layer = NDArray[np.uint8]
UNKNOWN = 128  # p(free) = 0.5 in the layer of alpha 0


def free_layer(grid: OccupancyGrid, alpha: float) -> Layer:
    """Return the probability of free space p(free) = 1 - p (3.2) as an image (rows, cols), 255 for 1.

    Cells below alpha, occupied and unknown ones (3.1) are 0. alpha 0 leaves the map as it is (fig. 3.5b), which also
    shows occupied cells and, as UNKNOWN, unknown ones.
    """
    free = 1.0 - grid.probability
    if alpha == 0.0:
        return np.where(grid.known, np.rint(255.0 * free), UNKNOWN).astype(np.uint8)
    layer = np.where(grid.known & (free >= alpha), np.rint(255.0 * free), 0.0)
    return layer.astype(np.uint8)


def rescale(layer: Layer, from_m: float, to_m: float) -> Layer:
    """Return the layer with cells of another size in m: the nearest cell, from the same lower-left corner."""
    if from_m == to_m:
        return layer
    rows, cols = (_nearest(count, from_m, to_m) for count in layer.shape)
    return layer[np.ix_(rows, cols)]


def _nearest(count: int, from_m: float, to_m: float) -> NDArray[np.intp]:
    """Return for each new cell along one axis the old cell at its centre."""
    centers_m = (np.arange(max(1, math.ceil(count * from_m / to_m - 1e-9))) + 0.5) * to_m
    return np.minimum((centers_m / from_m).astype(np.intp), count - 1)
