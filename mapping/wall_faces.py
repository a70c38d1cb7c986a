"""From which side each wall of a map was seen: the face of a wall can be seen from its open side only.

Of a room that was looked into through its door a map has the far faces of the near walls alone. From inside, the near
faces are seen, a wall's thickness away: they must not be taken for the ones that are on the map.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapping.outline import Outline, outline_of
from mapping.wall_map import WALL, Distances, WallMap, distances_to

FloatArray = NDArray[np.float64]

FACINGS = 8  # directions that are told apart
_THICK_M = 0.3  # a wall cell so far from every face has none


@dataclass(frozen=True, slots=True, eq=False)
class WallFaces:
    """A wall map, and distances (FACINGS, rows, cols) in m from each cell's middle to what may be seen there.

    Layer k holds the distance to the nearest wall cell that a surface can be whose normal, out of the wall, points to
    k / FACINGS of a turn: all walls but those that were seen from the other side only.
    """

    walls: WallMap
    distances: Distances


def wall_faces(walls: WallMap) -> WallFaces:
    """Make a map ready to be matched by what is seen from one side."""
    layers = [distances_to(layer, walls.resolution_m) for layer in faces_towards(walls)]
    return WallFaces(walls, np.stack(layers))


def faces_towards(walls: WallMap) -> NDArray[np.bool_]:
    """Return (FACINGS, rows, cols): the wall cells that a surface can be which faces that way.

    A cell faces as the nearest cell of the walls' outline does, within 90 deg. Where that has no direction, or free
    space on both sides, it may be seen from everywhere.
    """
    is_wall = walls.states == WALL
    angles = _facing_of_cells(walls, outline_of(walls))
    away = angles[np.newaxis] - (np.arange(FACINGS) * (2.0 * np.pi / FACINGS))[:, np.newaxis, np.newaxis]
    return np.asarray(is_wall & ~(np.cos(away) < 0.0))  # nan, without a direction, is in all


@njit(cache=True, nogil=True)
def facing_layer(facing_rad: float) -> int:
    """Return the layer of a surface whose normal points that way."""
    return math.floor(facing_rad * (FACINGS / (2.0 * math.pi)) + 0.5) % FACINGS


@njit(cache=True, nogil=True)
def facing_layers(facings_rad: FloatArray) -> NDArray[np.intp]:
    """Return the layers (N,) of surfaces whose normals point that way (N,)."""
    layers = np.empty(facings_rad.shape[0], np.intp)
    for n in range(facings_rad.shape[0]):
        layers[n] = facing_layer(facings_rad[n])
    return layers


def _facing_of_cells(walls: WallMap, outline: Outline) -> NDArray[np.float32]:
    """Return the direction (rows, cols) in rad of the nearest outline cell's normal; nan where it has no open side."""
    angles = np.full(walls.states.shape, np.nan, np.float32)
    if len(outline.points) == 0:
        return angles
    cols, rows = np.floor(outline.points / walls.resolution_m).astype(np.intp).T
    empty = np.ones(walls.states.shape, np.uint8)
    empty[rows, cols] = 0
    cells, labels = cv2.distanceTransformWithLabels(empty, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL)
    of_label = np.full(int(labels.max()) + 1, np.nan, np.float32)
    facing = np.arctan2(outline.normals[:, 1], outline.normals[:, 0])
    of_label[labels[rows, cols]] = np.where(outline.faced, facing, np.nan)
    return np.asarray(np.where(cells * walls.resolution_m > _THICK_M, np.float32(np.nan), of_label[labels]))
