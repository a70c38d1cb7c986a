"""The car: its rectangle around base_link (the middle of the rear axle) and how it turns."""

from __future__ import annotations

import math
from dataclasses import dataclass

from planning.errors import PlanningError

LEAST_RADIUS_M = 0.2


@dataclass(frozen=True, slots=True)
class Vehicle:
    """Sizes in m, as the corners of the body lie from base_link; margin_m is added all round while planning.

    Defaults: Quanser QCar, wheel base 0.256 m and steering of 30 deg (Quanser's configuration files), which turns on
    0.443 m; 1.25 times that leaves the follower something to steer with. The body, 0.425 m x 0.192 m, is not in any
    source found and should be measured. Raises PlanningError for sizes that are not finite and positive.
    """

    front_m: float = 0.3405
    rear_m: float = 0.0845
    half_width_m: float = 0.096
    turning_radius_m: float = 0.55
    margin_m: float = 0.01

    def __post_init__(self) -> None:
        for name in ("front_m", "rear_m", "half_width_m", "turning_radius_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise PlanningError(f"vehicle: {name} is {value}, expected a positive length in m")
        if self.turning_radius_m < LEAST_RADIUS_M:
            raise PlanningError(
                f"vehicle: turning_radius_m is {self.turning_radius_m}, expected {LEAST_RADIUS_M} or more: paths are "
                "checked every centimetre, too coarse for tighter turns"
            )
        if not (math.isfinite(self.margin_m) and self.margin_m >= 0):
            raise PlanningError(f"vehicle: margin_m is {self.margin_m}, expected a length in m, 0 or more")

    @property
    def grown(self) -> tuple[float, float, float]:
        """front, rear and half width in m with the margin."""
        return self.front_m + self.margin_m, self.rear_m + self.margin_m, self.half_width_m + self.margin_m

    @property
    def area_m2(self) -> float:
        """The area of the body."""
        return (self.front_m + self.rear_m) * 2.0 * self.half_width_m

    @property
    def body(self) -> tuple[float, float, float]:
        """front, rear and half width in m as they are."""
        return self.front_m, self.rear_m, self.half_width_m
