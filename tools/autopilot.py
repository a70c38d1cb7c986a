"""From scans to drive commands on a saved map: place, map of today, plan, follower, look ahead, safety stage.

No clock and no link: whoever has them tells scans and times and sends what comes out, on a car or in the simulator.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from drivers.vehicle import STANDSTILL, DriveCommand
from mapping import se2
from mapping.changing_map import ChangingMap
from mapping.grid import OccupancyGrid
from mapping.map_tracking import MapTracker, TrackingSettings
from mapping.reference_map import reference_map
from mapping.relocalisation import Located
from mapping.sensor_models import LidarModel
from mapping.slam import MappedScan
from planning.collision import LookAheadSettings, contact_at
from planning.costmap import Costmap, UnknownSpace, costmap
from planning.costmap_update import Window, update
from planning.follower import Follower, FollowerSettings, FollowerStatus, FollowerStep
from planning.motion_prediction import MotionModel, MotionPrediction
from planning.path import Path, SpeedLimits
from planning.plan import PlanResult
from planning.safety import SafeCommand, SafetyLimits, SafetyStage, Stamps
from planning.vehicle import Vehicle

FloatArray = NDArray[np.float64]
_SAME_PLACE_M = 0.05
PlanPath = Callable[[Costmap, FloatArray, FloatArray], PlanResult]
"""(Costmap, start (3,), goal (3,)) to a plan."""


class AutopilotState(str, Enum):
    """What it is doing; no_way: there is no path to the goal as things stand."""

    locating = "locating"
    planning = "planning"
    driving = "driving"
    arrived = "arrived"
    no_way = "no_way"


@dataclass(frozen=True, slots=True)
class AutopilotSettings:
    """margins_m: room to keep from walls, the first that leaves a path counts. check_m: how far ahead the path is
    checked on the map of today, with at least check_margin_m. pause_s: standing before a new plan, so that several
    scans see what is in the way; tries: plans in one place that lead nowhere before it gives up. obstacle_range_m: what
    is farther away is not taken for something new: a degree of heading is 7 cm there.
    """

    margins_m: tuple[float, ...] = (0.04, 0.02, 0.0)
    check_m: float = 2.5
    pause_s: float = 0.6
    tries: int = 3
    obstacle_range_m: float = 4.0
    unknown: UnknownSpace = UnknownSpace.forbidden
    speed: SpeedLimits = SpeedLimits()
    motion: MotionModel = MotionModel()
    follower: FollowerSettings = FollowerSettings()
    look_ahead: LookAheadSettings = LookAheadSettings()
    safety: SafetyLimits = SafetyLimits()
    tracking: TrackingSettings = TrackingSettings()


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """One path on the way to the goal, from when on it was followed, and why it was planned."""

    begun_s: float
    path: Path
    reason: str


class Autopilot:
    """Drives to one goal (3,) on a saved map; guess (3,): where about the car stands at the beginning.

    sensor (2,): the laser's place on the body. `drives` and `notes` tell what happened, with times in s.
    """

    def __init__(
        self,
        saved: OccupancyGrid,
        vehicle: Vehicle,
        guess: FloatArray,
        goal: FloatArray,
        plan_path: PlanPath,
        sensor: FloatArray,
        settings: AutopilotSettings = AutopilotSettings(),
    ) -> None:
        self.safety = SafetyStage(settings.safety)
        self.state = AutopilotState.locating
        self.drives: list[Drive] = []
        self.notes: list[tuple[float, str]] = []
        self.step: FollowerStep | None = None
        self.place: Located | None = None
        self._settings, self._goal, self._plan_path, self._sensor = settings, goal, plan_path, sensor
        self._locating = _Locating(saved, guess, sensor, settings.tracking)
        self._map = ChangingMap(saved, LidarModel(max_range_m=settings.obstacle_range_m))
        self._costmap = costmap(self._map.grid(), replace(vehicle, margin_m=settings.margins_m[0]), settings.unknown)
        self._prediction = MotionPrediction(settings.motion)
        self._follower: Follower | None = None
        self._left: Follower | None = None
        self._blocked = ""
        self._stood_s: float | None = None
        self._failed = 0
        self._tried_at: FloatArray | None = None
        self._scan_s: float | None = None

    def note_scan(self, stamp_s: float) -> None:
        """Take note of a scan that came, whether or not it gives a pose."""
        self._scan_s = stamp_s

    def add_scan(self, mapped: MappedScan) -> None:
        """Take in a scan that was matched."""
        self.place = place = self._locating.add(mapped)
        if place is None or place.by_odometry:
            return
        if self.state is AutopilotState.locating:
            self.state = AutopilotState.planning
        laser = se2.transform_points(place.T_map_base, self._sensor)
        changed = self._map.add_scan(laser, se2.transform_points(place.T_map_base, mapped.points))
        if changed is not None:
            self._costmap = update(self._costmap, self._map.grid(), Window(*changed))
        if self._follower is not None and not self._blocked:
            hit = contact_at(self._costmap, self._follower.ahead(self._settings.check_m))
            if hit is not None:
                self._blocked = f"something on the path, {0.01 * hit:.1f} m ahead"
                self.notes.append((place.stamp_ns * 1e-9, self._blocked))

    def tick(self, now_s: float) -> SafeCommand:
        """Return what to send to the vehicle now; call it 20 times a second."""
        pose_s = None if self.place is None else self.place.stamp_ns * 1e-9
        wanted = STANDSTILL if self.place is None else self._wanted(self.place, now_s)
        safe = self.safety.step(wanted, Stamps(pose_s, self._scan_s, now_s), now_s)
        self._prediction.tell(now_s, safe.command)
        return safe

    def _wanted(self, place: Located, now_s: float) -> DriveCommand:
        soon_s = now_s + self._settings.motion.latency_s
        pose = self._prediction.pose_at(place.T_map_base, place.stamp_ns * 1e-9, soon_s)
        speed_mps = self._prediction.speed_mps(soon_s)
        if self.state in (AutopilotState.arrived, AutopilotState.no_way, AutopilotState.locating):
            return STANDSTILL
        if self.state is AutopilotState.planning:
            self._plan_when_standing(pose, speed_mps, now_s)
        if self._follower is not None:
            return self._follow(self._follower, pose, speed_mps, now_s)
        if self._left is not None:  # it brakes on the path that it leaves
            return DriveCommand(0.0, self._left.step(pose, speed_mps, now_s).command.curvature_1pm)
        return STANDSTILL

    def _follow(self, follower: Follower, pose: FloatArray, speed_mps: float, now_s: float) -> DriveCommand:
        clearance_m = self._costmap.clearance_m(pose[np.newaxis])
        step = follower.step(pose, speed_mps, now_s, clearance_m)
        reach_m = self._settings.look_ahead.reach_m(max(abs(speed_mps), abs(step.command.speed_mps)))
        way = follower.way(pose, speed_mps, reach_m, clearance_m)
        contact = contact_at(self._costmap, way) if step.command.speed_mps else None
        if self._blocked:
            step = step.blocked(self._blocked)
        elif contact is not None:
            way_m = float(np.hypot(*np.diff(way[: contact + 1, :2], axis=0).T).sum())
            step = step.blocked(f"contact in {way_m:.2f} m")
            self.notes.append((now_s, step.reason))
        self.step = step
        if step.status is FollowerStatus.arrived:
            self.state = AutopilotState.arrived
        elif step.status in (FollowerStatus.blocked, FollowerStatus.off_path):
            self._blocked = step.reason
            self.state, self._stood_s = AutopilotState.planning, None
            self._follower, self._left = None, follower
        return step.command

    def _plan_when_standing(self, pose: FloatArray, speed_mps: float, now_s: float) -> None:
        """Plan once the car has stood long enough for the map of today to be right."""
        if abs(speed_mps) > self._settings.follower.standing_mps:
            self._stood_s = None
            return
        self._stood_s = now_s if self._stood_s is None else self._stood_s
        if now_s - self._stood_s < self._settings.pause_s:
            return
        path, words = self._plan(pose)
        tried = self._tried_at is not None and float(np.hypot(*(pose - self._tried_at)[:2])) < _SAME_PLACE_M
        self._tried_at = pose
        self._failed = self._failed if tried else 0
        if path is not None and tried:
            self._failed += 1  # a path was found here before, and could not be followed
        if path is not None and self._failed < self._settings.tries:
            self._follower = Follower(path.at_speed(self._settings.speed), self._settings.follower)
            self.drives.append(Drive(now_s, path, self._blocked or "set out"))
            self.state, self._blocked = AutopilotState.driving, ""
            return
        self._failed += 1
        self._stood_s = None
        self.notes.append((now_s, words or "no path can be followed from here"))
        if self._failed >= self._settings.tries:
            self.state = AutopilotState.no_way

    def _plan(self, pose: FloatArray) -> tuple[Path | None, str]:
        """Return a path with as much room as there is, or why there is none."""
        words = ""
        for margin_m in self._settings.margins_m:
            vehicle = replace(self._costmap.vehicle, margin_m=margin_m)
            known = costmap(self._map.grid(), vehicle, self._settings.unknown)
            result = self._plan_path(known, pose, self._goal)
            if result.path is not None:
                self._costmap = known
                return result.path, ""
            words = words or result.reason
        return None, words


class _Locating:
    """Follows the car on the map from a guess, which the first scans make exact."""

    _FIRST = 5

    def __init__(self, saved: OccupancyGrid, guess: FloatArray, sensor: FloatArray, settings: TrackingSettings) -> None:
        self._map = reference_map(saved)
        self._guess, self._sensor, self._settings = guess, sensor, settings
        self._tracker: MapTracker | None = None
        self._first = 0

    def add(self, mapped: MappedScan) -> Located | None:
        if not mapped.match.accepted:
            return None
        odom = mapped.match.pose
        if self._tracker is None:
            spread = np.diag([0.1, 0.1, 0.1]) ** 2
            T_map_odom = se2.compose(self._guess, se2.inverse(odom))
            found = Located(mapped.stamp_ns, self._guess, T_map_odom, spread, 0.0, "told")
            self._tracker = MapTracker(self._map, found, replace(self._settings, step_m=0.0), self._sensor)
        place = self._tracker.add(mapped.stamp_ns, mapped.points, odom)
        if self._first < self._FIRST:
            self._first += 1
            if self._first < self._FIRST:
                return None
            if place is not None:
                self._tracker = MapTracker(self._map, place, self._settings, self._sensor)
        return place
