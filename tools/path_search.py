"""Looking for a path while the car stands: asked at one time, answered at another, so that no command waits for it.

Here, in the calling process, for the simulator's clock; beside, in a process of its own, for a car.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.sources import Closing
from mapping.grid import OccupancyGrid
from planning.costmap import Costmap, UnknownSpace, costmap
from planning.ends import PlanError
from planning.errors import PlanningError
from planning.plan import PlanResult, PlanSettings
from planning.vehicle import Vehicle
from planning.worker import PlanningWorker, WorkerState

FloatArray = NDArray[np.float64]
PlanPath = Callable[[Costmap, FloatArray, FloatArray], PlanResult]
"""(Costmap, start (3,), goal (3,)) to a plan."""

_USUAL = PlanSettings(time_limit_s=5.0)
_LOOK_S = 0.05  # between two looks at a planning process that is starting
_JOIN_S = 5.0
_VAIN = (
    PlanError.cancelled,
    PlanError.start_outside_map,
    PlanError.goal_outside_map,
)  # a smaller margin changes nothing about these


@dataclass(frozen=True, slots=True, eq=False)
class PathWanted:
    """A path from start (3,) to goal (3,) on a grid; margins_m: room to keep, the first that leaves a path counts."""

    grid: OccupancyGrid
    vehicle: Vehicle
    margins_m: tuple[float, ...]
    unknown: UnknownSpace
    start: FloatArray
    goal: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class PathAnswer:
    """The plan, and the margin with which it was found; without a path, why there is none with the most room."""

    result: PlanResult
    margin_m: float | None = None


class PathSearch(Protocol):
    """Looks for one path at a time."""

    def ask(self, wanted: PathWanted) -> None:
        """Look for a path; a search that is going on is given up. Returns at once."""
        ...

    def answer(self) -> PathAnswer | None:
        """Return the answer to the last question, once; None while there is none."""
        ...

    def close(self) -> None:
        """Give up; closing twice is allowed."""
        ...


class PathSearchHere:
    """Plans within `ask`; the first `late` calls of `answer` after it return None, as if it took so long."""

    def __init__(self, plan_path: PlanPath, late: int = 0) -> None:
        self._plan_path, self._late = plan_path, late
        self._answer: PathAnswer | None = None
        self._wait = 0

    def ask(self, wanted: PathWanted) -> None:
        """Plan now."""

        def plan_for(vehicle: Vehicle) -> PlanResult:
            return self._plan_path(costmap(wanted.grid, vehicle, wanted.unknown), wanted.start, wanted.goal)

        self._answer, self._wait = _with_most_room(wanted, plan_for), self._late

    def answer(self) -> PathAnswer | None:
        """Return the answer, once it is due."""
        if self._answer is None or self._wait > 0:
            self._wait -= 1
            return None
        answer, self._answer = self._answer, None
        return answer

    def close(self) -> None:
        """Forget the answer."""
        self._answer = None


class PathSearchBeside(Closing):
    """Plans in a process of its own, which a thread talks with; clock: a function of a module, such as time.monotonic.

    It starts with the object. Where the process dies, that is the answer, and the next question finds another process.
    `answer` raises what nobody has foreseen.
    """

    def __init__(self, clock: Callable[[], float], settings: PlanSettings = _USUAL) -> None:
        self._settings = settings
        self._worker = PlanningWorker(clock=clock)
        self._changed = threading.Condition()
        self._wanted: PathWanted | None = None  # not yet taken up
        self._searched: PathWanted | None = None  # what the thread is busy with
        self._last: PathWanted | None = None  # what was asked for last
        self._answer: PathAnswer | None = None
        self._error: BaseException | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="path search", daemon=True)
        self._thread.start()

    def ask(self, wanted: PathWanted) -> None:
        """Hand the question over; see PathSearch."""
        with self._changed:
            self._wanted = self._last = wanted
            self._answer = None
            self._changed.notify()
        self._give_up_others()

    def answer(self) -> PathAnswer | None:
        """Return the answer, once it is there."""
        self._give_up_others()
        with self._changed:
            if self._error is not None:
                raise self._error
            answer, self._answer = self._answer, None
            return answer

    def close(self) -> None:
        """End the search, the thread and the process."""
        with self._changed:
            self._closed, self._last = True, None
            self._changed.notify()
        self._give_up_others()
        self._thread.join(_JOIN_S)
        self._worker.close()

    def _give_up_others(self) -> None:
        """Cancel the search for what is not wanted any more; also later, as one may have been just about to begin."""
        searched = self._searched
        if searched is not None and searched is not self._last:
            self._worker.cancel()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._wanted is not None)
                if self._closed:
                    return
                assert self._wanted is not None
                self._searched, self._wanted = self._wanted, None
            try:
                answer = self._search(self._searched)
            except BaseException as error:  # noqa: BLE001 - raised again in the thread that asks
                self._error = error
                return
            with self._changed:
                if self._searched is self._last:
                    self._answer = answer
                self._searched = None

    def _search(self, wanted: PathWanted) -> PathAnswer | None:
        """Return the answer; None where it is no longer wanted."""
        while self._worker.state is WorkerState.starting:
            with self._changed:
                if self._changed.wait_for(lambda: wanted is not self._last, _LOOK_S):
                    return None
        try:
            return _with_most_room(wanted, lambda vehicle: self._plan(wanted, vehicle))
        except PlanningError as error:
            return PathAnswer(PlanResult(None, None, str(error)))

    def _plan(self, wanted: PathWanted, vehicle: Vehicle) -> PlanResult:
        if wanted is not self._last:
            return PlanResult(None, PlanError.cancelled, "another path is wanted")
        self._worker.set_map(wanted.grid, vehicle, wanted.unknown)
        return self._worker.plan(wanted.start, wanted.goal, self._settings)


def _with_most_room(wanted: PathWanted, plan_for: Callable[[Vehicle], PlanResult]) -> PathAnswer:
    """Try one margin after the other."""
    first: PlanResult | None = None
    for margin_m in wanted.margins_m:
        result = plan_for(replace(wanted.vehicle, margin_m=margin_m))
        if result.path is not None:
            return PathAnswer(result, margin_m)
        first = first or result
        if result.error in _VAIN:
            break
    return PathAnswer(first or PlanResult(None, None, "no margin to plan with: give at least one"))
