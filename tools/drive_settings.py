"""How the autopilot drives: what it keeps clear of, how long it looks and waits, and when it gives up."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mapping.map_tracking import TrackingSettings
from planning.collision import LookAheadSettings
from planning.costmap import UnknownSpace
from planning.errors import PlanningError
from planning.follower import FollowerSettings
from planning.motion_prediction import MotionModel
from planning.path import SpeedLimits
from planning.safety import SafetyLimits


@dataclass(frozen=True, slots=True)
class AutopilotSettings:
    """margins_m: room to keep from walls, the first that leaves a path counts.

    check_m: how far ahead the path is checked on the map of today. pause_s: standing before a new plan, so that several
    scans see what is in the way; tries: plans in one place that lead nowhere before it backs off or gives up. A plan is
    of no use to a car that has moved by more than moved_m or moved_rad while it was made. back_m: how far it backs off
    at most; back_offs: how often on the way to one goal. obstacle_range_m: what is farther away is not taken for
    something new: a degree of heading is 7 cm there.

    Raises PlanningError for values that make no sense.
    """

    margins_m: tuple[float, ...] = (0.07, 0.04, 0.02, 0.0)
    check_m: float = 2.5
    pause_s: float = 0.6
    tries: int = 3
    moved_m: float = 0.05
    moved_rad: float = 0.05
    back_m: float = 0.5
    back_offs: int = 3
    obstacle_range_m: float = 4.0
    unknown: UnknownSpace = UnknownSpace.forbidden
    speed: SpeedLimits = SpeedLimits()
    motion: MotionModel = MotionModel()
    follower: FollowerSettings = FollowerSettings()
    look_ahead: LookAheadSettings = LookAheadSettings()
    safety: SafetyLimits = SafetyLimits()
    tracking: TrackingSettings = TrackingSettings()

    def __post_init__(self) -> None:
        if not self.margins_m or not all(math.isfinite(margin_m) and margin_m >= 0.0 for margin_m in self.margins_m):
            raise PlanningError(f"drive: margins_m is {self.margins_m}, expected one or more numbers of 0 or more")
        for name in ("check_m", "moved_m", "moved_rad", "back_m", "obstacle_range_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise PlanningError(f"drive: {name} is {value}, expected a finite number above 0")
        if not (math.isfinite(self.pause_s) and self.pause_s >= 0.0):
            raise PlanningError(f"drive: pause_s is {self.pause_s}, expected a finite number of 0 or more")
        if self.tries < 1 or self.back_offs < 0:
            raise PlanningError(
                f"drive: tries is {self.tries} and back_offs {self.back_offs}, expected 1 and 0 or more"
            )
