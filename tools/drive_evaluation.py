"""`evaluate drives`: the closed loop in the built-in office, many times: arrivals, stops, and a box on the path.

The car maps the office once, by the same bytes and flow, and then drives on that map. All of it is simulated.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from drivers.emulated_link import SimulatedClock
from drivers.rover_dynamics import RoverModel
from mapping import se2
from mapping.grid import OccupancyGrid
from planning.costmap import Costmap, UnknownSpace, costmap
from planning.plan import PlanResult, PlanSettings, plan
from planning.vehicle import Vehicle
from tools.autopilot import Autopilot, AutopilotSettings, AutopilotState
from tools.closed_loop import START_NS, ClosedLoop, EmulatedScans
from tools.config import Config
from tools.drive_scores import Stop, TrueDrive, arrival, contacts, largest_cross_track_m, stop_after
from tools.driven_world import CommandedCar, DrivenWorld
from tools.emulation import Drive as Tour
from tools.emulation import simulated_lidar
from tools.pipeline import MappingFlow
from tools.results import Report
from tools.simulated_drive import OFFICE_ROUND
from tools.simulator import drive_along
from tools.world import load_world

FloatArray = NDArray[np.float64]
Say = Callable[[str], None]

WORLD = "office"
ARRIVED_M, ARRIVED_RAD = 0.10, math.radians(15.0)
CROSS_TRACK_M = 0.06
STOP_S = 0.6
_TOLD_M, _TOLD_RAD = 0.05, 0.05  # standard deviation of what the car is told about where it starts
_ROOM_M = 0.05  # around start and goal
# Ends lie so near to where the map was made. Of a room that was only looked into through its door, the map has the
# outer faces of its walls alone. Localisation takes the inner ones for them: it is off by their thickness, 0.12 m.
_FAMILIAR_M = 0.8
_LENGTH_M = (2.0, 8.0)  # as the crow flies
_MOST_S = 150.0
_STOP_AFTER_S = (6.0, 10.0)  # from the start: 3 s of finding itself and planning, then driving
_STOP_MOST_S = 60.0
_FAST_MPS = 0.2  # so fast it is when it is stopped
_BOX_AHEAD_M = (1.3, 2.2)
_BOX_M = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Mapped:
    """The map that the car made of the world, and T_world_map (3,), which only the scorer and the simulator know.

    driven (N, 3): where the car believes it was when it made the map.
    """

    grid: OccupancyGrid
    driven: FloatArray
    T_world_map: FloatArray


class StopCause(str, Enum):
    """What stops the car on the way."""

    stale_pose = "stale pose"
    stale_scan = "stale scan"
    emergency = "e-stop"


@dataclass(slots=True, eq=False)
class Bench:
    """What all drives share; say is told of each."""

    mapped: Mapped
    seed: int
    say: Say
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
            if driven_m <= _FAMILIAR_M and known.fits(pose):
                return pose


@dataclass(slots=True, eq=False)
class Case:
    """One drive: start and goal (3,) on the map, and where the car is told that it starts."""

    bench: Bench
    number: int
    start: FloatArray
    goal: FloatArray
    told: FloatArray

    def loop(self, disturb: Callable[[float], None] = lambda _: None) -> tuple[ClosedLoop, Autopilot, DrivenWorld]:
        """Return the closed loop before its start."""
        bench, config = self.bench, Config()
        pose = se2.compose(bench.mapped.T_world_map, self.start)
        seed = bench.seed * 10_000 + self.number
        car = CommandedCar(pose, start_ns=START_NS, model=bench.model)
        world = DrivenWorld(load_world(WORLD), car, config.mount(), start_ns=START_NS, seed=seed)
        sensor = config.mount().pose[:2]
        pilot = Autopilot(bench.mapped.grid, bench.vehicle, self.told, self.goal, find_path, sensor, bench.settings)
        return ClosedLoop(car, world, pilot, config, disturb=disturb), pilot, world

    def truth(self, world: DrivenWorld) -> TrueDrive:
        """Return what really happened."""
        stamps_ns, poses, speeds = world.truth
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


def evaluate_arrivals(bench: Bench, count: int) -> Report:
    """Drive from start to goal so many times."""
    rows = []
    for number in range(count):
        case = bench.case(number)
        loop, pilot, world = case.loop()
        loop.run(_MOST_S)
        truth = case.truth(world)
        end = arrival(truth, case.goal)
        row: Report = {
            "arrived": pilot.state is AutopilotState.arrived
            and end.away_m <= ARRIVED_M
            and end.turned_rad <= ARRIVED_RAD,
            "state": pilot.state.value,
            "goal_m": round(end.away_m, 4),
            "goal_deg": round(math.degrees(end.turned_rad), 2),
            "cross_track_m": round(largest_cross_track_m(truth, loop.log.ticks, pilot.drives), 4),
            "contacts": contacts(truth, world.world, bench.vehicle),
            "paths": len(pilot.drives),
            "length_m": round(sum(drive.path.length_m for drive in pilot.drives[:1]), 2),
            "top_mps": round(float(np.abs(truth.speeds_mps).max()), 3),
            "seconds": round(float(truth.stamps_s[-1] - truth.stamps_s[0]), 1),
            "notes": [text for _, text in pilot.notes],
        }
        rows.append(row)
        bench.say(
            f"drive {number}: {row['state']}, {row['goal_m'] * 100:.1f} cm and {row['goal_deg']:.1f} deg off, at most"
            f" {row['cross_track_m'] * 100:.1f} cm beside the path, {row['paths']} paths, {row['contacts']} contacts"
        )
    return {"drives": count, "rows": rows}


def evaluate_stops(bench: Bench, cause: StopCause, count: int) -> Report:
    """Stop so many drives on the way, at an instant by chance."""
    rows = []
    for number in range(count):
        case = bench.case(1000 + number)
        row = _stopped_drive(case, cause)
        rows.append(row)
        bench.say(
            f"{cause.value} {number}: zero speed after {row['command_s']:.2f} s, stood after {row['stood_s']:.2f} s"
        )
    return {"drives": count, "in_time": sum(row["in_time"] for row in rows), "rows": rows}


def _stopped_drive(case: Case, cause: StopCause) -> Report:
    bench = case.bench
    random = np.random.default_rng([bench.seed, case.number, 7])
    at_s = START_NS * 1e-9 + random.uniform(*_STOP_AFTER_S)
    events: list[float] = []

    def disturb(now_s: float) -> None:
        if events or now_s < at_s or abs(loop.log.ticks[-1].safe.command.speed_mps) < _FAST_MPS:
            return
        events.append(now_s)
        if cause is StopCause.emergency:
            pilot.safety.emergency_stop("pressed")
        elif cause is StopCause.stale_pose:
            loop.deaf_to_poses = True
        else:
            loop.unplug_lidar()

    loop, pilot, world = case.loop(disturb)
    loop.run(_STOP_MOST_S, until=lambda now_s: bool(events) and now_s > events[0] + 2.0)
    truth = case.truth(world)
    last_s = {
        StopCause.stale_pose: loop.log.last_pose_s,
        StopCause.stale_scan: loop.log.last_scan_s,
        StopCause.emergency: events[0],
    }[cause]
    stop = stop_after(truth, loop.log.ticks, events[0] if last_s is None else last_s)
    return {
        "command_s": round(stop.command_s, 3),
        "stood_s": round(stop.stood_s, 3),
        "speed_mps": round(stop.speed_mps, 3),
        "in_time": _is_in_time(stop, bench),
        "reason": loop.log.ticks[-1].safe.reason,
        "contacts": contacts(truth, world.world, bench.vehicle),
    }


def _is_in_time(stop: Stop, bench: Bench) -> bool:
    return stop.in_time(STOP_S, bench.model.acceleration_mps2, bench.model.latency_s)


def evaluate_boxes(bench: Bench, count: int) -> Report:
    """Put a box on the path in front of the moving car, so many times."""
    rows: list[Report] = []
    number = 2000
    while len(rows) < count:
        row = _boxed_drive(bench.case(number))
        number += 1
        if row is None:
            continue  # the path is too short for a box, or the car was never on its way
        rows.append(row)
        bench.say(
            f"box {len(rows) - 1}: {row['state']}, {row['paths']} paths, {row['contacts']} contacts, {row['notes'][:3]}"
        )
    return {"drives": count, "good": sum(row["good"] for row in rows), "rows": rows}


def _boxed_drive(case: Case) -> Report | None:
    bench = case.bench
    random = np.random.default_rng([bench.seed, case.number, 8])
    ahead_m, turn = random.uniform(*_BOX_AHEAD_M), random.uniform(-math.pi, math.pi)
    after_m = random.uniform(0.5, 1.0)
    put_s: list[float] = []

    def disturb(now_s: float) -> None:
        step, drives = pilot.step, pilot.drives
        if put_s or step is None or step.progress_m < after_m or len(drives) != 1:
            return
        path = drives[0].path
        marks = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path.poses[:, :2], axis=0).T))])
        at = int(np.searchsorted(marks, step.progress_m + ahead_m))
        away_m = float(np.hypot(*(path.poses[min(at, len(marks) - 1)] - case.goal)[:2]))
        start_m = float(np.hypot(*(path.poses[min(at, len(marks) - 1)] - pilot_pose())[:2]))
        if at >= len(marks) or away_m < 1.0 or start_m < 1.0:
            return
        half = _BOX_M / 2.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        place = se2.compose(bench.mapped.T_world_map, np.array([*path.poses[at, :2], turn]))
        world.put_box(se2.transform_points(place, half))
        put_s.append(now_s)

    def pilot_pose() -> FloatArray:
        assert pilot.place is not None
        return pilot.place.T_map_base

    loop, pilot, world = case.loop(disturb)
    loop.run(_MOST_S)
    if not put_s:
        return None
    truth = case.truth(world)
    end = arrival(truth, case.goal)
    arrived = pilot.state is AutopilotState.arrived and end.away_m <= ARRIVED_M and end.turned_rad <= ARRIVED_RAD
    hits = contacts(truth, world.world, bench.vehicle, put_s[0])
    told = pilot.state is AutopilotState.no_way
    return {
        "good": (arrived or told) and hits == 0,
        "arrived": arrived,
        "no_way_reported": told,
        "state": pilot.state.value,
        "goal_m": round(end.away_m, 4),
        "cross_track_m": round(largest_cross_track_m(truth, loop.log.ticks, pilot.drives), 4),
        "contacts": hits,
        "paths": len(pilot.drives),
        "notes": [text for _, text in pilot.notes],
    }


def evaluate_drives(count: int, stops: int, boxes: int, seed: int, say: Say) -> Report:
    """Run all parts; `passed` tells whether each is as it must be."""
    bench = Bench(map_world(seed), seed, say)
    arrivals = evaluate_arrivals(bench, count)
    halts = {cause.value: evaluate_stops(bench, cause, stops) for cause in StopCause}
    box = evaluate_boxes(bench, boxes)
    rows = arrivals["rows"]
    report: Report = {
        "simulated": True,
        "drives": count,
        "arrived": sum(row["arrived"] for row in rows),
        "goal_m_max": max((row["goal_m"] for row in rows), default=None),
        "goal_deg_max": max((row["goal_deg"] for row in rows), default=None),
        "cross_track_m_p95": _percentile([row["cross_track_m"] for row in rows], 95.0),
        "cross_track_m_median": _percentile([row["cross_track_m"] for row in rows], 50.0),
        "contacts": sum(row["contacts"] > 0 for part in (arrivals, *halts.values(), box) for row in part["rows"]),
        "stops": halts,
        "boxes": box,
        "arrivals": arrivals,
    }
    off_m = report["cross_track_m_p95"]
    report["passed"] = bool(
        report["arrived"] == count
        and (off_m is None or off_m <= CROSS_TRACK_M)
        and report["contacts"] == 0
        and all(part["in_time"] == part["drives"] for part in halts.values())
        and box["good"] == box["drives"]
    )
    return report


def table_of(report: Report) -> list[str]:
    """Return the report as lines of text."""
    lines: list[str] = []
    if report["drives"]:
        goal_m, goal_deg = report["goal_m_max"], report["goal_deg_max"]
        median_cm, most_cm = report["cross_track_m_median"] * 100, report["cross_track_m_p95"] * 100
        within = f"{ARRIVED_M:g} m and {math.degrees(ARRIVED_RAD):.0f} deg"
        allowed = f"{CROSS_TRACK_M * 100:.0f} cm allowed"
        farthest = f"farthest {goal_m:.3f} m, {goal_deg:.1f} deg"
        beside = f"median {median_cm:.1f} cm, 95th percentile {most_cm:.1f} cm ({allowed})"
        lines.append(f"{report['arrived']} of {report['drives']} drives arrived within {within} ({farthest})")
        lines.append(f"largest cross-track error of a drive: {beside}")
    for name, part in report["stops"].items():
        if part["drives"]:
            slowest_s = max(row["command_s"] for row in part["rows"])
            lines.append(
                f"{name}: {part['in_time']} of {part['drives']} stopped in time, zero speed after {slowest_s:.2f} s at"
                f" most ({STOP_S:g} s allowed)"
            )
    box = report["boxes"]
    if box["drives"]:
        around = sum(row["arrived"] for row in box["rows"])
        told = sum(row["no_way_reported"] for row in box["rows"])
        lines.append(
            f"box on the path: {box['good']} of {box['drives']} without contact ({around} drove round it, {told}"
            " reported no way)"
        )
    lines.append(f"drives with contact: {report['contacts']}")
    return lines


def _percentile(values: list[float], share: float) -> float | None:
    return round(float(np.percentile(values, share)), 4) if values else None
