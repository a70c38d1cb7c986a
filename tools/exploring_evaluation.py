"""`evaluate exploring`: a simulated car without a map drives itself to goals, on the map that it makes on the way.

All of it is simulated, on a simulated clock, by the bytes of lidar and vehicle link; the truth is for the score alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.grid import OccupancyGrid
from planning.vehicle import Vehicle
from tools.autopilot import Autopilot, AutopilotSettings, AutopilotState
from tools.closed_loop import ClosedLoop
from tools.config import Config
from tools.demo_cars import CARS
from tools.drive_bench import find_path
from tools.drive_scores import arrival
from tools.growing_ground import GrowingGround, exploring
from tools.path_search import PathSearchHere, PlanPath
from tools.results import Report
from tools.simulated_car import SimulatedCar
from tools.wall_contact import Room
from tools.world import TOURS, World, load_world

FloatArray = NDArray[np.float64]
Pose = tuple[float, float, float]
_MOST_S = 400.0


@dataclass(frozen=True, slots=True, eq=False)
class ExploringCase:
    """A start and goals (x, y, yaw) in a world; goals are told as seen from the start."""

    name: str
    world: World
    start: Pose
    goals: tuple[Pose, ...]


def usual_cases() -> list[ExploringCase]:
    """Return the two cars of the demo, and a round through rooms of the office, one of them behind a closed corner."""
    x, y = 1.6, 3.6
    rooms = ((14.8, 3.0, -1.57), (7.5, 7.6, 1.57), (2.0, 7.4, 3.0))
    found = [ExploringCase("office", load_world("office"), (x, y, 0.0), rooms)]
    for car in CARS:
        start_x, start_y, start_yaw = car.start.tolist()
        world = load_world(TOURS[car.drive][0])
        found.append(ExploringCase(car.drive, world, (start_x, start_y, start_yaw), car.goals))
    return found


def explore(case: ExploringCase, seed: int, find_path: PlanPath = find_path) -> Report:
    """Drive to all goals and return how it went; find_path: as tools.path_search.PathSearchHere wants it."""
    config, start = Config(), np.array(case.start)
    goals = [se2.between(start, np.array(goal)) for goal in case.goals]
    car = SimulatedCar(case.world, start, config.mount(), seed=seed)
    settings = exploring(AutopilotSettings())

    def grid_now() -> OccupancyGrid:
        return loop.grid_now()

    ground = GrowingGround(grid_now, Vehicle(), settings, goals)
    pilot = Autopilot(ground, Vehicle(), goals, PathSearchHere(find_path), settings=settings)
    loop = ClosedLoop(car, pilot, config, live=True)
    loop.run(_MOST_S)
    stamps_ns, poses, _ = car.world.truth
    end = arrival(poses[-1], np.array(case.goals[-1]))
    room = Room(case.world)
    at_last = pilot.state is AutopilotState.arrived
    return {
        "name": case.name,
        "arrived": at_last and end.is_within(),
        "goals": len(goals),
        "reached": pilot.goal_number + at_last,
        "away_m": round(end.away_m, 4),
        "turned_deg": round(math.degrees(end.turned_rad), 2),
        "driven_m": round(float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum()), 2),
        "driven_s": round(float(stamps_ns[-1] - stamps_ns[0]) * 1e-9, 1),
        "paths": len(pilot.drives),
        "contacts": sum(not room(pose) for pose in poses[::3]),
        "notes": [text for _, text in pilot.notes],
    }


def evaluate_exploring(seed: int, say: Callable[[str], None]) -> Report:
    """Run the usual cases; `passed` tells whether each car arrived and touched nothing."""
    rows = []
    for number, case in enumerate(usual_cases()):
        rows.append(explore(case, 10 * seed + number))
        say(line_of(rows[-1]))
    return {"simulated": True, "rows": rows, "passed": all(row["arrived"] and not row["contacts"] for row in rows)}


def line_of(row: Report) -> str:
    """Return one drive in words."""
    touched = f"{row['contacts']} poses in walls" if row["contacts"] else "no contact"
    return (
        f"{row['name']} (simulated): {row['reached']} of {row['goals']} goals reached, at the end"
        f" {row['away_m'] * 100:.1f} cm and {row['turned_deg']:.1f} deg off, {row['driven_m']:.1f} m in"
        f" {row['driven_s']:.0f} s, {row['paths']} paths, {touched}"
    )
