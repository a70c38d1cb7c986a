"""The arrays (rows, cols) that a costmap is made of, each a function of others: for a whole map or a part of one."""

from __future__ import annotations

import math

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from mapping.grid import OCCUPIED_THRESHOLD
from planning.footprint import Distances, Mask
from planning.vehicle import Vehicle

LogOdds = NDArray[np.float32]
Regions = NDArray[np.int32]

_BEYOND_M = 0.5  # distances are kept up to so much more than the car's outer radius: a change is then a local matter
_NEAR_M = 0.3  # a route pays for less room than this beside the rear axle's circle,
_NEAR_COST = 1.0  # and so much per metre where there is none
_OCCUPIED_LOG_ODDS = np.float32(math.log(OCCUPIED_THRESHOLD / (1.0 - OCCUPIED_THRESHOLD)))


def reach_m(vehicle: Vehicle) -> float:
    """Return up to where distances in m are kept."""
    return vehicle.outer_radius_m + _BEYOND_M


def occupied_and_unseen(log_odds: LogOdds) -> tuple[Mask, Mask]:
    """Return the cells that are walls, and those that are neither walls nor seen free more often than not."""
    occupied = np.asarray(log_odds >= _OCCUPIED_LOG_ODDS)
    return occupied, np.asarray((log_odds >= 0.0) & ~occupied)


def least_cells(vehicle: Vehicle, cell_m: float) -> float:
    """Return of how many cells on unseen space is as large as the car."""
    return vehicle.area_m2 / cell_m**2


def without_specks(mask: Mask, least: float) -> Mask:
    """Return the mask without its 4-connected parts of fewer cells."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.view(np.uint8), connectivity=4)
    large = stats[:, cv2.CC_STAT_AREA] >= least
    large[0] = False  # the background
    return np.asarray(large[labels])


def without_specks_again(
    mask: Mask, least: float, changed: Mask, before: Mask, goes_on: tuple[bool, bool, bool, bool]
) -> Mask:
    """Return `without_specks` of a part of a map that reaches at least `least` cells further than its changed cells.

    before: the result before the change; goes_on: whether the map does at the part's left, top (first row), right and
    bottom. A patch that is cut there is as before if none of its cells changed, and reaches from a changed cell to the
    cut otherwise, which a speck cannot.
    """
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.view(np.uint8), connectivity=4)
    left, top, width, height, area = stats.T
    at_edge = (left == 0, top == 0, left + width == mask.shape[1], top + height == mask.shape[0])
    cut = np.logical_or.reduce([edge & more for edge, more in zip(at_edge, goes_on, strict=True)])
    large = area >= least
    touched = np.zeros(len(stats), bool)
    touched[labels[changed]] = True
    large |= cut & touched
    large[0] = False  # the background
    result = np.asarray(large[labels])
    kept = cut & ~touched
    kept[0] = False
    if kept.any():
        same = kept[labels]
        result[same] = before[same]
    return result


def distances_m(mask: Mask, cell_m: float, most_m: float) -> Distances:
    """Return the distance in m between the centres of a cell and of the nearest in the mask, at most most_m."""
    if not mask.any():
        return np.full(mask.shape, most_m, np.float32)
    found = cv2.distanceTransform((~mask).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    distances = np.asarray(found, dtype=np.float32)
    _to_metres(distances, cell_m, most_m)
    return distances


@numba.njit(cache=True, nogil=True)
def _to_metres(cells: Distances, cell_m: float, most_m: float) -> None:
    """Scale distances in place; OpenCV's roots may differ in their last bit from one size of map to another."""
    rows, cols = cells.shape
    for i in range(rows):
        for j in range(cols):
            squared = np.rint(cells[i, j] * cells[i, j])
            cells[i, j] = min(np.sqrt(squared) * np.float32(cell_m), np.float32(most_m))


def passable_from_m(vehicle: Vehicle, cell_m: float) -> float:
    """Return the distance in m that is necessary for the rear axle to be anywhere in a cell.

    Of the car at least its inradius lies between the axle and the nearest square. From centre to centre that is half a
    cell more, and the axle may be half a diagonal nearer. A ten-thousandth of a cell is left to rounding.
    """
    return max(vehicle.inradius_m + (0.4999 - math.sqrt(0.5)) * cell_m, cell_m / 2.0)


def connected(passable: Mask) -> tuple[int, Regions]:
    """Return 8-connected regions, numbered from 1, 0 elsewhere, and one more than the highest number."""
    count, regions = cv2.connectedComponents(passable.view(np.uint8), connectivity=8)
    return count, np.asarray(regions, np.int32)


@numba.njit(cache=True, nogil=True)
def route_costs(
    to_blocked_m: Distances, unseen: Mask, passable_m: float, inradius_m: float, unseen_cost: float
) -> NDArray[np.float32]:
    """Return what a metre of a route costs in metres: 1 in the open, twice that along a wall, inf where none leads.

    unseen_cost is added on unseen cells.
    """
    rows, cols = to_blocked_m.shape
    costs = np.empty((rows, cols), np.float32)
    for i in range(rows):
        for j in range(cols):
            if to_blocked_m[i, j] < passable_m:
                costs[i, j] = np.inf
                continue
            lack = 1.0 - min(max(to_blocked_m[i, j] - inradius_m, 0.0) / _NEAR_M, 1.0)
            costs[i, j] = 1.0 + _NEAR_COST * lack * lack + (unseen_cost if unseen[i, j] else 0.0)
    return costs
