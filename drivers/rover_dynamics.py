"""How a small car moves: bicycle kinematics at the rear axle with limits of its steering, its drive and its link.

Pure functions of the time that is let pass: no clock, and chance by seed alone. A real car slips, its steering has play
and its speed control is not exact; this one has none of it but what odometry noise and latency make.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drivers.messages import FloatArray, Odometry
from drivers.vehicle import STANDSTILL, DriveCommand

_SUBSTEP_S = 0.005
_FREE_M = 0.02  # a car that has come so far from where it was stopped, and is stopped again, has had another contact


@dataclass(frozen=True, slots=True)
class RoverModel:
    """Sizes and limits; defaults: a QCar, wheel base and steering limit as in Quanser's configuration files.

    acceleration_mps2: of speeding up and of braking. latency_s: from a command to the first motion it causes.
    """

    wheelbase_m: float = 0.256
    steering_limit_rad: float = math.radians(30.0)
    steering_rate_radps: float = 3.0
    acceleration_mps2: float = 1.5
    speed_limit_mps: float = 1.0
    latency_s: float = 0.1

    def steering_rad(self, curvature_1pm: float) -> float:
        """Return the angle of the front wheels for a curvature of the rear axle's way, within the limit."""
        return _clamped(math.atan(self.wheelbase_m * curvature_1pm), self.steering_limit_rad)

    def curvature_1pm(self, steering_rad: float) -> float:
        """Return the curvature of the rear axle's way at an angle of the front wheels."""
        return math.tan(steering_rad) / self.wheelbase_m


@dataclass(frozen=True, slots=True, eq=False)
class RoverState:
    """Where the car is and how it moves: pose (3,) of base_link in the world, speed of the rear axle, front wheels."""

    pose: FloatArray
    speed_mps: float
    steering_rad: float
    yaw_rate_radps: float


class RoverDynamics:
    """A car at `pose` (3,); step() lets time pass and returns the state after it.

    fits: whether the car can be at a pose (3,); where it cannot it does not go: it stands, at once. contacts: how often
    that has stopped it; it counts once however long the car goes on pushing.
    """

    def __init__(
        self,
        pose: FloatArray,
        model: RoverModel | None = None,
        *,
        fits: Callable[[FloatArray], bool] = lambda _pose: True,
    ) -> None:
        self.model = model or RoverModel()
        self.contacts = 0
        self._fits = fits
        self._since_contact_m = math.inf
        self._x_m, self._y_m, self._yaw_rad = (float(value) for value in pose)
        self._speed_mps = 0.0
        self._steering_rad = 0.0
        self._command = STANDSTILL
        self._time_s = 0.0
        self._coming: deque[tuple[float, DriveCommand]] = deque()

    @property
    def state(self) -> RoverState:
        """The present state."""
        pose = np.array([self._x_m, self._y_m, self._yaw_rad])
        yaw_rate = self._speed_mps * self.model.curvature_1pm(self._steering_rad)
        return RoverState(pose, self._speed_mps, self._steering_rad, yaw_rate)

    def step(self, dt_s: float, command: DriveCommand) -> RoverState:
        """Give a command now, let dt_s pass, return the state; the command takes hold after the model's latency."""
        if self._coming[-1][1] != command if self._coming else self._command != command:
            self._coming.append((self._time_s + self.model.latency_s, command))
        steps = max(1, math.ceil(dt_s / _SUBSTEP_S - 1e-9))
        for _ in range(steps):
            self._move(dt_s / steps)
        return self.state

    def _move(self, dt_s: float) -> None:
        while self._coming and self._coming[0][0] <= self._time_s + 1e-9:
            self._command = self._coming.popleft()[1]
        model = self.model
        wanted_mps = _clamped(self._command.speed_mps, model.speed_limit_mps)
        wanted_rad = model.steering_rad(self._command.curvature_1pm)
        speed = self._speed_mps + _clamped(wanted_mps - self._speed_mps, model.acceleration_mps2 * dt_s)
        steering = self._steering_rad + _clamped(wanted_rad - self._steering_rad, model.steering_rate_radps * dt_s)
        way_m = (self._speed_mps + speed) / 2.0 * dt_s
        turn_rad = way_m * model.curvature_1pm((self._steering_rad + steering) / 2.0)
        chord_m = way_m * np.sinc(turn_rad / (2.0 * math.pi))  # np.sinc(x) is sin(pi x) / (pi x)
        heading = self._yaw_rad + turn_rad / 2.0
        x = self._x_m + float(chord_m) * math.cos(heading)
        y = self._y_m + float(chord_m) * math.sin(heading)
        yaw = (self._yaw_rad + turn_rad + math.pi) % (2.0 * math.pi) - math.pi
        self._steering_rad = steering
        self._time_s += dt_s
        if way_m and not self._fits(np.array([x, y, yaw])):
            self.contacts += self._since_contact_m > _FREE_M
            self._since_contact_m = self._speed_mps = 0.0
            return
        self._since_contact_m += abs(way_m)
        self._x_m, self._y_m, self._yaw_rad, self._speed_mps = x, y, yaw, speed


class NoisyOdometry:
    """What wheel encoders and steering make of a drive: their own pose, which drifts away from the true one.

    way_noise_m: standard deviation of the way after one metre; turn_noise_rad: of the heading after one metre without a
    turn, and after one radian at the spot; both grow with the root of way and turn. way_scale: wheels that are larger
    than thought. way_m: the measured way so far, back and forth. The same seed and drive give the same odometry.
    """

    def __init__(
        self, *, seed: int, way_noise_m: float = 0.01, turn_noise_rad: float = 0.01, way_scale: float = 1.0
    ) -> None:
        self._random = np.random.default_rng(seed)
        self._way_noise_m, self._turn_noise_rad, self._way_scale = way_noise_m, turn_noise_rad, way_scale
        self._pose = (0.0, 0.0, 0.0)
        self.way_m = 0.0
        self._last: FloatArray | None = None

    def measure(self, stamp_ns: int, state: RoverState) -> Odometry:
        """Return the odometry at a state; call it often enough that the car goes nearly straight between two calls."""
        last = state.pose if self._last is None else self._last
        self._last = state.pose
        turn = (float(state.pose[2] - last[2]) + math.pi) % (2.0 * math.pi) - math.pi
        dx, dy = state.pose[:2] - last[:2]
        middle = last[2] + turn / 2.0
        way = float(dx * math.cos(middle) + dy * math.sin(middle))
        way_error, turn_error = self._random.standard_normal(2)
        measured_way = self._way_scale * way + self._way_noise_m * math.sqrt(abs(way)) * way_error
        measured_turn = turn + self._turn_noise_rad * math.sqrt(abs(turn) + abs(way)) * turn_error
        self.way_m += measured_way
        x, y, yaw = self._pose
        heading = yaw + measured_turn / 2.0
        self._pose = (
            x + measured_way * math.cos(heading),
            y + measured_way * math.sin(heading),
            (yaw + measured_turn + math.pi) % (2.0 * math.pi) - math.pi,
        )
        twist = np.array([self._way_scale * state.speed_mps, 0.0, state.yaw_rate_radps])
        return Odometry(stamp_ns, np.array(self._pose), twist)


def _clamped(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
