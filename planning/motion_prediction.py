"""Where the car is by now: poses come late and commands take hold late, so both ends are bridged by the car's motion.

A scan's pose is that of the middle of a turn, up to 0.2 s ago when it is used; a command moves the car a while after it
was given. What the car did and will do in between follows from the commands, by the limits of its steering and drive.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from drivers.vehicle import STANDSTILL, DriveCommand
from mapping import se2
from planning.errors import PlanningError

FloatArray = NDArray[np.float64]
_STEP_S = 0.01


@dataclass(frozen=True, slots=True)
class MotionModel:
    """What a car makes of a command: latency_s from the command to its first effect, then rates that are limited.

    wheelbase_m and steering_rate_radps give how fast the curvature follows. memory_s: how old a pose may be.
    """

    latency_s: float = 0.1
    acceleration_mps2: float = 1.5
    steering_rate_radps: float = 3.0
    wheelbase_m: float = 0.256
    memory_s: float = 2.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            least_ok = value >= 0.0 if field.name == "latency_s" else value > 0.0
            if not (math.isfinite(value) and least_ok):
                raise PlanningError(f"motion: {field.name} is {value}, expected a finite number above 0")


class MotionPrediction:
    """Keeps what the car was told, and what it must have done since; begins standing, with the wheels straight.

    Times are in s on one clock; commands come in the order of time.
    """

    def __init__(self, model: MotionModel = MotionModel()) -> None:
        self._model = model
        self._coming: deque[tuple[float, DriveCommand]] = deque()  # when each takes hold
        self._goal = STANDSTILL
        self._speed_mps = self._steering_rad = 0.0
        self._time_s: float | None = None
        self._twists: deque[tuple[float, float, float]] = deque()  # end of a step, speed, curvature during it

    def tell(self, now_s: float, command: DriveCommand) -> None:
        """Take in a command that is given now."""
        if self._time_s is None:
            self._time_s = now_s
        if (self._coming[-1][1] if self._coming else self._goal) != command:
            self._coming.append((now_s + self._model.latency_s, command))

    def speed_mps(self, at_s: float) -> float:
        """Return the speed at a time, at most latency_s after the last command."""
        self._advance(at_s)
        speed = 0.0
        for end_s, mps, _ in reversed(self._twists):
            if end_s < at_s - _STEP_S:
                break
            speed = mps
            if end_s <= at_s + 1e-9:
                break
        return speed

    def pose_at(self, pose: FloatArray, stamp_s: float, at_s: float) -> FloatArray:
        """Return the pose (3,) at a time, at most latency_s after the last command, of a car seen at stamp_s."""
        self._advance(at_s)
        x, y, yaw = pose.tolist()
        for end_s, speed_mps, curvature_1pm in self._twists:
            seconds = min(end_s, at_s) - max(end_s - _STEP_S, stamp_s)
            if seconds <= 0.0:
                continue
            way_m = speed_mps * seconds
            turn_rad = way_m * curvature_1pm
            x += way_m * math.cos(yaw + turn_rad / 2.0)
            y += way_m * math.sin(yaw + turn_rad / 2.0)
            yaw += turn_rad
        return np.array([x, y, float(se2.wrap_angle(yaw))])

    def _advance(self, until_s: float) -> None:
        """Let the car move up to a time, in steps of equal length."""
        if self._time_s is None:
            return
        model = self._model
        while self._time_s + _STEP_S / 2.0 < until_s:
            while self._coming and self._coming[0][0] <= self._time_s + 1e-9:
                self._goal = self._coming.popleft()[1]
            before_mps, before_rad = self._speed_mps, self._steering_rad
            wanted_rad = math.atan(model.wheelbase_m * self._goal.curvature_1pm)
            self._speed_mps += _clamped(self._goal.speed_mps - before_mps, model.acceleration_mps2 * _STEP_S)
            self._steering_rad += _clamped(wanted_rad - before_rad, model.steering_rate_radps * _STEP_S)
            self._time_s += _STEP_S
            curvature_1pm = math.tan((before_rad + self._steering_rad) / 2.0) / model.wheelbase_m
            self._twists.append((self._time_s, (before_mps + self._speed_mps) / 2.0, curvature_1pm))
        while self._twists and self._twists[0][0] < self._time_s - model.memory_s:
            self._twists.popleft()


def _clamped(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
