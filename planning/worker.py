"""Planning in a process of its own: OMPL holds Python's global lock, and a search that hangs can only be killed."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from drivers.sources import Closing
from mapping.grid import OccupancyGrid
from planning.cancel_flag import CancelFlag
from planning.costmap import UnknownSpace
from planning.costmap_update import Window
from planning.ends import PlanError
from planning.errors import PlanningError, WorkerError
from planning.path import Path
from planning.plan import PlanResult, PlanSettings
from planning.vehicle import Vehicle
from planning.worker_link import LateError, WorkerLink
from planning.worker_process import (
    ChangedWindow,
    Clock,
    MapReady,
    NewMap,
    Order,
    Renewal,
    Request,
    Search,
    WarmUp,
)

FloatArray = NDArray[np.float64]

GRACE_S = 1.0  # beyond the time limit, before a search that does not end is killed
_START_S, _MAP_S = 600.0, 120.0  # compiling on a small computer; the largest maps


class WorkerState(str, Enum):
    """What the worker is doing; starting: loading and compiling what it plans with."""

    starting = "starting"
    ready = "ready"
    busy = "busy"
    closed = "closed"


class PlanningWorker(Closing):
    """A process that plans on one map at a time; a hanging or dead one is replaced.

    It starts with the object, and warms up beside the caller's work; requests wait for that. Any thread may call;
    requests take turns, `cancel` does not wait. The map is sent once, and again to a process that replaces another.
    clock: gives seconds, a function of a module such as time.monotonic.
    """

    def __init__(self, *, clock: Clock) -> None:
        self._clock = clock
        self._turn = threading.RLock()  # whoever holds it talks with the process
        self._cancelling = threading.Lock()
        self._searching: int | None = None
        self._closed = False
        self._number = 0
        self._flag = CancelFlag()
        self._wake, self._waker = socket.socketpair()
        self._waker.setblocking(False)
        self._map: NewMap | None = None
        self._map_sent = False
        self._killed: list[WorkerLink] = []
        self._link: WorkerLink | None = self._started()

    @property
    def pid(self) -> int | None:
        """The number of the process; None where there is none at the moment."""
        return self._link.pid if self._link else None

    @property
    def state(self) -> WorkerState:
        """What it is doing now."""
        if self._closed:
            return WorkerState.closed
        if not self._turn.acquire(blocking=False):
            return WorkerState.busy
        try:
            if self._link is not None:
                self._link.await_start(0.0)
                return WorkerState.ready
        except (LateError, WorkerError):
            pass
        finally:
            self._turn.release()
        return WorkerState.starting

    def wait_until_ready(self) -> WarmUp:
        """Wait until the process can plan, and return what that took; raises WorkerError where it comes to nothing."""
        with self._conversation() as link:
            return _started_in_time(link)

    def set_map(self, grid: OccupancyGrid, vehicle: Vehicle, unknown: UnknownSpace) -> float:
        """Plan on this map from now on, for this car; returns the seconds that preparing for it took the process.

        Raises PlanningError for what cannot be planned on, WorkerError where the process died.
        """
        with self._conversation() as link:
            self._map, self._map_sent = NewMap(grid, vehicle, unknown), False
            return self._send_map(link).seconds

    def update_map(self, grid: OccupancyGrid, window: Window) -> float:
        """Take over a map that differs from the last one in a window only.

        Only these cells are sent. Raises PlanningError where no map of this size and place was set.
        """
        with self._conversation() as link:
            known = self._map
            if known is None or not _same_frame(known.grid, grid):
                raise PlanningError("update_map: no map of this size, resolution and origin was set: call set_map")
            self._map = NewMap(grid, known.vehicle, known.unknown)
            if not self._map_sent:
                return self._send_map(link).seconds
            return self._map_answer(link, ChangedWindow(window, grid.log_odds[window.cells])).seconds

    def plan(self, start: FloatArray, goal: FloatArray, settings: PlanSettings, seed: int | None = None) -> PlanResult:
        """Plan from start (3,) to goal (3,) on the map that was set, as `planning.plan.plan` does.

        CANCELLED after `cancel`; TIMEOUT also where the search did not end by itself. Raises WorkerError where the
        process died, PlanningError for what is no request.
        """
        return self._search(Order(start, goal, settings, seed))

    def replan(
        self,
        path: Path,
        progress: int,
        settings: PlanSettings,
        *,
        car: FloatArray | None = None,
        seed: int | None = None,
    ) -> PlanResult:
        """Return what is left of a path, mended where the map that was set now blocks it, as `replan.replan` does.

        Otherwise as `plan`.
        """
        return self._search(Renewal(path, progress, car, settings, seed))

    def cancel(self) -> None:
        """End the search that is going on in another thread, if any; later ones are not affected."""
        with self._cancelling:
            if self._searching is not None:
                self._flag.cancel(self._searching)
                with suppress(BlockingIOError):  # awake already
                    self._waker.send(b"x")

    def close(self) -> None:
        """End the process; a search in another thread is cancelled. Closing twice is allowed."""
        self.cancel()
        with self._turn:
            if self._closed:
                return
            self._closed = True
            self._kill()
            for link in self._killed:
                link.reap()
            for resource in (self._flag, self._wake, self._waker):
                resource.close()

    @contextmanager
    def _conversation(self) -> Iterator[WorkerLink]:
        """Take a turn with a living process; one that fails, or is left waiting by Ctrl-C, is not used again."""
        with self._turn:
            if self._closed:
                raise WorkerError("the worker is closed: make another one")
            if self._link is None or not self._link.is_alive:
                self._kill()
                self._link = self._started()
            try:
                yield self._link
            except WorkerError:
                self._kill()
                self._link = self._started()
                raise
            except PlanningError:
                raise
            except BaseException:
                self._kill()
                raise

    def _search(self, search: Search) -> PlanResult:
        with self._conversation() as link:
            number = self._next_number()
            with self._cancelling:
                self._searching = number
            try:
                return self._planned(link, number, search)
            finally:
                with self._cancelling:
                    self._searching = None

    def _planned(self, link: WorkerLink, number: int, search: Search) -> PlanResult:
        """Send a search and wait for its end, whichever that is."""
        try:
            _started_in_time(link, number)
            if not self._map_sent and self._map is not None:
                self._send_map(link, number)
        except LateError:
            return _cancelled()  # what the process is doing now is still of use
        link.send(number, search)
        try:
            answer = link.answer(number, search.settings.time_limit_s + GRACE_S, number)
        except LateError as error:
            self._kill()
            self._link = self._started()
            if error.cancelled:
                return _cancelled()
            limit_s = search.settings.time_limit_s
            reason = f"the search did not end {GRACE_S:g} s after its limit of {limit_s:g} s and was killed"
            return PlanResult(None, PlanError.timeout, reason)
        assert isinstance(answer, PlanResult)
        return answer

    def _send_map(self, link: WorkerLink, wanted: int | None = None) -> MapReady:
        _started_in_time(link, wanted)
        assert self._map is not None
        self._map_sent = True
        return self._map_answer(link, self._map, wanted)

    def _map_answer(self, link: WorkerLink, request: Request, wanted: int | None = None) -> MapReady:
        number = self._next_number()
        link.send(number, request)
        try:
            answer = link.answer(number, _MAP_S, wanted, patience_s=0.0)
        except LateError as error:
            if error.cancelled:
                raise
            raise WorkerError(f"the planning process did not take over the map within {_MAP_S:g} s") from error
        assert isinstance(answer, MapReady)
        return answer

    def _next_number(self) -> int:
        self._number += 1
        return self._number

    def _started(self) -> WorkerLink:
        self._map_sent = False
        self._killed = [link for link in self._killed if not link.reap(0.0)]
        return WorkerLink(self._clock, self._flag, self._wake)

    def _kill(self) -> None:
        if self._link is not None:
            self._link.kill()
            self._killed.append(self._link)
            self._link = None


def _started_in_time(link: WorkerLink, wanted: int | None = None) -> WarmUp:
    try:
        return link.await_start(_START_S, wanted)
    except LateError as error:
        if error.cancelled:
            raise
        raise WorkerError(f"the planning process was not ready within {_START_S:g} s") from error


def _same_frame(one: OccupancyGrid, other: OccupancyGrid) -> bool:
    alike = one.log_odds.shape == other.log_odds.shape and one.resolution_m == other.resolution_m
    return alike and np.array_equal(one.origin, other.origin)


def _cancelled() -> PlanResult:
    return PlanResult(None, PlanError.cancelled, "the search was cancelled")
