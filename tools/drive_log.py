"""What happened on a drive: goals reached, stops with their reasons, paths; for the report, and for whoever waits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.relocalisation import Located
from planning.safety import SafeCommand
from tools.results import Report

FloatArray = NDArray[np.float64]
_MOST_ENTRIES = 500  # of each list: a report is to be read


class Outcome(str, Enum):
    """How a drive ended."""

    arrived = "arrived"
    no_way = "no way"
    lost = "lost"
    emergency = "emergency stop"
    vehicle_fault = "vehicle fault"
    failed = "failed"
    interrupted = "interrupted"


class Watched(Protocol):
    """What is looked at of tools.autopilot.Autopilot."""

    goal_number: int

    @property
    def place(self) -> Located | None:
        """Where the car is, as far as it is known."""
        ...


class DriveLog:
    """Told of each command; times in its report are in s since begun_s."""

    def __init__(self, pilot: Watched, goals: Sequence[FloatArray], begun_s: float) -> None:
        self._pilot, self._goals, self._begun_s = pilot, goals, begun_s
        self._arrivals: list[Report] = []
        self._stops: list[Report] = []
        self._moving = False
        self._top_mps = 0.0

    @property
    def arrived(self) -> int:
        """How many goals were reached."""
        return len(self._arrivals)

    def note(self, now_s: float, safe: SafeCommand, *, at_end: bool) -> None:
        """Take in a command; at_end: the last goal is reached."""
        while self.arrived < self._pilot.goal_number + at_end:
            self._arrive(now_s)
        if safe.stopped and self._moving and len(self._stops) < _MOST_ENTRIES:
            self._stops.append({"at_s": self.since_s(now_s), "reason": safe.reason, "seconds": None})
        elif not safe.stopped and self._stops and self._stops[-1]["seconds"] is None:
            self._stops[-1]["seconds"] = round(self.since_s(now_s) - self._stops[-1]["at_s"], 2)
        self._moving = not safe.stopped
        self._top_mps = max(self._top_mps, abs(safe.command.speed_mps))

    def since_s(self, at_s: float) -> float:
        """Return a time of the drive."""
        return round(at_s - self._begun_s, 2)

    def report(self, notes: Sequence[tuple[float, str]]) -> Report:
        """Return it for report.json; notes: what the pilot wrote down, with times in s."""
        return {
            "goals": [[round(value, 4) for value in goal.tolist()] for goal in self._goals],
            "arrived": self.arrived,
            "arrivals": self._arrivals,
            "stops": self._stops,
            "top_mps": round(self._top_mps, 3),
            "notes": [{"at_s": self.since_s(at_s), "text": text} for at_s, text in notes[:_MOST_ENTRIES]],
        }

    def _arrive(self, now_s: float) -> None:
        goal, place = self._goals[self.arrived], self._pilot.place
        arrival: Report = {"goal": self.arrived + 1, "at_s": self.since_s(now_s), "off_m": None, "off_deg": None}
        if place is not None:  # by what SLAM believes
            away = place.T_map_base - goal
            arrival["off_m"] = round(float(np.hypot(away[0], away[1])), 4)
            arrival["off_deg"] = round(math.degrees(abs(float(se2.wrap_angle(away[2])))), 2)
        self._arrivals.append(arrival)
