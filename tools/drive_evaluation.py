"""`evaluate drives`: the closed loop in the built-in office, many times: arrivals, stops, and a box on the path.

Each drive is a task of its own, which knows nothing of the others, so that they may be driven in several processes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from tools.drive_arrivals import drive_to_goal, told_arrival
from tools.drive_bench import Bench, map_world
from tools.drive_boxes import drive_past_box, told_box
from tools.drive_report import report_of
from tools.drive_stops import StopCause, stop_on_the_way, told_stop
from tools.processes import in_processes
from tools.results import Report

Say = Callable[[str], None]

ARRIVALS, BOXES = "drive", "box"
_FIRST_STOP, _FIRST_BOX = 1000, 2000  # numbers of cases


@dataclass(frozen=True, slots=True)
class DrivesWanted:
    """How many of each; within_m: how near to where the map was made the drives' ends lie; jobs: processes."""

    drives: int = 20
    stops: int = 20
    boxes: int = 20
    seed: int = 0
    within_m: float = math.inf
    jobs: int = 1

    @property
    def tasks(self) -> list[tuple[str, int]]:
        """What is driven: a part's name and a number each."""
        stops = [(cause.value, number) for cause in StopCause for number in range(self.stops)]
        arrivals = [(ARRIVALS, number) for number in range(self.drives)]
        return [*arrivals, *stops, *((BOXES, number) for number in range(self.boxes))]


def evaluate_drives(wanted: DrivesWanted, say: Say) -> Report:
    """Drive all of it; say is told of each. `passed` in the report tells whether all is as it must be."""
    bench = Bench(map_world(wanted.seed), wanted.seed, wanted.within_m)
    rows: dict[str, list[Report]] = {ARRIVALS: [], BOXES: [], **{cause.value: [] for cause in StopCause}}
    tasks = wanted.tasks
    found = in_processes(partial(_drive, bench), tasks, jobs=wanted.jobs)
    for (part, number), row in zip(tasks, found, strict=True):
        rows[part].append(row)
        told = {ARRIVALS: told_arrival, BOXES: told_box}.get(part, told_stop)
        say(f"{part} {number}: {told(row)}")
    stops = {cause.value: rows[cause.value] for cause in StopCause}
    return report_of(rows[ARRIVALS], stops, rows[BOXES])


def _drive(bench: Bench, task: tuple[str, int]) -> Report:
    part, number = task
    if part == ARRIVALS:
        return drive_to_goal(bench, number)
    if part == BOXES:
        return drive_past_box(bench, _FIRST_BOX + number)
    return stop_on_the_way(bench, _FIRST_STOP + number, StopCause(part))
