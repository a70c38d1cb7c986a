"""How well a drive in the closed loop went: the only place that looks at the simulator's truth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.rover_dynamics import RoverModel
from mapping import se2
from mapping.grid import OccupancyGrid
from planning.path import Path
from planning.vehicle import Vehicle
from tools.autopilot import Drive
from tools.closed_loop import Tick
from tools.plan_checks import colliding_poses
from tools.world import World

FloatArray = NDArray[np.float64]

ARRIVED_M, ARRIVED_RAD = 0.10, math.radians(15.0)
_WINDOW_M = 0.6  # around where the follower thinks it is: a path may pass a place twice
_STANDING_MPS = 1e-3
_TURN_S = 0.03  # of the vehicle's loop, of the simulator's steps


@dataclass(frozen=True, slots=True, eq=False)
class TrueDrive:
    """What really happened: stamps in s (N,), poses (N, 3) in the map and in the world, speeds in m/s (N,)."""

    stamps_s: FloatArray
    in_map: FloatArray
    in_world: FloatArray
    speeds_mps: FloatArray

    def at(self, stamp_s: float) -> int:
        """Return the number of the first sample from a time on, the last one after the end."""
        return min(int(np.searchsorted(self.stamps_s, stamp_s)), len(self.stamps_s) - 1)


@dataclass(frozen=True, slots=True)
class Arrival:
    """How far from the goal the car really stood at the end."""

    away_m: float
    turned_rad: float

    def is_within(self, away_m: float = ARRIVED_M) -> bool:
        """Whether that is near enough, and the car turned the right way."""
        return self.away_m <= away_m and self.turned_rad <= ARRIVED_RAD


def arrival(end: FloatArray, goal: FloatArray) -> Arrival:
    """Compare where a car stands at the end (3,) with its goal (3,)."""
    off = se2.between(goal, end)
    return Arrival(float(np.hypot(off[0], off[1])), abs(float(off[2])))


def largest_cross_track_m(truth: TrueDrive, ticks: list[Tick], drives: list[Drive]) -> float:
    """Return how far beside its path the rear axle was at most, from setting out to its end or the next one."""
    worst = 0.0
    for tick in ticks:
        if 0 <= tick.path < len(drives) and tick.following:
            pose = truth.in_map[truth.at(tick.now_s)]
            worst = max(worst, _beside_m(drives[tick.path].path, tick.progress_m, pose))
    return worst


def _beside_m(path: Path, progress_m: float, pose: FloatArray) -> float:
    """Return the distance in m of a pose from the path's line of poses around a progress."""
    steps = np.diff(path.poses[:, :2], axis=0)
    marks = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
    first, last = np.searchsorted(marks, [progress_m - _WINDOW_M, progress_m + _WINDOW_M])
    near = path.poses[first : last + 1, :2]
    starts, sides = near[:-1], np.diff(near, axis=0)
    share = ((pose[:2] - starts) * sides).sum(axis=1) / np.maximum((sides**2).sum(axis=1), 1e-12)
    off = starts + np.clip(share, 0.0, 1.0)[:, np.newaxis] * sides - pose[:2]
    return float(np.hypot(off[:, 0], off[:, 1]).min())


def contacts(truth: TrueDrive, world: World, vehicle: Vehicle, since_s: float = 0.0) -> int:
    """Count true poses from a time on at which the body is in a wall of the world."""
    grid = OccupancyGrid(np.where(world.occupied, 5.0, -5.0).astype(np.float32), world.resolution_m, world.origin)
    return colliding_poses(grid, grid.occupied, truth.in_world[truth.at(since_s) :: 3], vehicle.body)


def place_off_m(truth: TrueDrive, places: list[tuple[float, FloatArray]]) -> float:
    """Return how far the place was off at most that the car believed in: stamps in s and poses (3,) in the map."""
    if not places:
        return 0.0
    stamps_s = np.array([stamp_s for stamp_s, _ in places])
    off = np.array([place for _, place in places])[:, :2]
    true = np.column_stack([np.interp(stamps_s, truth.stamps_s, truth.in_map[:, k]) for k in (0, 1)])
    return float(np.hypot(*(off - true).T).max())


@dataclass(frozen=True, slots=True)
class Stop:
    """After an event: s until the zero-speed command left, and until the car stood; inf where it never did.

    speed_mps: the fastest since the command left, which the car must brake from; event_mps: since the event.
    """

    command_s: float
    stood_s: float
    speed_mps: float
    event_mps: float

    def in_time(self, command_s: float, model: RoverModel, turn_s: float = _TURN_S) -> bool:
        """Whether the command left within command_s, and the car stood as soon after it as it can brake.

        turn_s: of the vehicle's loop.
        """
        braking_s = model.latency_s + self.speed_mps / model.acceleration_mps2
        return self.command_s <= command_s and self.stood_s <= self.command_s + braking_s + turn_s

    def by_timeout(self, timeout_s: float, model: RoverModel, turn_s: float = _TURN_S) -> bool:
        """Whether the car stood as soon as it can brake after the vehicle's own timeout."""
        return self.stood_s <= timeout_s + model.latency_s + self.event_mps / model.acceleration_mps2 + turn_s


def stop_after(truth: TrueDrive, sent: list[tuple[float, float]], event_s: float) -> Stop:
    """Measure a stop; sent: time and speed of each setpoint that left. Only standing for good counts."""
    last = max((k for k, (sent_s, speed) in enumerate(sent) if sent_s > event_s and speed != 0.0), default=-1)
    zero = next((sent_s for sent_s, _ in sent[last + 1 :] if sent_s > event_s), np.inf)
    rolling = np.flatnonzero(np.abs(truth.speeds_mps) > _STANDING_MPS)
    stands = int(rolling[-1]) + 1 if len(rolling) else 0
    stood_s = np.inf if stands >= len(truth.stamps_s) else float(truth.stamps_s[stands])
    speeds = np.abs(truth.speeds_mps)
    after_mps, event_mps = (
        float(speeds[truth.at(min(since, truth.stamps_s[-1])) :].max()) for since in (zero, event_s)
    )
    return Stop(float(zero - event_s), max(0.0, stood_s - event_s), after_mps, event_mps)
