"""Which map is which: its content, independent of its file, its frame and the order of arguments."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import FREE_LOG_ODDS, OCCUPIED_LOG_ODDS, LogOdds, OccupancyGrid

_LEAST_CELLS = 1000  # two maps of a few cells agree by chance
_LATTICE_RAD = 0.02  # a registration of a map with its later version turns by less
_ROUNDING = 1e-3  # of log-odds
_AS_CERTAIN = 0.9  # share of free cells that are no less so later
_FREE_POINTS, _STILL_FREE = 4000, 0.6  # of an earlier version's free cells, and the share that is free later
_KEPT, _KEPT_WALLS = 0.96, 0.8  # shares of an earlier version's cells, and of its walls, that a later one has, at least


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


def later_version(later: OccupancyGrid, earlier: OccupancyGrid, T_later_earlier: NDArray[np.float64]) -> bool:
    """Tell whether a map holds all the evidence of another one: the same robot's map, some time later.

    Decided by content, at a pose (3,) known to about a cell. A map that only grew has nearly all free and occupied
    cells of its earlier version, walls too, in the very same places of the same lattice, and its free cells are no less
    certain. Two runs differ: their walls fall on cells at random, and each saw about half of the free cells less often.
    Where a loop closure moved the walls in between, a later version is not recognised.
    """
    if later.resolution_m != earlier.resolution_m or known_area_m2(later) < known_area_m2(earlier):
        return False
    turn, offset = _lattice_offset(later, earlier, T_later_earlier)
    if abs(turn) > _LATTICE_RAD or min(np.count_nonzero(earlier.known), np.count_nonzero(later.known)) < _LEAST_CELLS:
        return False
    classes, (first_row, first_col) = _content(earlier)
    rows, cols = np.nonzero(classes)
    if len(rows) == 0:
        return False
    was = earlier.log_odds[rows + first_row, cols + first_col]
    return any(
        _kept(
            later.log_odds, rows + offset[0] + shift[0] - 1, cols + offset[1] + shift[1] - 1, classes[rows, cols], was
        )
        for shift in np.ndindex(3, 3)
    )


def may_be_later_version(
    later: OccupancyGrid,
    earlier: OccupancyGrid,
    T_later_earlier: NDArray[np.float64],
    corners: NDArray[np.float64],
) -> bool:
    """Tell whether `later_version` has to be asked, without a look at the cells: most pairs of many maps need not.

    corners (4, 2): of the box around what the earlier map knows, in its frame. At least half of it must lie on the
    other grid, where later versions have 96 % of the cells.
    """
    lattice = se2.compose(se2.inverse(later.origin), se2.compose(T_later_earlier, earlier.origin))
    if later.resolution_m != earlier.resolution_m or abs(float(lattice[2])) > _LATTICE_RAD or len(corners) == 0:
        return False
    cells = later.cell_coordinates(se2.transform_points(T_later_earlier, corners))
    low, high = cells.min(axis=0), cells.max(axis=0)
    inside = np.minimum(high, later.log_odds.shape[::-1]) - np.maximum(low, 0.0)
    return bool((inside > 0.0).all() and inside.prod() >= 0.5 * (high - low).prod())


def _kept(
    now: LogOdds, rows: NDArray[np.intp], cols: NDArray[np.intp], classes: NDArray[np.int8], was: LogOdds
) -> bool:
    """Tell whether cells (N,) of an earlier map are still what they were in the cells (rows, cols) of a later one."""
    inside = (rows >= 0) & (rows < now.shape[0]) & (cols >= 0) & (cols < now.shape[1])
    values = np.zeros(len(rows), np.float32)
    values[inside] = now[rows[inside], cols[inside]]
    free, wall = classes > 0, classes < 0
    same = np.where(free, values <= FREE_LOG_ODDS, values >= OCCUPIED_LOG_ODDS)
    return bool(
        same.mean() >= _KEPT
        and (not wall.any() or same[wall].mean() >= _KEPT_WALLS)
        and (not free.any() or (values[free] <= was[free] + _ROUNDING).mean() >= _AS_CERTAIN)
    )


def _lattice_offset(
    later: OccupancyGrid, earlier: OccupancyGrid, T_later_earlier: NDArray[np.float64]
) -> tuple[float, tuple[int, int]]:
    """Return by how much earlier's lattice is turned in later's, and the rows, columns from its content to later's."""
    classes, (row, col) = _content(earlier)
    lattice = se2.compose(se2.inverse(later.origin), se2.compose(T_later_earlier, earlier.origin))
    half = np.array(classes.shape[::-1]) / 2.0
    middle = se2.transform_points(lattice, (np.array([col, row]) + half) * earlier.resolution_m) / later.resolution_m
    x, y = np.rint(middle - half).astype(int).tolist()
    return float(lattice[2]), (y, x)


def goes_on(later: OccupancyGrid, earlier: OccupancyGrid) -> bool:
    """Tell whether a map is the same robot's map some time later, in the same frame, and not one begun anew.

    Most of what was free is free in it at the same place, though a loop closure may have moved a part. A robot that
    started again has a map of little, or of another place.
    """
    rows, cols = np.nonzero(earlier.free)
    if len(rows) == 0:
        return True
    some = np.linspace(0, len(rows) - 1, min(len(rows), _FREE_POINTS)).astype(np.intp)
    points = earlier.cell_centers(rows[some], cols[some])
    col, row = np.floor(later.cell_coordinates(points)).astype(np.int64).T
    inside = (row >= 0) & (col >= 0) & (row < later.log_odds.shape[0]) & (col < later.log_odds.shape[1])
    still = np.count_nonzero(later.log_odds[row[inside], col[inside]] < 0.0)
    return bool(still >= _STILL_FREE * len(points))


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
