"""Driving one path: the follower's command, and whether anything stands on the way that it is going to take."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.vehicle import DriveCommand
from planning.collision import contact_at
from planning.costmap import Costmap
from planning.follower import Follower, FollowerStatus, FollowerStep
from planning.path import Path
from tools.drive_settings import AutopilotSettings

FloatArray = NDArray[np.float64]

_POSES_PER_M = 100  # of a path


class Following:
    """A path that is being driven. blocked: why it is left, empty while it is not; once blocked it stays so."""

    def __init__(self, path: Path, settings: AutopilotSettings) -> None:
        self.path = path.at_speed(settings.speed)
        self.blocked = ""
        self.last: FollowerStep | None = None
        self._follower = Follower(self.path, settings.follower)
        self._settings = settings
        self._checked: Costmap | None = None

    def step(self, near: Costmap, pose: FloatArray, speed_mps: float, now_s: float) -> FollowerStep:
        """Return what to command at a pose (3,) with what stands around it."""
        if near is not self._checked and not self.blocked:
            self._checked = near
            hit = contact_at(near, self._follower.ahead(self._settings.check_m))
            if hit is not None:
                self.blocked = f"something on the path, {hit / _POSES_PER_M:.1f} m ahead"
        clearance_m = near.clearance_m(pose[np.newaxis])
        step = self._follower.step(pose, speed_mps, now_s, clearance_m)
        if step.command.speed_mps and not self.blocked:
            self.blocked = self._contact(near, step, pose, speed_mps, clearance_m)
        if step.status is FollowerStatus.off_path:
            self.blocked = self.blocked or step.reason
        if self.blocked and step.status is not FollowerStatus.off_path:
            step = step.blocked(self.blocked)
        self.last = step
        return step

    def braking(self, pose: FloatArray, speed_mps: float, now_s: float) -> DriveCommand:
        """Return how to brake on the path."""
        return DriveCommand(0.0, self._follower.step(pose, speed_mps, now_s).command.curvature_1pm)

    @property
    def driven(self) -> Path | None:
        """The part of the path up to where the car is; None at its beginning."""
        count = len(self.path.poses) - len(self._follower.ahead(np.inf))
        if count < 2:
            return None
        return Path(self.path.poses[:count], self.path.direction[:count], self.path.speed_mps[:count])

    def _contact(
        self, near: Costmap, step: FollowerStep, pose: FloatArray, speed_mps: float, clearance_m: float
    ) -> str:
        """Return what the car would touch on the way that it is going to take; empty where nothing."""
        reach_m = self._settings.look_ahead.reach_m(max(abs(speed_mps), abs(step.command.speed_mps)))
        way = self._follower.way(pose, speed_mps, reach_m, clearance_m)
        contact = contact_at(near, way)
        if contact is None:
            return ""
        way_m = float(np.hypot(*np.diff(way[: contact + 1, :2], axis=0).T).sum())
        return f"contact in {way_m:.2f} m"
