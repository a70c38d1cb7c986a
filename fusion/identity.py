"""Which map is which: its content, independent of its file, its frame and the order of arguments."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import OccupancyGrid

_LEAST_CELLS = 1000  # two maps of a few cells agree by chance


def known_area_m2(grid: OccupancyGrid) -> float:
    """Return the area of the known cells in m^2."""
    return float(np.count_nonzero(grid.known)) * grid.resolution_m**2


def content_hash(grid: OccupancyGrid) -> str:
    """Return a hash of what a map_server would show: free, occupied and unknown cells within the known box, and size.

    Neither the frame nor the margin of unknown cells counts, so the YAML and the lossless file of one map hash alike.
    """
    classes, _ = _content(grid)
    head = f"{classes.shape} {grid.resolution_m:.9g} "
    return hashlib.sha256(head.encode() + classes.tobytes()).hexdigest()


def content_corner(grid: OccupancyGrid) -> NDArray[np.float64]:
    """Return the pose (3,) in the map frame of the lower-left corner of the content that is hashed."""
    _, (row, col) = _content(grid)
    return se2.compose(grid.origin, np.array([col * grid.resolution_m, row * grid.resolution_m, 0.0]))


def same_evidence(a: OccupancyGrid, b: OccupancyGrid) -> bool:
    """Tell whether two maps are one: two runs never agree in every cell, if the cells are many."""
    enough = min(np.count_nonzero(a.known), np.count_nonzero(b.known)) >= _LEAST_CELLS
    if not enough or a.resolution_m != b.resolution_m:
        return False
    return np.array_equal(_content(a)[0], _content(b)[0])


def precedes(a: OccupancyGrid, b: OccupancyGrid) -> bool:
    """Tell whether map a is the reference of the two, as `reference_rank` orders them; hashes only if it must."""
    areas = known_area_m2(a), known_area_m2(b)
    return areas[0] > areas[1] if areas[0] != areas[1] else content_hash(a) < content_hash(b)


def reference_rank(grid: OccupancyGrid) -> tuple[float, str]:
    """Return a sort key: the map with the most known area comes first, and of equals the one with the lower hash."""
    return -known_area_m2(grid), content_hash(grid)


def _content(grid: OccupancyGrid) -> tuple[NDArray[np.int8], tuple[int, int]]:
    """Return the classes 1 free, -1 occupied, 0 neither within the box around both, and the box's first row, column."""
    free, occupied = grid.free, grid.occupied
    either = free | occupied
    rows, cols = np.flatnonzero(either.any(axis=1)), np.flatnonzero(either.any(axis=0))
    if len(rows) == 0:
        return np.zeros((0, 0), np.int8), (0, 0)
    first = int(rows[0]), int(cols[0])
    box = np.s_[first[0] : rows[-1] + 1, first[1] : cols[-1] + 1]
    return free[box].astype(np.int8) - occupied[box].astype(np.int8), first
