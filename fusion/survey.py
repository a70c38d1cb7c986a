"""A map made ready for registration: what of it can be matched, in the grid's own frame, at a bounded size."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.resampling import cut_to_known
from mapping.grid import OccupancyGrid
from mapping.map_agreement import Probe, Surface, probe_of, surface_of
from mapping.outline import outline_of
from mapping.wall_map import FREE, UNKNOWN, WALL, States, WallMap, distances_to, wall_map

FloatArray = NDArray[np.float64]
FREE_BELOW = -0.62  # log-odds of p = 0.35
_MOST_CELLS = 16_000_000  # a larger map is taken at a coarser cell
_PROBE_POINTS, _ROUGH_POINTS, _CELLS = 3000, 800, 12_000


@dataclass(frozen=True, slots=True, eq=False)
class SurveyedMap:
    """A map without its unknown rim.

    surface to be judged against; probe to be tried on the other map, rough for many trials; cells (N, 2) with states
    (N,) and cell_area_m2 each, a sample of the known cells; free_m2, known_m2: all free and all known area; wall_m: all
    visible wall.
    """

    surface: Surface
    probe: Probe
    rough: Probe
    cells: FloatArray
    states: States
    cell_area_m2: float
    free_m2: float
    known_m2: float
    wall_m: float

    @property
    def walls(self) -> WallMap:
        """The walls that the surface is made of."""
        return self.surface.walls


def survey(grid: OccupancyGrid) -> SurveyedMap:
    """Prepare a map; it may lack walls or free space, which the fields then tell."""
    walls = _bounded(wall_map(cut_to_known(grid), free_below=FREE_BELOW))
    outline = outline_of(walls)
    known = np.flatnonzero(walls.states != UNKNOWN)
    stride = max(1, len(known) // _CELLS)
    rows, cols = np.divmod(known[stride // 2 :: stride], walls.states.shape[1])
    area_m2 = walls.resolution_m**2
    return SurveyedMap(
        surface_of(walls, outline),
        probe_of(outline, _PROBE_POINTS),
        probe_of(outline, _ROUGH_POINTS),
        np.asarray((np.column_stack([cols, rows]) + 0.5) * walls.resolution_m, dtype=np.float64),
        walls.states[rows, cols],
        area_m2 * len(known) / max(len(rows), 1),
        float(np.count_nonzero(walls.states == FREE)) * area_m2,
        len(known) * area_m2,
        float(outline.lengths.sum()),
    )


def _bounded(walls: WallMap) -> WallMap:
    """Return the walls at a cell so coarse that there are not too many; a coarse cell with wall in it is wall."""
    factor = math.ceil(math.sqrt(walls.states.size / _MOST_CELLS))
    if factor <= 1:
        return walls
    rows, cols = (-(-count // factor) for count in walls.states.shape)
    padded = np.full((rows * factor, cols * factor), UNKNOWN, np.uint8)
    padded[: walls.states.shape[0], : walls.states.shape[1]] = walls.states
    states = padded.reshape(rows, factor, cols, factor).max(axis=(1, 3))
    resolution_m = walls.resolution_m * factor
    return WallMap(distances_to(states == WALL, resolution_m), states, resolution_m, walls.T_map_grid)
