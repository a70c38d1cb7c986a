"""The process that plans: what `planning.worker_link` starts, and what the two say to each other.

It ignores Ctrl-C, which its parent answers, and ends when its parent is gone, however that went.
"""

from __future__ import annotations

import os
import select
import signal
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing.connection import Connection

import numpy as np
from numpy.typing import NDArray

from mapping.grid import LogOdds, OccupancyGrid
from planning.both_ends import search_from_both_ends
from planning.cancel_flag import CancelFlag
from planning.costmap import Costmap, UnknownSpace, costmap
from planning.costmap_update import Window, update
from planning.ends import GoalTolerance
from planning.errors import PlanningError
from planning.first_path import Deadline
from planning.ompl_planners import Limits
from planning.path import Path
from planning.plan import Planner, PlanResult, PlanSettings, never, plan
from planning.replan import replan
from planning.vehicle import Vehicle

FloatArray = NDArray[np.float64]
Clock = Callable[[], float]
START_NUMBER = 0  # of the answer to the start itself; requests count from 1


@dataclass(frozen=True, slots=True, eq=False)
class NewMap:
    """Plan on this map from now on, for this car."""

    grid: OccupancyGrid
    vehicle: Vehicle
    unknown: UnknownSpace


@dataclass(frozen=True, slots=True, eq=False)
class ChangedWindow:
    """Cells of the map that are no longer what they were."""

    window: Window
    log_odds: LogOdds


@dataclass(frozen=True, slots=True, eq=False)
class Order:
    """Plan from start (3,) to goal (3,) on the latest map."""

    start: FloatArray
    goal: FloatArray
    settings: PlanSettings
    seed: int | None


@dataclass(frozen=True, slots=True, eq=False)
class Renewal:
    """What is left of a path on the latest map, from its pose number `progress`; car (3,): where the car is, or None.

    As `replan` takes them.
    """

    path: Path
    progress: int
    car: FloatArray | None
    settings: PlanSettings
    seed: int | None


@dataclass(frozen=True, slots=True)
class WarmUp:
    """seconds from the start of the process until it could plan; kernels_s: of that, to compile or load kernels."""

    seconds: float
    kernels_s: float


@dataclass(frozen=True, slots=True)
class MapReady:
    """The map is taken over; seconds that this took."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Refusal:
    """text of a PlanningError, or the traceback of something unforeseen."""

    text: str
    foreseen: bool


Search = Order | Renewal
Request = NewMap | ChangedWindow | Search
Answer = WarmUp | MapReady | PlanResult | Refusal


def serve(connection_fd: int, flag_fd: int) -> None:
    """Answer (number, request) by (number, answer) until the parent hangs up; the process ends here.

    The first message is (clock, its reading at the start), the first answer a WarmUp.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, args=(connection_fd,), name="watch-parent", daemon=True).start()
    flag, connection = CancelFlag(flag_fd), Connection(connection_fd)
    try:
        clock, started_s = connection.recv()
        before_s = clock()
        warm_up(clock)
        connection.send((START_NUMBER, WarmUp(clock() - started_s, clock() - before_s)))
        answers = Answers(clock)
        while True:
            number, request = connection.recv()
            connection.send((number, answers.to(request, partial(flag.is_cancelled, number))))
    except (EOFError, ConnectionError):
        os._exit(0)  # at once: OMPL would tell on stderr what it leaves behind


def warm_up(clock: Clock) -> None:
    """Ask once for each kind of answer, map and car, so that all is compiled before the first request."""
    cells = np.full((120, 240), -5.0, np.float32)
    cells[:50, 60] = 5.0
    cells[70:, 100:120] = 0.0
    cells[10, 10] = 0.0
    grid = OccupancyGrid(cells, 0.05, np.zeros(3))
    start, goal, outside = np.array([1.5, 1.5, 1.57]), np.array([4.5, 1.5, 0.0]), np.array([-9.0, 1.5, 0.0])
    walled, patient = np.array([3.0, 1.5, 0.0]), PlanSettings(iterations=3, time_limit_s=60.0)
    tolerant = PlanSettings(tolerance=GoalTolerance(0.3, 0.3), time_limit_s=0.0)  # its goal, and no search for it
    ompl = replace(patient, planner=Planner.rrt_connect)
    wall, window = np.full((120, 1), 5.0, np.float32), Window(0, 180, 120, 181)
    requests: list[Request] = [
        Order(start, goal, patient, 1),
        Order(start, goal, ompl, 1),
        Order(start, walled, tolerant, 1),
        Order(start, walled, patient, 1),
        Order(outside, goal, patient, 1),
        ChangedWindow(window, wall),
        Order(start, np.array([11.0, 1.5, 0.0]), patient, 1),
        ChangedWindow(window, np.full_like(wall, -5.0)),
    ]
    for unknown in UnknownSpace:
        for vehicle in (Vehicle(), Vehicle(forward_only=True)):
            answers = Answers(clock)
            answers.to(NewMap(grid, vehicle, unknown), never)
            for request in requests:
                answers.to(request, never)
    known = costmap(grid, Vehicle(), UnknownSpace.forbidden)
    limits = Limits(clock, never, time_limit_s=patient.time_limit_s)
    search_from_both_ends(known, known.local(np.array([start, goal])), Deadline(limits, clock()))


class Answers:
    """What the process answers; keeps the map between requests."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._costmap: Costmap | None = None

    def to(self, request: Request, cancelled: Callable[[], bool]) -> Answer:
        """Return the answer; whatever goes wrong is an answer too."""
        started_s = self._clock()
        try:
            if isinstance(request, Search):
                return self._searched(request, cancelled)
            known, self._costmap = self._costmap, None  # rather none than an old one, should this fail
            if isinstance(request, NewMap):
                self._costmap = costmap(request.grid, request.vehicle, request.unknown)
            else:
                self._costmap = _changed(_required(known), request)
        except PlanningError as error:
            return Refusal(str(error), foreseen=True)
        except Exception:  # noqa: BLE001 - the parent raises it
            return Refusal(traceback.format_exc(), foreseen=False)
        return MapReady(self._clock() - started_s)

    def _searched(self, search: Search, cancelled: Callable[[], bool]) -> PlanResult:
        known, settings, seed = _required(self._costmap), search.settings, search.seed
        if isinstance(search, Order):
            ends = (search.start, search.goal)
            return plan(known, *ends, settings, seed=seed, clock=self._clock, cancelled=cancelled)
        left = (search.path, search.progress)
        return replan(known, *left, settings, car=search.car, seed=seed, clock=self._clock, cancelled=cancelled)


def _required(known: Costmap | None) -> Costmap:
    if known is None:
        raise PlanningError("there is no map to plan on: call set_map first")
    return known


def _changed(known: Costmap, change: ChangedWindow) -> Costmap:
    log_odds = known.grid.log_odds.copy()
    log_odds[change.window.cells] = change.log_odds
    return update(known, replace(known.grid, log_odds=log_odds), change.window)


def _end_with_parent(connection_fd: int) -> None:
    """Wait until the other end of the connection is closed, and end the process, whatever it is doing."""
    watch = select.poll()
    watch.register(connection_fd, 0)  # a hang-up is always told
    watch.poll()
    os._exit(0)
