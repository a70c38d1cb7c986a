"""What a car does between two paths: stand until the map has settled, have a path looked for, back off, or give up."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from planning.ends import PlanError
from planning.path import Path
from planning.plan import PlanResult
from planning.retreat import retreat
from planning.vehicle import Vehicle
from tools.drive_settings import AutopilotSettings
from tools.map_of_today import Place
from tools.path_search import PathAnswer, PathSearch, PathWanted

FloatArray = NDArray[np.float64]

_SAME_PLACE_M = 0.05
_OF_THE_GOAL = (PlanError.goal_occupied, PlanError.goal_in_unknown_space, PlanError.goal_outside_map)
Notes = list[tuple[float, str]]


@dataclass(frozen=True, slots=True, eq=False)
class NextPath:
    """A path to drive, and why; backs_off: only to plan again from its end."""

    path: Path
    reason: str
    backs_off: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class _Question:
    """What is asked of the search: since when, with the car where (3,), and which way it is to back off before.

    otherwise: what it drives where no path leads on from there, or one with no more room, which is margin_m.
    """

    since_s: float
    at: FloatArray
    way: Path | None = None
    otherwise: NextPath | None = None
    margin_m: float = 0.0


class DrivePlanning:
    """Plans to one goal after another, each from where the car then stands. given_up: why there is no way, or empty.

    notes: what is told of what came to nothing, with times in s.
    """

    def __init__(self, search: PathSearch, vehicle: Vehicle, settings: AutopilotSettings, notes: Notes) -> None:
        self.given_up = ""
        self.words = "standing"
        self._search, self._vehicle, self._settings, self._notes = search, vehicle, settings, notes
        self._goal = np.zeros(3)
        self._reason = self._why = ""
        self._driven: Path | None = None
        self._stood_s: float | None = None
        self._asked: _Question | None = None
        self._failed = self._backed = 0
        self._tried_at: FloatArray | None = None

    def begin(self, goal: FloatArray, reason: str) -> None:
        """Plan to a goal (3,), whatever came of others."""
        self._goal, self.given_up = np.array(goal, dtype=np.float64), ""
        self._failed = self._backed = 0
        self._tried_at = None
        self.again(reason)

    def again(self, reason: str, driven: Path | None = None) -> None:
        """Plan to the same goal once more, and say why; driven: the way that the car came."""
        self._reason, self._driven = reason, driven
        self._stood_s = self._asked = None
        self.words = f"stopping: {reason}"

    def step(self, place: Place, pose: FloatArray, speed_mps: float, now_s: float) -> NextPath | None:
        """Return what to drive next from a pose (3,), None as long as the car is to stand."""
        if self.given_up:
            return None
        if abs(speed_mps) > self._settings.follower.standing_mps:
            self._stood_s = self._asked = None
            return None
        self._stood_s = now_s if self._stood_s is None else self._stood_s
        if self._asked is None:
            if now_s - self._stood_s < self._settings.pause_s or place.stamp_s < self._stood_s:
                self.words = f"standing until the map has settled: {self._reason}"
                return None
            self._ask(place, _Question(now_s, pose))
        return self._answered(place, pose, now_s)

    def _ask(self, place: Place, question: _Question) -> None:
        """Have a path looked for from where the car is or, if it is to back off first, from the end of that way."""
        rule, start = self._settings, question.at if question.way is None else question.way.poses[-1]
        self._asked = question
        self._search.ask(PathWanted(place.grid, self._vehicle, rule.margins_m, rule.unknown, start, self._goal))

    def _answered(self, place: Place, pose: FloatArray, now_s: float) -> NextPath | None:
        """Take up the answer, if it is there."""
        asked = self._asked
        assert asked is not None
        whence = "" if asked.way is None else f" from {asked.way.length_m:.1f} m back"
        self.words = f"looking for a path{whence}, for {now_s - asked.since_s:.1f} s: {self._reason}"
        answer = self._search.answer()
        if answer is None:
            return None
        self._asked = None
        away = se2.between(asked.at, pose)
        if np.hypot(away[0], away[1]) > self._settings.moved_m or abs(away[2]) > self._settings.moved_rad:
            self._notes.append((now_s, "the car moved while a path was looked for: planning again"))
            self._stood_s = None
            return None
        if asked.way is not None:
            return self._from_back_there(answer, asked, asked.way, now_s)
        again = self._tried_at is not None and float(np.hypot(*(pose - self._tried_at)[:2])) < _SAME_PLACE_M
        self._tried_at = pose
        self._failed = self._failed if again else 0
        if answer.result.path is not None:
            self._failed += again  # a path was found here before, and could not be followed
            if self._failed < self._settings.tries:
                return self._set_out(answer, answer.result.path, place, pose, now_s)
        self._try_again(answer.result, place, pose, now_s)
        return None

    def _set_out(self, answer: PathAnswer, path: Path, place: Place, pose: FloatArray, now_s: float) -> NextPath | None:
        """Return a path; where the car stands too near to something, first see whether one from back has more room."""
        found, margin_m, wanted_m = NextPath(path, self._reason), answer.margin_m or 0.0, self._settings.margins_m[0]
        if margin_m < wanted_m and self._backed < self._settings.back_offs and not _has_room(place, pose, wanted_m):
            way = self._way_back(place, pose)
            if way is not None:
                self._why = f"the path from here begins with less than {wanted_m:g} m of room"
                self._ask(place, _Question(now_s, pose, way, found, margin_m))
                return None
        return found

    def _try_again(self, result: PlanResult, place: Place, pose: FloatArray, now_s: float) -> None:
        """Stand for a while and try again; in the end see whether backing off helps, or give up."""
        why = result.reason
        if result.path is not None:
            why = f"what is planned here cannot be followed: {self._reason}"
        self._failed += 1
        self._notes.append((now_s, why))
        self._stood_s = None  # it stands anew, and more scans see what is in the way
        self._reason = f"no path from here (try {self._failed} of {self._settings.tries}): {why}"
        if self._failed < self._settings.tries:
            return
        if result.error in _OF_THE_GOAL:
            self.given_up = why
        elif self._backed >= self._settings.back_offs:
            self.given_up = f"{why}; it has backed off {self._backed} times"
        else:
            way, self._why = self._way_back(place, pose), why
            if way is None:
                self.given_up = f"{why}; and there is no room to back off"
            else:
                self._stood_s = now_s
                self._ask(place, _Question(now_s, pose, way))

    def _way_back(self, place: Place, pose: FloatArray) -> Path | None:
        return retreat(place.near, pose, self._driven, self._settings.back_m, self._settings.margins_m)

    def _from_back_there(self, answer: PathAnswer, asked: _Question, way: Path, now_s: float) -> NextPath | None:
        """Return the way back if a path leads on from its end, and has more room than what there is otherwise."""
        if answer.margin_m is not None and (asked.otherwise is None or answer.margin_m > asked.margin_m):
            self._backed += 1
            self._notes.append((now_s, f"backing off {way.length_m:.2f} m: {self._why}"))
            return NextPath(way, self._why, backs_off=True)
        if asked.otherwise is None:
            self.given_up = f"{self._why}; nor is there one from {way.length_m:.1f} m back: {answer.result.reason}"
        return asked.otherwise


def _has_room(place: Place, pose: FloatArray, margin_m: float) -> bool:
    """Whether the car stands at a pose (3,) with so much room around it."""
    return replace(place.near, vehicle=replace(place.near.vehicle, margin_m=margin_m)).fits(pose)
