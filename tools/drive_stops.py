"""One simulated drive that is stopped on its way: by old data, an emergency stop, or a link that fails."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum

import numpy as np

from drivers.rover_faults import RoverFaultKind
from tools.autopilot import Autopilot
from tools.closed_loop import ClosedLoop
from tools.drive_bench import Bench, Case
from tools.drive_scores import Stop, contacts, stop_after
from tools.results import Report
from tools.simulated_car import SimulatedCar

STOP_S = 0.6
TIMEOUT_S = 0.1  # beyond the vehicle's own
_SHARE = (0.1, 0.8)  # of its path, when it happens
_MOST_S = 90.0
_WATCHED_S = 2.5
_FAST_MPS, _TICKS = 0.2, 8  # so fast at least it was told to be for so many commands when it is stopped


class StopCause(str, Enum):
    """What stops the car on the way."""

    stale_pose = "stale pose"
    stale_scan = "stale scan"
    emergency = "e-stop"
    silent = "vehicle silent"
    killed = "killed"
    cut = "link cut"
    deaf = "vehicle deaf"

    @property
    def by_timeout(self) -> bool:
        """Whether only the vehicle's own timeout can stop it: nothing of ours arrives any more."""
        return self in {StopCause.killed, StopCause.cut, StopCause.deaf}


def stop_on_the_way(bench: Bench, number: int, cause: StopCause) -> Report:
    """Drive the number-th case and stop it at an instant by chance."""
    case = bench.case(number)
    event = _Event(case, cause)
    loop, pilot, car = case.loop(event)
    event.happen, event.pilot, event.loop = _event(cause, loop, pilot, car), pilot, loop

    def watched(now_s: float) -> bool:
        return event.at_s is not None and now_s > event.at_s + _WATCHED_S + by_itself * _timeout_s(car)

    by_itself = cause.by_timeout
    loop.run(_MOST_S, watched, after_s=_MOST_S)
    if event.at_s is None:
        return {"in_time": False, "reason": f"nothing happened: {pilot.state.value}", "contacts": 0}
    good_s = {
        StopCause.stale_pose: loop.log.last_pose_s,
        StopCause.stale_scan: loop.log.last_scan_s,
        StopCause.silent: loop.log.heard_s,
    }.get(cause)
    truth = case.truth(car)
    stop = stop_after(truth, car.sent, event.at_s if good_s is None else good_s)
    noticed_s = next((tick.now_s for tick in loop.log.ticks if tick.now_s >= event.at_s and tick.safe.stopped), None)
    last = loop.log.ticks[-1].safe
    return {
        "command_s": or_none(stop.command_s),
        "stood_s": or_none(stop.stood_s),
        "speed_mps": round(stop.event_mps, 3),
        "noticed_s": None if noticed_s is None else round(noticed_s - event.at_s, 3),
        "vehicle_timeout_s": _timeout_s(car),
        "in_time": _is_in_time(stop, cause, bench, _timeout_s(car)),
        "reason": last.reason if last.stopped else "",
        "fault": loop.drive.fault,
        "contacts": contacts(truth, car.world.world, bench.vehicle),
    }


def told_stop(row: Report) -> str:
    """Return a row in words."""
    if "command_s" not in row:
        return str(row["reason"])
    command = "no zero speed sent" if row["command_s"] is None else f"zero speed after {row['command_s']:.2f} s"
    stood = "never stood" if row["stood_s"] is None else f"stood after {row['stood_s']:.2f} s"
    return f"{command}, {stood}{'' if row['in_time'] else ': TOO LATE'}"


class _Event:
    """Happens once, at a share of the path by chance, while the car drives; at_s: when it did."""

    def __init__(self, case: Case, cause: StopCause) -> None:
        random = np.random.default_rng([case.bench.seed, case.number, list(StopCause).index(cause), 7])
        self.at_s: float | None = None
        self.happen: Callable[[], None] = lambda: None
        self.pilot: Autopilot | None = None
        self.loop: ClosedLoop | None = None
        self._share = random.uniform(*_SHARE)
        self._wait_s = random.uniform(0.0, 0.2)  # so that it falls between two commands or scans by chance
        self._due_s: float | None = None

    def __call__(self, now_s: float) -> None:
        if self.at_s is not None or self.pilot is None or self.pilot.step is None or not self._drives():
            return
        step = self.pilot.step
        if self._due_s is None and step.progress_m >= self._share * (step.progress_m + step.remaining_m):
            self._due_s = now_s + self._wait_s
        if self._due_s is not None and now_s >= self._due_s:
            self.at_s = now_s
            self.happen()

    def _drives(self) -> bool:
        """Whether the car was told to drive for the last commands."""
        ticks = [] if self.loop is None else self.loop.log.ticks[-_TICKS:]
        return len(ticks) == _TICKS and all(abs(tick.safe.command.speed_mps) >= _FAST_MPS for tick in ticks)


def _event(cause: StopCause, loop: ClosedLoop, pilot: Autopilot, car: SimulatedCar) -> Callable[[], None]:
    """Return what happens."""

    def lose_poses() -> None:
        loop.deaf_to_poses = True

    happenings: dict[StopCause, Callable[[], None]] = {
        StopCause.stale_pose: lose_poses,
        StopCause.stale_scan: loop.unplug_lidar,
        StopCause.emergency: lambda: pilot.safety.emergency_stop("pressed"),
        StopCause.silent: lambda: car.rover.begin(RoverFaultKind.SILENCE),
        StopCause.killed: loop.kill,
        StopCause.cut: lambda: car.rover.begin(RoverFaultKind.CUT),
        StopCause.deaf: lambda: car.rover.begin(RoverFaultKind.DEAF),
    }
    return happenings[cause]


def _timeout_s(car: SimulatedCar) -> float:
    """Return what our end has read from the vehicle."""
    told_s = car.vehicle.setpoint_timeout_s
    return math.inf if told_s is None else told_s


def _is_in_time(stop: Stop, cause: StopCause, bench: Bench, timeout_s: float) -> bool:
    if cause.by_timeout:
        return stop.by_timeout(timeout_s + TIMEOUT_S, bench.model)
    return stop.in_time(STOP_S, bench.model)


def or_none(seconds: float) -> float | None:
    """Return seconds for a table or JSON, None for infinite ones."""
    return round(seconds, 3) if math.isfinite(seconds) else None
