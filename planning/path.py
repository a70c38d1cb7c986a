"""A path as a follower wants it: dense poses, gear and speed at each, and the cusps where the car stops to shift."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from drivers.messages import PlannedPath
from mapping import se2
from planning.errors import PlanningError

FloatArray = NDArray[np.float64]
Gears = NDArray[np.int8]
_STANDING_M = 1e-9  # a shorter step has no direction


@dataclass(frozen=True, slots=True)
class SpeedLimits:
    """How fast a path is driven: m/s at most, m/s^2 sideways and along the path, m/s where the car sets off or shifts.

    Raises PlanningError for values that are not finite and positive, and for a creep faster than the top.
    """

    top_mps: float = 0.5
    lateral_mps2: float = 0.5
    acceleration_mps2: float = 0.3
    creep_mps: float = 0.05  # never 0, so that the car arrives at all

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value > 0.0):
                raise PlanningError(f"speed: {field.name} is {value}, expected a finite number above 0")
        if self.creep_mps > self.top_mps:
            raise PlanningError(f"speed: creep_mps {self.creep_mps} is above top_mps {self.top_mps}: lower it")


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """poses (N, 3) of base_link in the map frame; direction (N,) 1 forward or -1; speed_mps (N,), 0 at the end.

    direction and speed are those of the motion that leaves the pose, at the last one of the motion that reaches it.
    """

    poses: FloatArray
    direction: Gears
    speed_mps: FloatArray

    @property
    def length_m(self) -> float:
        """Distance driven by base_link, forwards and backwards."""
        return float(_step_lengths_m(self.poses).sum())

    @property
    def cusps(self) -> NDArray[np.intp]:
        """Numbers (K,) of the poses at which the car stops and changes gear."""
        return np.flatnonzero(np.diff(self.direction)) + 1

    def at_speed(self, limits: SpeedLimits) -> Path:
        """Return the same way in the same gears under other limits."""
        return path_along(self.poses, self.direction, limits)

    def to_message(self, stamp_ns: int, frame_id: str = "map") -> PlannedPath:
        """Return the poses as they are recorded; nav_msgs/Path has no room for gear and speed."""
        return PlannedPath(stamp_ns, self.poses, frame_id)


def path_along(poses: FloatArray, gears: Gears | None = None, limits: SpeedLimits = SpeedLimits()) -> Path:
    """Give dense poses (N, 3), N >= 1, their gear and speed.

    gears (N,): those of the motion that leaves each pose, as the planner knows them, the last one of no account; None:
    as the poses follow each other. Raises ValueError where there are not as many gears as poses.
    """
    if gears is not None and gears.shape != (len(poses),):
        raise ValueError(f"gears has shape {gears.shape}, expected ({len(poses)},)")
    if len(poses) < 2:
        return Path(poses, np.ones(len(poses), np.int8), np.zeros(len(poses)))
    lengths_m = _step_lengths_m(poses)
    gear = _gears_between(poses, lengths_m) if gears is None else np.where(gears[:-1] < 0, -1, 1).astype(np.int8)
    turns_rad = np.abs(se2.wrap_angle(np.diff(poses[:, 2])))
    curvature = turns_rad / np.maximum(lengths_m, 1e-6)
    limit = np.minimum(limits.top_mps, np.sqrt(limits.lateral_mps2 / np.maximum(curvature, 1e-6)))
    limit[np.flatnonzero(np.diff(gear)) + 1] = limits.creep_mps
    limit[0] = limits.creep_mps
    speed_mps = _with_acceleration(np.append(limit, 0.0), lengths_m, limits.acceleration_mps2)
    return Path(poses, np.append(gear, gear[-1]), speed_mps)


def _step_lengths_m(poses: FloatArray) -> FloatArray:
    return np.asarray(np.hypot(*np.diff(poses[:, :2], axis=0).T))


def _gears_between(poses: FloatArray, lengths_m: FloatArray) -> Gears:
    """Return the gear (N - 1,) of each step between poses (N, 3); a step without length has that of the one before."""
    steps = np.diff(poses, axis=0)
    middle = poses[:-1, 2] + se2.wrap_angle(steps[:, 2]) / 2.0
    gear = np.where(steps[:, 0] * np.cos(middle) + steps[:, 1] * np.sin(middle) < 0.0, -1, 1).astype(np.int8)
    moving = lengths_m > _STANDING_M
    if not moving.any():
        return gear
    latest = np.maximum.accumulate(np.where(moving, np.arange(len(gear)), np.argmax(moving)))
    return gear[latest]


def _with_acceleration(limit: FloatArray, lengths_m: FloatArray, acceleration_mps2: float) -> FloatArray:
    """Lower limits (N,) so that speeding up and braking over steps (N - 1,) stay gentle.

    v^2 may grow by 2 a with each metre, so at each pose it is the least that any pose before or after it allows.
    """
    squares = limit**2
    rise = 2.0 * acceleration_mps2 * np.concatenate([[0.0], np.cumsum(lengths_m)])
    speeding_up = rise + np.minimum.accumulate(squares - rise)
    braking = np.minimum.accumulate((squares + rise)[::-1])[::-1] - rise
    return np.asarray(np.sqrt(np.clip(np.minimum(speeding_up, braking), 0.0, squares)))
