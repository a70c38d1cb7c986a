"""One simulated drive on whose path a box is put in front of the moving car."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from planning.path import Path
from tools.autopilot import Autopilot, AutopilotState
from tools.drive_arrivals import MOST_S
from tools.drive_bench import Bench, Case
from tools.drive_scores import arrival, contacts, largest_cross_track_m, place_off_m
from tools.driven_world import DrivenWorld
from tools.results import Report

FloatArray = NDArray[np.float64]

_AHEAD_M = (1.3, 2.2)
_AFTER_M = (0.5, 1.0)  # of driving
_SIDE_M = 0.3
_CLEAR_M = 1.0  # from the goal and from the car
_TRIES = 100
_NEXT_TRY = 1000


def drive_past_box(bench: Bench, number: int) -> Report:
    """Drive the number-th case; the next hundredth where its path is too short for a box, or it never sets out."""
    for attempt in range(_TRIES):
        row = _boxed_drive(bench.case(number + attempt * _NEXT_TRY))
        if row is not None:
            return row
    return {"good": False, "arrived": False, "no_way_reported": False, "state": "no box", "contacts": 0, "paths": 0,
            "notes": ["no path was long enough for a box"]}  # fmt: skip


def told_box(row: Report) -> str:
    """Return a row in words."""
    return f"{row['state']}, {row['paths']} paths, {row['contacts']} contacts, {row['notes'][:3]}"


class _BoxOnPath:
    """Puts a box on the first path once, some way after setting out."""

    def __init__(self, case: Case) -> None:
        random = np.random.default_rng([case.bench.seed, case.number, 8])
        self.put_s: float | None = None
        self.pilot: Autopilot | None = None
        self.world: DrivenWorld | None = None
        self._case = case
        self._ahead_m, self._turn_rad = random.uniform(*_AHEAD_M), random.uniform(-math.pi, math.pi)
        self._after_m = random.uniform(*_AFTER_M)

    def __call__(self, now_s: float) -> None:
        pilot = self.pilot
        if self.put_s is not None or pilot is None or pilot.step is None or len(pilot.drives) != 1:
            return
        if pilot.step.progress_m < self._after_m or pilot.place is None:
            return
        ends = self._case.goal, pilot.place.T_map_base
        at = place_ahead(pilot.drives[0].path, pilot.step.progress_m + self._ahead_m, ends)
        if at is None or self.world is None:
            return
        half = _SIDE_M / 2.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        place = se2.compose(self._case.bench.mapped.T_world_map, np.array([*at[:2], self._turn_rad]))
        self.world.put_box(se2.transform_points(place, half))
        self.put_s = now_s


def place_ahead(path: Path, progress_m: float, ends: Sequence[FloatArray]) -> FloatArray | None:
    """Return the pose (3,) of a path at a progress, None where it is beyond its end or near to one of `ends` (3,)."""
    marks = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path.poses[:, :2], axis=0).T))])
    at = int(np.searchsorted(marks, progress_m))
    if at >= len(marks):
        return None
    place: FloatArray = path.poses[at]
    return place if min(float(np.hypot(*(place - end)[:2])) for end in ends) >= _CLEAR_M else None


def _boxed_drive(case: Case) -> Report | None:
    bench, box = case.bench, _BoxOnPath(case)
    loop, pilot, car = case.loop(box)
    box.pilot, box.world = pilot, car.world
    loop.run(MOST_S)
    if box.put_s is None:
        return None
    truth = case.truth(car)
    end = arrival(truth.in_map[-1], case.goal)
    arrived = pilot.state is AutopilotState.arrived and end.is_within()
    hits = contacts(truth, car.world.world, bench.vehicle, box.put_s)
    told = pilot.state is AutopilotState.no_way
    return {
        "good": (arrived or told) and hits == 0,
        "arrived": arrived,
        "no_way_reported": told,
        "state": pilot.state.value,
        "fault": loop.drive.fault,
        "goal_m": round(end.away_m, 4),
        "cross_track_m": round(largest_cross_track_m(truth, loop.log.ticks, pilot.drives), 4),
        "place_off_m": round(place_off_m(truth, loop.log.places), 4),
        "contacts": hits,
        "paths": len(pilot.drives),
        "notes": [text for _, text in pilot.notes],
    }
