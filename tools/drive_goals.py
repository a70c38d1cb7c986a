"""Goals of a drive, checked on the map before anything is started: a drive must not end where it could not begin."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mapping.grid import OccupancyGrid
from tools.config import Config
from tools.errors import ToolError, UsageError

FloatArray = NDArray[np.float64]
Pose = tuple[float, float, float]


def check_goals(grid: OccupancyGrid | None, config: Config, goals: Sequence[Pose], start: Pose | None) -> None:
    """Raise a ToolError of one line for the first goal that cannot be driven to, with the nearest pose that could.

    grid None: there is no map yet that could say so. start: where about the car stands, None where that is not known.
    UsageError for what is no pose, and for a car that cannot steer as tightly as plans are made.
    """
    from planning.costmap import UnknownSpace, costmap
    from planning.ends import check_ends

    for option, pose in [("--start", start), *(("--goal", goal) for goal in goals)]:
        if pose is not None and not all(math.isfinite(value) for value in pose):
            raise UsageError(f"{option} {_words(pose)}: expected finite x and y in m and yaw in rad")
    _check_steering(config)
    if grid is None:
        return
    planning = config.planning
    vehicle = replace(planning.vehicle(), margin_m=min(config.drive.margins_m))
    known = costmap(grid, vehicle, UnknownSpace(planning.unknown))
    if start is not None and known.cell(np.array(start)) is None:
        raise ToolError(f"--start {_words(start)}: is outside the map: it is where about the car stands, in m and rad")
    before = None if start is None or not known.fits(np.array(start)) else start
    for number, goal in enumerate(goals):
        tolerance = planning.plan_settings().tolerance
        ends = check_ends(known, np.array(before or goal), np.array(goal), tolerance)
        if ends.error is not None:
            reason = re.sub(r"^(start|goal) \([^)]*\) ", "", ends.reason)
            if number and before and "no way" in reason:
                reason = f"no way from goal {number} is wide enough for the car, or was seen free"
            advice = "" if ends.advice is None else f"; the nearest pose that would do: --goal {_exact(ends.advice)}"
            raise ToolError(f"--goal {_words(goal)}: {reason}{advice}")
        before = goal


def _check_steering(config: Config) -> None:
    tightest_m = 1.0 / config.vehicle.curvature_limit_1pm
    if config.planning.turning_radius_m < tightest_m:
        raise UsageError(
            f"planning.turning_radius_m {config.planning.turning_radius_m:g}: the car turns on {tightest_m:.3f} m at"
            " best, by vehicle.wheelbase_m and vehicle.steering_limit_rad: plan with more"
        )


def _words(pose: Pose) -> str:
    return " ".join(f"{value:g}" for value in pose)


def _exact(pose: FloatArray) -> str:
    return " ".join(f"{value:.3f}" for value in pose.tolist())
