"""The section `planning` of the configuration: the car, how it may drive, and how long a plan may take."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from pydantic import Field, model_validator
from typing_extensions import Self

from planning.errors import PlanningError
from planning.path import SpeedLimits
from planning.vehicle import LEAST_RADIUS_M, Vehicle
from tools.config_section import Section

if TYPE_CHECKING:
    from planning.plan import PlanSettings

_QCAR = Vehicle()
_SPEED = SpeedLimits()


class SpeedSection(Section):
    """How fast a planned path is to be driven."""

    top_mps: float = Field(_SPEED.top_mps, gt=0, le=10, description="m/s at most")
    lateral_mps2: float = Field(_SPEED.lateral_mps2, gt=0, le=20, description="m/s^2 sideways, which slows turns down")
    acceleration_mps2: float = Field(_SPEED.acceleration_mps2, gt=0, le=20, description="m/s^2 along the path")
    creep_mps: float = Field(_SPEED.creep_mps, gt=0, le=10, description="m/s where the car sets off or changes gear")

    def limits(self) -> SpeedLimits:
        """Return them as the planner wants them."""
        return SpeedLimits(**self.model_dump())


class PlanningSection(Section):
    """The car that drives, and how its paths are found."""

    footprint: tuple[tuple[float, float], ...] = Field(
        _QCAR.footprint,
        description="corners [x, y] of the body in m from the middle of the rear axle, x ahead, y to the left",
    )
    turning_radius_m: float = Field(
        _QCAR.turning_radius_m,
        ge=LEAST_RADIUS_M,
        le=100,
        description="tightest circle of the rear axle; 1.3 times what the steering can do leaves room to correct",
    )
    margin_m: float = Field(_QCAR.margin_m, ge=0, le=10, description="room to keep around the body")
    reverse_cost: float = Field(_QCAR.reverse_cost, ge=1, le=100, description="a metre backwards counts as so many")
    cusp_cost_m: float = Field(_QCAR.cusp_cost_m, ge=0, le=100, description="a gear change counts as so many metres")
    forward_only: bool = Field(_QCAR.forward_only, description="never drive backwards")
    unknown: Literal["forbidden", "costly", "free"] = Field(
        "forbidden",
        description="space that was not seen: keep off (specks smaller than the car excepted), go there for want of a"
        " better way, or like anywhere else",
    )
    planner: Literal["car", "rrt", "rrt_connect", "rrt_star", "informed_rrt_star", "bit_star"] = Field(
        "car", description="car: a guided search and improvement; the others are OMPL's alone, for comparison"
    )
    budget_s: float = Field(0.3, ge=0, le=3600, description="time for finding a path and making it shorter")
    iterations: int = Field(200, ge=1, le=10_000_000, description="the budget instead, where a seed is given")
    time_limit_s: float = Field(10.0, ge=0, le=3600, description="after this there is no path")
    goal_tolerance_m: float = Field(0.0, ge=0, le=100, description="how far from the goal the car may end")
    goal_tolerance_rad: float = Field(0.0, ge=0, le=3.15, description="and how much turned from it")
    speed: SpeedSection = SpeedSection()

    @model_validator(mode="after")
    def _is_a_car(self) -> Self:
        try:
            self.vehicle()
            self.speed.limits()
        except PlanningError as error:
            raise ValueError(str(error)) from error
        return self

    def vehicle(self) -> Vehicle:
        """Return the car."""
        return Vehicle(
            footprint=self.footprint,
            turning_radius_m=self.turning_radius_m,
            margin_m=self.margin_m,
            reverse_cost=self.reverse_cost,
            cusp_cost_m=self.cusp_cost_m,
            forward_only=self.forward_only,
        )

    def plan_settings(self) -> PlanSettings:
        """Return how a path is searched for."""
        from planning.ends import GoalTolerance  # compiled code, and OMPL
        from planning.plan import Planner, PlanSettings

        return PlanSettings(
            planner=Planner(self.planner),
            budget_s=self.budget_s,
            iterations=self.iterations,
            time_limit_s=self.time_limit_s,
            tolerance=GoalTolerance(self.goal_tolerance_m, self.goal_tolerance_rad),
        )
