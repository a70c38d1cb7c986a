"""Following a path: regulated pure pursuit at the rear axle, for cars that also drive backwards.

Sources: Coulter, "Implementation of the pure pursuit path tracking algorithm" (CMU 1992); Macenski et al., "Regulated
pure pursuit for robot path tracking" (2023), whose names are used: lookahead, carrot, approach, regulated speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from drivers.vehicle import DriveCommand
from planning.errors import PlanningError
from planning.path import Path
from planning.pursuit import PursuitRule, Stretch, curvature_1pm, regulated_mps, spot_of, way_on

FloatArray = NDArray[np.float64]


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
        # Copies: compiled code is compiled once more for arrays that are read-only.
        self._poses, self._speeds = (np.array(array, dtype=np.float64) for array in (path.poses, path.speed_mps))
        steps = np.diff(path.poses, axis=0)
        self._marks = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
        self._ends = [*path.cusps.tolist(), len(path.poses) - 1]
        self._stretch = self._stretch_from(0)  # that is driven
        self._rule = PursuitRule(*(getattr(settings, name) for name in PursuitRule._fields))
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
        start = np.array(pose, dtype=np.float64)
        if self._reached:
            return start[np.newaxis]
        path, motion = (self._poses, self._marks, self._speeds), (float(speed_mps), reach_m, clearance_m)
        return way_on(path, self._stretch, self._at_m, self._rule, start, motion)

    def step(self, pose: FloatArray, speed_mps: float, now_s: float, clearance_m: float = math.inf) -> FollowerStep:
        """Return what to command at a pose (3,) in the map frame; clearance_m: from the car's edge to what is near.

        pose and speed should be those at which the command takes hold (motion_prediction).
        """
        pose, stretch = np.array(pose, dtype=np.float64), self._stretch
        spot = spot_of(self._poses, self._marks, stretch, self._at_m, self._rule, pose)
        self._at_m, off = spot.along_m, (spot.across_m, spot.turned_rad)
        self._reached = self._reached or spot.at_end
        if self._reached:
            return self._at_end(pose, speed_mps, now_s, off)
        remaining_m = float(self._marks[-1]) - self._at_m
        curvature = self._curvature(pose, stretch, self._at_m, speed_mps)
        lost = self._lost(*off)
        if lost:
            command = DriveCommand(0.0, curvature)
            return FollowerStep(command, FollowerStatus.off_path, *off, self._at_m, remaining_m, lost)
        speed = regulated_mps(self._marks, self._speeds, self._at_m, curvature, clearance_m, self._rule)
        command = DriveCommand(stretch.gear * speed, curvature)
        return FollowerStep(command, FollowerStatus.driving, *off, self._at_m, remaining_m)

    def _stretch_from(self, begin: int) -> Stretch:
        """Return the stretch that begins at a pose."""
        end = next((int(end) for end in self._ends if end > begin), len(self._path.poses) - 1)
        return Stretch(begin, end, int(self._path.direction[begin]))

    def _curvature(self, pose: FloatArray, stretch: Stretch, along_m: float, speed_mps: float) -> float:
        """Return the curvature to the carrot; 0 on a path of a single pose."""
        if stretch.begin == stretch.end:
            return 0.0
        return curvature_1pm(self._poses, self._marks, stretch, along_m, float(speed_mps), self._rule, pose)

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
        end, rule = self._stretch.end, self._settings
        is_last = end == len(self._path.poses) - 1
        # The wheels turn to where the next stretch begins while the car stands.
        beyond_m = float(self._marks[end])
        curvature = 0.0 if is_last else self._curvature(pose, self._stretch_from(end), beyond_m, 0.0)
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
            self._stretch, self._stood_s, self._reached = self._stretch_from(end), None, False
        remaining_m = float(self._marks[-1]) - self._at_m
        return FollowerStep(DriveCommand(0.0, curvature), status, *off, self._at_m, remaining_m)
