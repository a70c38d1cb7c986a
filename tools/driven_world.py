"""A simulated car in a world that changes: what its laser measures follows from where its commands have brought it.

Nothing but the scorer may read the truth that is kept here.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.rover_dynamics import RoverState
from mapping import se2
from mapping.mount import Mount
from tools.world import World

FloatArray = NDArray[np.float64]
Corners = tuple[float, float, float, float]

_STEP_NS = 10_000_000
NOISE = (0.004, 0.003)  # m, and share of the range: an A2's ranges scatter by about 1 cm at 2 m
DROPOUT = 0.01
_RANGE_M = 12.0


class Moving(Protocol):
    """A car that time makes drive; drivers.mavlink_rover.MavlinkRover is one."""

    @property
    def state(self) -> RoverState:
        """The present state."""
        ...

    def pass_time(self, now_ns: int) -> None:
        """Drive up to an instant, if it is not there yet."""
        ...


class DrivenWorld:
    """A car in a world, from start_ns on; a ranger for the emulated lidar, which lets time pass.

    noisy: ranges scatter and are missing, as an A2's.
    """

    def __init__(
        self, world: World, car: Moving, mount: Mount, *, start_ns: int, seed: int, noisy: bool = True
    ) -> None:
        self.world = world
        self.car = car
        self._mount = mount
        self._noise, self._dropout = (NOISE, DROPOUT) if noisy else ((0.0, 0.0), 0.0)
        self._random = np.random.default_rng(seed)
        car.pass_time(start_ns)
        self._stamps_ns = [start_ns]
        self._poses = [car.state.pose]
        self._speeds = [car.state.speed_mps]

    def put_box(self, corners: FloatArray) -> None:
        """Put a box with four corners (4, 2) in the world."""
        import cv2

        occupied = self.world.occupied.astype(np.uint8)
        local = se2.transform_points(se2.inverse(self.world.origin), corners) / self.world.resolution_m
        cv2.fillConvexPoly(occupied, np.floor(local).astype(np.int32), (1,))
        self.world = World(occupied.astype(np.bool_), self.world.resolution_m, self.world.origin)

    def advance(self, until_ns: int) -> None:
        """Let the car drive up to an instant, in whole steps of 10 ms beyond it at most."""
        while self._stamps_ns[-1] < until_ns:
            self._stamps_ns.append(self._stamps_ns[-1] + _STEP_NS)
            self.car.pass_time(self._stamps_ns[-1])
            state = self.car.state
            self._poses.append(state.pose)
            self._speeds.append(state.speed_mps)

    @property
    def truth(self) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
        """Stamps in ns (N,), poses (N, 3) in the world and speeds in m/s (N,) so far: for the scorer alone."""
        return np.array(self._stamps_ns, dtype=np.int64), np.array(self._poses), np.array(self._speeds)

    def __call__(self, times_ns: NDArray[np.int64], theta_cw_rad: FloatArray) -> FloatArray:
        """Return ranges in m (N,), 0 = no return, at times (N,) for clockwise angles (N,) from the sensor's zero."""
        self.advance(int(times_ns.max()))
        first = max(len(self._stamps_ns) - 3 - int((self._stamps_ns[-1] - times_ns.min()) // _STEP_NS), 0)
        stamps, poses = np.array(self._stamps_ns[first:]), np.array(self._poses[first:])
        x, y, yaw = (
            np.interp(times_ns, stamps, column) for column in (poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2]))
        )
        sensor = se2.compose(np.column_stack([x, y, yaw]), self._mount.pose)
        bearings = theta_cw_rad if self._mount.inverted else -theta_cw_rad
        ranges = self.world.ranges(sensor, bearings, _RANGE_M)
        noisy = ranges + self._random.normal(size=len(ranges)) * (self._noise[0] + self._noise[1] * ranges)
        seen = (ranges > 0.0) & (self._random.random(len(ranges)) >= self._dropout)
        measured: FloatArray = np.where(seen, np.maximum(noisy, 0.0), 0.0)
        return measured
