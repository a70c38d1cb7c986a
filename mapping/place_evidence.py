"""What seen points say for and against a pose on a saved map."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapping import se2
from mapping.wall_faces import WallFaces, facing_layer
from mapping.wall_map import FREE, WALL, Distances, States

FloatArray = NDArray[np.float64]

HIT_M = 0.15  # a point so near a wall is on it
_AGAINST_M = 0.30  # one so far from every wall, in the map's free space, contradicts it
_BEHIND_M = 0.25  # a ray that comes out of a wall by so much went through it


@dataclass(frozen=True, slots=True)
class Evidence:
    """What points seen along a drive say about a pose, as numbers of points.

    hits lie on walls that face as they do, astray in free space, far from any wall; near are between; unknown lie where
    the map knows nothing, or has the other face of a wall alone; through (of any of these) were seen by a ray that
    crossed a wall of the map.
    """

    points: int
    hits: int
    near: int
    astray: int
    unknown: int
    through: int

    @property
    def known(self) -> int:
        """Points that lie where the map knows something."""
        return self.points - self.unknown

    @property
    def hit_share(self) -> float:
        """Share of the known points on walls, 0 without any."""
        return self.hits / self.known if self.known else 0.0

    @property
    def contradiction(self) -> float:
        """Points in free space as a share of the known ones, plus those seen through walls as a share of all."""
        return self.astray / self.known + self.through / self.points if self.known else 0.0


def judge(
    faces: WallFaces, points: FloatArray, facings_rad: FloatArray, origins: FloatArray, pose: FloatArray
) -> Evidence:
    """Count what speaks for and against a pose (3,) in the grid's frame: points (N, 2) seen from origins (N, 2).

    facings_rad (N,): see `refine`.
    """
    walls = faces.walls
    ends = se2.transform_points(pose, points) / walls.resolution_m
    starts = se2.transform_points(pose, origins) / walls.resolution_m
    fields = (faces.distances, walls.distances, walls.states)
    counts = _count(fields, walls.resolution_m, starts, ends, facings_rad + pose[2])
    return Evidence(len(points), *counts.tolist())


@njit(cache=True, nogil=True)
def _count(
    fields: tuple[Distances, Distances, States],
    resolution_m: float,
    starts: FloatArray,
    ends: FloatArray,
    facings: FloatArray,
) -> NDArray[np.int64]:
    """Return the numbers of hits, near, astray, unknown and through; starts, ends (N, 2) in cells, facings (N,) in rad.

    fields: distances of each layer and to all walls, and states.
    """
    layers, distances, states = fields
    counts = np.zeros(5, np.int64)
    rows, cols = states.shape
    for n in range(ends.shape[0]):
        col, row = math.floor(ends[n, 0]), math.floor(ends[n, 1])
        inside = 0 <= col < cols and 0 <= row < rows
        if inside and layers[facing_layer(facings[n]), row, col] <= HIT_M:
            counts[0] += 1
        elif not inside or states[row, col] != FREE:
            counts[3] += 1
        elif distances[row, col] > _AGAINST_M:
            counts[2] += 1
        else:
            counts[1] += 1
        dx, dy = ends[n, 0] - starts[n, 0], ends[n, 1] - starts[n, 1]
        length = math.hypot(dx, dy)
        steps = int(length - _AGAINST_M / resolution_m)
        touched = False
        for step in range(steps):
            x, y = starts[n, 0] + dx * (step + 0.5) / length, starts[n, 1] + dy * (step + 0.5) / length
            col, row = math.floor(x), math.floor(y)
            if not (0 <= col < cols and 0 <= row < rows):
                break
            if states[row, col] == WALL:
                touched = True
            elif touched and distances[row, col] > _BEHIND_M:
                counts[4] += 1
                break
    return counts
