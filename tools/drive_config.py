"""The sections `vehicle` and `drive` of the configuration: what the car can do, and what it may do while driving."""

from __future__ import annotations

import math

from pydantic import Field, model_validator
from typing_extensions import Self

from planning.collision import LookAheadSettings
from planning.errors import PlanningError
from planning.follower import FollowerSettings
from planning.motion_prediction import MotionModel
from planning.safety import SafetyLimits
from tools.config_section import Section

_MOTION = MotionModel()
_SAFETY = SafetyLimits()
_FOLLOWER = FollowerSettings()
_AHEAD = LookAheadSettings()


class VehicleSection(Section):
    """What steers and drives the car; its outline is planning.footprint. The defaults are a QCar's."""

    wheelbase_m: float = Field(_MOTION.wheelbase_m, gt=0, le=10, description="from the rear axle to the front one")
    steering_limit_rad: float = Field(
        math.radians(30.0), gt=0, lt=1.5, description="of the front wheels to either side; with the wheelbase: 0.443 m"
    )
    steering_rate_radps: float = Field(
        _MOTION.steering_rate_radps, gt=0, le=100, description="how fast they turn; assumed: measure yours"
    )
    acceleration_mps2: float = Field(
        _MOTION.acceleration_mps2, gt=0, le=100, description="speeding up and braking; assumed: measure yours"
    )
    latency_s: float = Field(
        _MOTION.latency_s, ge=0, le=1, description="from a command to its first effect; assumed: measure yours"
    )
    mass_kg: float = Field(2.7, gt=0, le=10_000, description="from no source: weigh yours; nothing reckons with it yet")

    @property
    def curvature_limit_1pm(self) -> float:
        """Curvature of the rear axle's way at full lock."""
        return math.tan(self.steering_limit_rad) / self.wheelbase_m

    def motion(self) -> MotionModel:
        """Return what the car makes of a command."""
        return MotionModel(self.latency_s, self.acceleration_mps2, self.steering_rate_radps, self.wheelbase_m)


class DriveSection(Section):
    """How a car that drives itself follows its path, and what stops it."""

    speed_mps: float = Field(_SAFETY.speed_mps, gt=0, le=10, description="nothing faster leaves for the vehicle")
    reverse_mps: float = Field(_SAFETY.reverse_mps, gt=0, le=10, description="and nothing faster backwards")
    acceleration_mps2: float = Field(
        _SAFETY.acceleration_mps2, gt=0, le=20, description="of commands that speed up; slowing down is never held back"
    )
    pose_age_s: float = Field(_SAFETY.pose_age_s, gt=0, le=5, description="the car stands where its last pose is older")
    scan_age_s: float = Field(_SAFETY.scan_age_s, gt=0, le=5, description="or the last scan")
    margins_m: tuple[float, ...] = Field(
        (0.07, 0.04, 0.02, 0.0),
        min_length=1,
        description="room to keep around the body: the first that leaves a path counts",
    )
    lookahead_s: float = Field(
        _FOLLOWER.lookahead_s, gt=0, le=10, description="the car heads for where its path is so much later; see docs"
    )
    least_lookahead_m: float = Field(_FOLLOWER.least_lookahead_m, gt=0, le=10, description="at least so far ahead")
    most_lookahead_m: float = Field(_FOLLOWER.most_lookahead_m, gt=0, le=10, description="and at most")
    near_m: float = Field(_FOLLOWER.near_m, gt=0, le=10, description="slower where something is nearer to the body")
    off_path_m: float = Field(_FOLLOWER.off_path_m, gt=0, le=10, description="farther beside its path the car stops")
    check_m: float = Field(2.5, gt=0, le=100, description="so much of the path is checked on the map of today")
    horizon_s: float = Field(_AHEAD.horizon_s, gt=0, le=10, description="of the look ahead with the exact outline")
    braking_mps2: float = Field(_AHEAD.deceleration_mps2, gt=0, le=100, description="that the look ahead reckons with")
    pause_s: float = Field(0.6, ge=0, le=60, description="standing before a new plan, to see what is in the way")
    back_m: float = Field(0.5, gt=0, le=10, description="how far the car backs off at most where no path leads on")
    back_offs: int = Field(3, ge=0, le=100, description="how often on the way to one goal")
    obstacle_range_m: float = Field(4.0, gt=0, le=50, description="what is new on the map of today is not farther away")

    patience_s: float = Field(
        60.0, gt=0, le=86400, description="the run ends where the car does not know its place for so long"
    )

    @model_validator(mode="after")
    def _can_be_driven(self) -> Self:
        if any(not 0.0 <= margin_m <= 10.0 for margin_m in self.margins_m):
            raise ValueError(f"margins_m {list(self.margins_m)}: expected metres from 0 to 10")
        try:
            self.follower(_FOLLOWER.curvature_limit_1pm)
        except PlanningError as error:
            raise ValueError(str(error)) from error
        return self

    def safety(self, vehicle: VehicleSection) -> SafetyLimits:
        """Return the limits of the last stage before the car."""
        return SafetyLimits(
            speed_mps=self.speed_mps,
            reverse_mps=self.reverse_mps,
            curvature_1pm=vehicle.curvature_limit_1pm,
            acceleration_mps2=self.acceleration_mps2,
            pose_age_s=self.pose_age_s,
            scan_age_s=self.scan_age_s,
        )

    def follower(self, curvature_limit_1pm: float) -> FollowerSettings:
        """Return how a path is followed by a car that can steer so much."""
        return FollowerSettings(
            lookahead_s=self.lookahead_s,
            least_lookahead_m=self.least_lookahead_m,
            most_lookahead_m=self.most_lookahead_m,
            near_m=self.near_m,
            curvature_limit_1pm=curvature_limit_1pm,
            off_path_m=self.off_path_m,
        )

    def look_ahead(self) -> LookAheadSettings:
        """Return how far ahead the car looks."""
        return LookAheadSettings(horizon_s=self.horizon_s, deceleration_mps2=self.braking_mps2)
