"""What the closed loop is tried on: the built-in office, a map that the car made of it, and drives from end to end.

The car maps the office once, by the same bytes and flow as `run`, and then drives on that map. All of it is simulated.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from drivers.emulated_link import SimulatedClock
from drivers.rover_dynamics import RoverModel
from mapping import se2
from mapping.grid import OccupancyGrid
from planning.costmap import Costmap, UnknownSpace, costmap
from planning.plan import PlanResult, PlanSettings, plan
from planning.vehicle import Vehicle
from tools.autopilot import Autopilot, AutopilotSettings
from tools.closed_loop import ClosedLoop, EmulatedScans
from tools.config import Config
from tools.drive_scores import TrueDrive
from tools.emulation import Drive as Tour
from tools.emulation import simulated_lidar
from tools.path_search import PathSearchHere
from tools.pipeline import MappingFlow
from tools.simulated_car import START_NS, SimulatedCar
from tools.simulated_drive import OFFICE_ROUND
from tools.simulator import drive_along
from tools.world import load_world

FloatArray = NDArray[np.float64]

WORLD = "office"
_TOLD_M, _TOLD_RAD = 0.05, 0.05  # standard deviation of what the car is told about where it starts
_ROOM_M = 0.05  # around start and goal
_LENGTH_M = (2.0, 8.0)  # as the crow flies


@dataclass(frozen=True, slots=True, eq=False)
class Mapped:
    """The map that the car made of the world, and T_world_map (3,), which only the scorer and the simulator know.

    driven (N, 3): where the car believes it was when it made the map.
    """

    grid: OccupancyGrid
    driven: FloatArray
    T_world_map: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Bench:
    """What all drives share. within_m: how near to where the map was made ends lie."""

    mapped: Mapped
    seed: int
    within_m: float = math.inf
    vehicle: Vehicle = field(default_factory=Vehicle)
    settings: AutopilotSettings = field(default_factory=AutopilotSettings)
    model: RoverModel = field(default_factory=RoverModel)

    def case(self, number: int) -> Case:
        """Return the number-th pair of ends, where the car fits on the map with some room, and a path leads."""
        random = np.random.default_rng([self.seed, number])
        known = costmap(self.mapped.grid, replace(self.vehicle, margin_m=_ROOM_M), UnknownSpace.forbidden)
        while True:
            start, goal = (self._anywhere(known, random) for _ in range(2))
            away_m = float(np.hypot(*(goal - start)[:2]))
            if not _LENGTH_M[0] < away_m < _LENGTH_M[1]:
                continue
            if find_path(known, start, goal).path is not None:
                told = np.array([*random.normal(0.0, _TOLD_M, 2), random.normal(0.0, _TOLD_RAD)])
                return Case(self, number, start, goal, se2.compose(start, told))

    def _anywhere(self, known: Costmap, random: np.random.Generator) -> FloatArray:
        width_m, height_m = known.size_m
        while True:
            local = random.uniform([0.0, 0.0, -math.pi], [width_m, height_m, math.pi])
            pose = known.world(local)
            driven_m = np.hypot(*(self.mapped.driven[:, :2] - pose[:2]).T).min()
            if driven_m <= self.within_m and known.fits(pose):
                return pose


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """One drive: start and goal (3,) on the map, and where the car is told that it starts."""

    bench: Bench
    number: int
    start: FloatArray
    goal: FloatArray
    told: FloatArray

    def loop(self, disturb: Callable[[float], None] = lambda _: None) -> tuple[ClosedLoop, Autopilot, SimulatedCar]:
        """Return the closed loop before its start."""
        bench, config = self.bench, Config()
        pose = se2.compose(bench.mapped.T_world_map, self.start)
        seed = bench.seed * 10_000 + self.number
        car = SimulatedCar(load_world(WORLD), pose, config.mount(), seed=seed, model=bench.model)
        sensor, search = config.mount().pose[:2], PathSearchHere(find_path)
        grid, goals = bench.mapped.grid, [self.goal]
        pilot = Autopilot(grid, bench.vehicle, goals, search, sensor, bench.settings, self.told)
        return ClosedLoop(car, pilot, config, disturb=disturb), pilot, car

    def truth(self, car: SimulatedCar) -> TrueDrive:
        """Return what really happened."""
        stamps_ns, poses, speeds = car.world.truth
        in_map = se2.compose(se2.inverse(self.bench.mapped.T_world_map), poses)
        return TrueDrive(np.asarray(stamps_ns * 1e-9, dtype=np.float64), in_map, poses, speeds)


def find_path(known: Costmap, start: FloatArray, goal: FloatArray) -> PlanResult:
    """Plan, the same way each time."""
    return plan(known, start, goal, PlanSettings(), seed=0, clock=time.monotonic)


def map_world(seed: int) -> Mapped:
    """Map the world by a tour of the emulated car, as `run` does."""
    tour, clock, config = Tour(drive_along(OFFICE_ROUND), "round"), SimulatedClock(START_NS), Config()
    ranger = simulated_lidar(WORLD, tour, noise=True, seed=seed)
    scans, flow = EmulatedScans(ranger, clock), MappingFlow(config, config.mount())
    while ranger.start_ns is None or clock() < ranger.start_ns + tour.duration_s * 1e9:
        for scan in scans.read():
            flow.feed(scan)
        clock.sleep(0.02)
    flow.finish()
    flow.refine()
    estimate = flow.mapper.trajectory
    first_ns = max(int(estimate.stamps_ns[0]) - (ranger.start_ns or 0), 0)
    true_start = tour.truth.at(np.array([first_ns]))[0]
    return Mapped(flow.maps()["map"], estimate.poses, se2.compose(true_start, se2.inverse(estimate.poses[0])))
