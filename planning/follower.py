"""Following a path: regulated pure pursuit at the rear axle, for cars that also drive backwards.

Sources: Coulter, "Implementation of the pure pursuit path tracking algorithm" (CMU 1992); Macenski et al., "Regulated
pure pursuit for robot path tracking" (2023), whose names are used: lookahead, carrot, approach, regulated speed.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass, fields, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from drivers.vehicle import DriveCommand
from mapping import se2
from planning.errors import PlanningError
from planning.path import Path

FloatArray = NDArray[np.float64]
_WAY_STEP_M = 0.02


@dataclass(frozen=True, slots=True)
class FollowerSettings:
    """How a path is followed; lengths in m of the rear axle's way.

    The carrot is lookahead_s times the speed ahead, from least_lookahead_m to most_lookahead_m. That is nearer than is
    usual (1.5 s), cuts corners by a third as much, and is steady because latency is predicted (docs/driving.md). Speed
    is that of the path, less in curves tighter than slow_radius_m and where the car's edge is nearer than near_m to
    something, and never below least_mps. reached_m: so near its end a stretch counts as driven. shift_s: standing
    between two gears, for the wheels to turn. curvature_limit_1pm: of a full lock. Farther than off_path_m beside the
    path, or turned by more than off_path_rad from it, the car stops. window_m: how far along the path the car is looked
    for.
    """

    lookahead_s: float = 0.6
    least_lookahead_m: float = 0.2
    most_lookahead_m: float = 0.9
    slow_radius_m: float = 0.9
    near_m: float = 0.15
    least_mps: float = 0.05
    reached_m: float = 0.005
    standing_mps: float = 0.01
    shift_s: float = 0.4
    curvature_limit_1pm: float = math.tan(math.radians(30.0)) / 0.256
    off_path_m: float = 0.3
    off_path_rad: float = 1.0
    window_m: float = 0.5

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value > 0.0):
                raise PlanningError(f"follower: {field.name} is {value}, expected a finite number above 0")
        if self.least_lookahead_m > self.most_lookahead_m:
            raise PlanningError(
                f"follower: least_lookahead_m {self.least_lookahead_m} is above most_lookahead_m "
                f"{self.most_lookahead_m}: swap them"
            )


class FollowerStatus(str, Enum):
    """What the follower is doing."""

    driving = "driving"
    cusp = "cusp"
    arrived = "arrived"
    off_path = "off_path"
    blocked = "blocked"


@dataclass(frozen=True, slots=True)
class FollowerStep:
    """What to command now, and where the car is: beside the path, left in driving direction positive, and on it.

    heading_error_rad: how far the car is turned from the path's heading, counter-clockwise. reason: in words, where the
    status is off_path or blocked. progress_m: driven along the path.
    """

    command: DriveCommand
    status: FollowerStatus
    cross_track_m: float
    heading_error_rad: float
    progress_m: float
    remaining_m: float
    reason: str = ""

    def blocked(self, reason: str) -> FollowerStep:
        """Return a step that stands still with the wheels as they were to be."""
        command = DriveCommand(0.0, self.command.curvature_1pm)
        return replace(self, command=command, status=FollowerStatus.blocked, reason=reason)


class Follower:
    """Follows one path from its beginning, gear by gear; another path needs another follower."""

    def __init__(self, path: Path, settings: FollowerSettings = FollowerSettings()) -> None:
        if len(path.poses) == 0:
            raise PlanningError("a path without poses cannot be followed: plan first")
        self._settings = settings
        self._path = path
        steps = np.diff(path.poses, axis=0)
        self._marks = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
        self._ends = [*path.cusps.tolist(), len(path.poses) - 1]
        self._begin = 0  # first pose of the stretch that is driven
        self._at_m = 0.0
        self._stood_s: float | None = None  # since when the car has stood at the stretch's end
        self._reached = False

    @property
    def progress_m(self) -> float:
        """How much of the path is driven."""
        return self._at_m

    def ahead(self, most_m: float) -> FloatArray:
        """Return the path's poses (K, 3) from where the car is, as far as most_m of driving."""
        first, last = np.searchsorted(self._marks, [self._at_m, self._at_m + most_m])
        return self._path.poses[first : last + 1]

    def way(self, pose: FloatArray, speed_mps: float, reach_m: float, clearance_m: float = math.inf) -> FloatArray:
        """Return the poses (K, 3), about 2 cm apart, that the car is going to take on its stretch, as far as reach_m.

        The steering is taken to follow at once. The follower stays as it is.
        """
        ghost = copy(self)
        poses, driven_m, gear = [pose], 0.0, int(self._path.direction[self._begin])
        while driven_m < reach_m:
            step = ghost.step(poses[-1], speed_mps, 0.0, clearance_m)
            if step.status is not FollowerStatus.driving or step.command.speed_mps == 0.0:
                break
            speed_mps = step.command.speed_mps
            way_m = gear * _WAY_STEP_M
            poses.append(se2.compose(poses[-1], se2.exp(np.array([way_m, 0.0, way_m * step.command.curvature_1pm]))))
            driven_m += _WAY_STEP_M
        return np.array(poses)

    def step(self, pose: FloatArray, speed_mps: float, now_s: float, clearance_m: float = math.inf) -> FollowerStep:
        """Return what to command at a pose (3,) in the map frame; clearance_m: from the car's edge to what is near.

        pose and speed should be those at which the command takes hold (motion_prediction).
        """
        gear = int(self._path.direction[self._begin])
        along_m, across_m, heading_rad, beyond = self._place(pose, gear)
        remaining_m = float(self._marks[-1]) - along_m
        self._reached = self._reached or beyond
        if self._reached:
            return self._at_end(pose, speed_mps, now_s, (across_m, heading_rad))
        curvature = self._curvature(pose, self._begin, along_m, speed_mps)
        lost = self._lost(across_m, heading_rad)
        if lost:
            command = DriveCommand(0.0, curvature)
            return FollowerStep(command, FollowerStatus.off_path, across_m, heading_rad, along_m, remaining_m, lost)
        speed = gear * self._speed(along_m, curvature, clearance_m)
        command = DriveCommand(speed, curvature)
        return FollowerStep(command, FollowerStatus.driving, across_m, heading_rad, along_m, remaining_m)

    def _end(self, begin: int) -> int:
        """Return the last pose of the stretch that begins at a pose."""
        return next((int(end) for end in self._ends if end > begin), len(self._path.poses) - 1)

    def _place(self, pose: FloatArray, gear: int) -> tuple[float, float, float, bool]:
        """Find the car on its stretch: metres along the path, beside it, turned from it, and whether at its end."""
        begin, end, rule = self._begin, self._end(self._begin), self._settings
        low_m, high_m = self._at_m - rule.window_m, self._at_m + rule.window_m
        first = max(begin, int(np.searchsorted(self._marks, low_m)))
        last = min(end, int(np.searchsorted(self._marks, high_m)))
        near = self._path.poses[first : last + 1]
        n = first + int(np.argmin((near[:, 0] - pose[0]) ** 2 + (near[:, 1] - pose[1]) ** 2))
        x, y, yaw = se2.between(self._path.poses[n], pose).tolist()  # the car as the path's pose sees it
        along_m = float(np.clip(self._marks[n] + gear * x, self._marks[begin], self._marks[end]))
        self._at_m = max(self._at_m, along_m)
        beyond = n == end and gear * x >= -rule.reached_m
        return self._at_m, gear * y, yaw, beyond

    def _carrot(self, begin: int, along_m: float, lookahead_m: float) -> tuple[float, float]:
        """Return the point on a stretch to steer for; beyond its end on the straight line that goes on from it."""
        marks, poses, end = self._marks, self._path.poses, self._end(begin)
        gear = int(self._path.direction[begin])
        at_m = along_m + lookahead_m
        over_m = max(0.0, at_m - float(marks[end]))
        stretch = slice(begin, end + 1)
        x = float(np.interp(at_m, marks[stretch], poses[stretch, 0]))
        y = float(np.interp(at_m, marks[stretch], poses[stretch, 1]))
        yaw = float(poses[end, 2])
        return x + gear * over_m * math.cos(yaw), y + gear * over_m * math.sin(yaw)

    def _curvature(self, pose: FloatArray, begin: int, along_m: float, speed_mps: float) -> float:
        """Return the curvature of the circle through the car, tangent to it, and the carrot."""
        rule = self._settings
        wanted_m = rule.lookahead_s * max(abs(speed_mps), rule.least_mps)
        lookahead_m = min(max(wanted_m, rule.least_lookahead_m), rule.most_lookahead_m)
        x, y = self._carrot(begin, along_m, lookahead_m)
        dx, dy = x - float(pose[0]), y - float(pose[1])
        sideways_m = -math.sin(pose[2]) * dx + math.cos(pose[2]) * dy
        curvature = 2.0 * sideways_m / max(dx * dx + dy * dy, 1e-6)
        return min(max(curvature, -rule.curvature_limit_1pm), rule.curvature_limit_1pm)

    def _speed(self, along_m: float, curvature_1pm: float, clearance_m: float) -> float:
        """Return the regulated speed, without its sign."""
        rule = self._settings
        speed = float(np.interp(along_m, self._marks, self._path.speed_mps))
        # The path's own curve may be tighter than the one to the carrot.
        speed *= min(1.0, 1.0 / max(abs(curvature_1pm) * rule.slow_radius_m, 1e-9))
        speed *= min(1.0, max(clearance_m, 0.0) / rule.near_m)
        return max(speed, rule.least_mps)

    def _lost(self, across_m: float, heading_rad: float) -> str:
        """Return why the car cannot be on its way, empty where it is."""
        rule = self._settings
        if abs(across_m) > rule.off_path_m:
            return f"{abs(across_m):.2f} m beside the path, {rule.off_path_m:g} m are allowed"
        if abs(heading_rad) > rule.off_path_rad:
            turned, most = math.degrees(abs(heading_rad)), math.degrees(rule.off_path_rad)
            return f"turned by {turned:.0f} deg from the path, {most:.0f} deg are allowed"
        return ""

    def _at_end(self, pose: FloatArray, speed_mps: float, now_s: float, off: tuple[float, float]) -> FollowerStep:
        """Stand at the stretch's end; once the car stands and the wheels have turned, take up the next stretch."""
        end, rule = self._end(self._begin), self._settings
        is_last = end == len(self._path.poses) - 1
        # The wheels turn to where the next stretch begins while the car stands.
        curvature = 0.0 if is_last else self._curvature(pose, end, float(self._marks[end]), 0.0)
        if abs(speed_mps) > rule.standing_mps:
            self._stood_s = None
        elif self._stood_s is None:
            self._stood_s = now_s
        stands = self._stood_s is not None and (is_last or now_s - self._stood_s >= rule.shift_s)
        status = FollowerStatus.cusp
        if is_last:
            status = FollowerStatus.arrived if stands else FollowerStatus.driving
        self._at_m = float(self._marks[end])
        if stands and not is_last:
            self._begin, self._stood_s, self._reached = end, None, False
        remaining_m = float(self._marks[-1]) - self._at_m
        return FollowerStep(DriveCommand(0.0, curvature), status, *off, self._at_m, remaining_m)
