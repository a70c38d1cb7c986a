"""Backing off from where no path begins: back along the way that the car came, or straight, as far as it is free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from planning.collision import first_contact
from planning.costmap import Costmap
from planning.path import Path, path_along

FloatArray = NDArray[np.float64]

_STEP_M = 0.01
_LEAST_M = 0.05  # less is not worth while
_AS_LONG = 0.8  # the way that the car came, if it is so long as a share of the longest
_KEEP_M = 0.03  # stopped so far before what the way ends at


def retreat(
    costmap: Costmap, pose: FloatArray, driven: Path | None, most_m: float, margins_m: tuple[float, ...]
) -> Path | None:
    """Return the way back from a pose (3,) in the map frame, at most most_m; None where none is free.

    driven: the way that the car came, to about where it stands, which counts first. Where it drove backwards last, back
    is ahead. The first margin that leaves a way counts. Where the car stands too near to something, it may leave;
    unknown space is taken for occupied where the costmap forbids it.
    """
    gear = 1 if driven is None or driven.direction[-1] > 0 else -1
    ways = [_straight(pose, -gear, most_m)]
    if driven is not None and len(driven.poses) > 1:
        ways.insert(0, _retraced(driven, most_m))
    for margin_m in margins_m:
        corners = replace(costmap.vehicle, margin_m=margin_m).corners
        free = [(poses[: _free(costmap, poses, corners)], gears) for poses, gears in ways]
        longest = max(len(poses) for poses, _ in free)
        poses, gears = next(way for way in free if len(way[0]) >= _AS_LONG * longest)
        if len(poses) * _STEP_M > _LEAST_M:
            return path_along(poses, gears[: len(poses)])
    return None


def _straight(pose: FloatArray, gear: int, most_m: float) -> tuple[FloatArray, NDArray[np.int8]]:
    along = np.arange(round(most_m / _STEP_M) + 1) * _STEP_M * gear
    poses = se2.compose(pose, np.column_stack([along, np.zeros((len(along), 2))]))
    return poses, np.full(len(poses), gear, np.int8)


def _retraced(driven: Path, most_m: float) -> tuple[FloatArray, NDArray[np.int8]]:
    """Return the last part of a way backwards, without what lies before a change of gear."""
    poses, gears = driven.poses[::-1], driven.direction[::-1]
    lengths_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    shifts = np.flatnonzero(gears != gears[0])
    last = min(int(np.searchsorted(lengths_m, most_m, "right")), int(shifts[0]) if len(shifts) else len(poses))
    return poses[:last], np.full(last, -gears[0], np.int8)


def _free(costmap: Costmap, poses: FloatArray, corners: FloatArray) -> int:
    """Return how many of the first of poses (N, 3) may be driven; a way that ends at something ends before it."""
    local = np.ascontiguousarray(costmap.local(poses))
    grid = (costmap.blocked, costmap.to_blocked_m, costmap.grid.resolution_m)
    contact = first_contact(*grid, local, corners)
    return len(poses) if contact < 0 else max(contact - round(_KEEP_M / _STEP_M), 0)
