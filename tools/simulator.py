"""A simulated car: where it drives, and what its laser measures on the way.

What is modelled: car-like motion, the sweep during a turn, range noise, missing returns. What is not: intensity, glass,
people, several returns, vibration.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.mount import Mount
from mapping.trajectory import Trajectory
from tools.world import World

FloatArray = NDArray[np.float64]

WHEELBASE_M = 0.256  # QCar
MAX_STEERING_RAD = math.radians(30.0)  # QCar: turns on 0.443 m
_STEP_S = 0.01
_STEPS_PER_POSE = 5  # 20 poses a second; whoever needs more interpolates, the simulator too
_LOOKAHEAD_M = 0.45
_ACCELERATION_MPS2 = 0.4


def drive_along(waypoints: Sequence[tuple[float, float]], speed_mps: float = 0.6) -> Trajectory:
    """Return the drive of a car (bicycle model, pure pursuit) along the waypoints, x and y in m; stamps start at 0.

    It starts on the first waypoint, heads for the second, speeds up and slows down smoothly, and ends near the last.
    Source of the steering law: Coulter, "Implementation of the pure pursuit path tracking algorithm" (CMU 1992).
    """
    points = np.asarray(waypoints, dtype=np.float64)
    pieces = np.diff(points, axis=0)
    lengths = np.hypot(*pieces.T)
    marks = np.concatenate([[0.0], np.cumsum(lengths)])
    line_m = np.arange(0.0, marks[-1], 0.01)
    line = np.column_stack([np.interp(line_m, marks, points[:, axis]) for axis in (0, 1)])
    x, y = line[0]
    yaw = math.atan2(pieces[0, 1], pieces[0, 0])
    poses, speed, nearest = [(x, y, yaw)], 0.0, 0
    while True:
        window = line[nearest : nearest + 100]
        nearest += int(np.argmin(np.hypot(window[:, 0] - x, window[:, 1] - y)))
        left_m = marks[-1] - line_m[nearest]
        if left_m < 0.05:
            break
        target = line[min(nearest + round(_LOOKAHEAD_M / 0.01), len(line) - 1)]
        dx, dy = target[0] - x, target[1] - y
        sideways = -math.sin(yaw) * dx + math.cos(yaw) * dy
        steering = math.atan(2.0 * WHEELBASE_M * sideways / max(dx * dx + dy * dy, 1e-6))
        steering = min(max(steering, -MAX_STEERING_RAD), MAX_STEERING_RAD)
        braking = math.sqrt(2.0 * _ACCELERATION_MPS2 * left_m)
        speed = min(speed + _ACCELERATION_MPS2 * _STEP_S, speed_mps, max(braking, 0.05))
        x += speed * math.cos(yaw) * _STEP_S
        y += speed * math.sin(yaw) * _STEP_S
        yaw += speed * math.tan(steering) / WHEELBASE_M * _STEP_S
        poses.append((x, y, yaw))
    stamps_ns = np.arange(len(poses), dtype=np.int64) * round(_STEP_S * 1e9)
    kept = slice(None, None, _STEPS_PER_POSE)
    return Trajectory(stamps_ns[kept], np.array(poses)[kept])


class SimulatedLidar:
    """Ranges that a laser on a moving car measures in a world; the car starts to move start_delay_s after the first.

    truth: the car's drive, its first stamp being the start. noise: standard deviation as offset in m and as a share of
    the range. dropout: share of samples without a return. Repeatable for the same seed and the same calls.
    """

    def __init__(
        self,
        world: World,
        truth: Trajectory,
        mount: Mount,
        *,
        start_delay_s: float = 1.0,
        noise: tuple[float, float] = (0.004, 0.003),
        dropout: float = 0.01,
        max_range_m: float = 12.0,
        seed: int = 0,
    ) -> None:
        self._world = world
        self._truth = truth
        self._mount = mount
        self._start_delay_ns = round(start_delay_s * 1e9)
        self._noise = noise
        self._dropout = dropout
        self._max_range_m = max_range_m
        self._random = np.random.default_rng(seed)
        self._start_ns: int | None = None

    @property
    def start_ns(self) -> int | None:
        """Instant at which the car starts, on the clock of the calls; None before the first."""
        return self._start_ns

    def __call__(self, times_ns: NDArray[np.int64], theta_cw_rad: FloatArray) -> FloatArray:
        """Return ranges in m (N,), 0 = no return, at times (N,) for clockwise angles (N,) from the sensor's zero."""
        if self._start_ns is None:
            self._start_ns = int(times_ns[0]) + self._start_delay_ns
        since_start = times_ns - self._start_ns + self._truth.stamps_ns[0]
        sensor = se2.compose(_around(self._truth, since_start).at(since_start), self._mount.pose)
        bearings = theta_cw_rad if self._mount.inverted else -theta_cw_rad
        ranges = self._world.ranges(sensor, bearings, self._max_range_m)
        offset, share = self._noise
        noisy = ranges + self._random.normal(size=len(ranges)) * (offset + share * ranges)
        seen = (ranges > 0.0) & (self._random.random(len(ranges)) >= self._dropout)
        measured: FloatArray = np.where(seen, np.maximum(noisy, 0.0), 0.0)
        return measured


def _around(drive: Trajectory, times_ns: NDArray[np.int64]) -> Trajectory:
    """Return the part of a drive that decides where the car is at the times, so that long drives cost no more."""
    first = max(int(np.searchsorted(drive.stamps_ns, times_ns.min())) - 1, 0)
    last = int(np.searchsorted(drive.stamps_ns, times_ns.max(), side="right")) + 1
    first = min(first, len(drive) - 1)
    return Trajectory(drive.stamps_ns[first:last], drive.poses[first:last])
