"""The thread that commands a car, at its own pace whatever mapping does, and another that watches it."""

from __future__ import annotations

import logging
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

from drivers.errors import DriverError
from drivers.vehicle import Vehicle
from tools.bell import Bell

log = logging.getLogger(__name__)

PERIOD_S = 0.02  # the vehicle is heard and the bell listened to so often; the pilot has a period of its own
WATCH_S = 0.1
LATE_S = 0.1
HANGING = 5  # so many looks of the watch in a row without a step of the thread
_END_S = 15.0  # to stand, hold and disarm, with what a vehicle takes to answer
_HALT_S = 1.5  # standstill is repeated so long before the car is disarmed
EMERGENCIES = (signal.SIGUSR1, signal.SIGTSTP)
KEY = 255  # rung by the key in the terminal
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Driven(Protocol):
    """What is stepped: tools.commanded_drive.CommandedDrive, or what only tells the vehicle where it is."""

    @property
    def fault(self) -> str:
        """Why the vehicle is not driven any more; empty where it is."""
        ...

    @property
    def left(self) -> bool:
        """Whether somebody else may have the vehicle: nothing is said to it any more."""
        ...

    @property
    def armed(self) -> bool:
        """Whether the car may be moving by our commands."""
        ...

    def step(self, now_ns: int) -> object:
        """Do what is due."""
        ...

    def emergency_stop(self, reason: str) -> None:
        """Let nothing but standstill through from now on."""
        ...


@dataclass(slots=True)
class Pace:
    """How the thread kept time: steps, the longest time from one to the next, and how many took longer than LATE_S."""

    steps: int = 0
    longest_s: float = 0.0
    late: int = 0

    def note(self, seconds: float) -> None:
        """Take in the time between two steps."""
        self.steps += 1
        self.longest_s = max(self.longest_s, seconds)
        self.late += seconds > LATE_S

    def summary(self) -> dict[str, float]:
        """Return it for report.json."""
        return {"steps": self.steps, "longest_s": round(self.longest_s, 3), "longer_than_0.1_s": self.late}


class DriveThread:
    """Steps until the session ends, then makes the car stand and disarms it.

    stop: ends the session; bell: rung by the signals that do, and by those and keys that mean an emergency. after_step:
    called after each step with the time in ns; what it returns as true ends the session. failure: what the thread died
    of; the car is stopped then, and the session goes on.
    """

    def __init__(
        self,
        driven: Driven,
        vehicle: Vehicle,
        clock: Callable[[], int],
        bell: Bell,
        stop: threading.Event,
        after_step: Callable[[int], bool] = lambda _: False,
    ) -> None:
        self.failure: BaseException | None = None
        self.pace = Pace()
        self._driven, self._vehicle, self._clock = driven, vehicle, clock
        self._bell, self._stop, self._after_step = bell, stop, after_step
        self._halting = threading.Event()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="drive", daemon=True)
        self._watch = threading.Thread(target=self._look, name="drive watch", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()
        self._watch.start()

    def end(self) -> None:
        """Make the car stand, and wait until it does; may be called again, and where it never began."""
        self._halting.set()
        if self._thread.ident is not None:
            self._bell.ring(signal.SIGTERM)
            self._thread.join(_END_S)
            if self._thread.is_alive():  # it hangs in the vehicle's link: all else is saved without it
                self._cut("the drive's thread does not end")
                self.failure = self.failure or TimeoutError(f"the drive's thread did not end within {_END_S:g} s")
            self._over.set()
            self._watch.join()

    def _run(self) -> None:
        try:
            self._step_on()
            self._halt()
        except BaseException as error:
            self._cut(f"the drive has failed: {error!r}")  # before all else: a terminal that is held up blocks the log
            self.failure = error
            log.exception("the drive has failed: emergency stop; mapping goes on, Ctrl-C ends it")

    def _step_on(self) -> None:
        due_s = last_s = time.monotonic()
        while not (self._halting.is_set() or self._stop.is_set()):
            self._driven.step(self._clock())
            if self._after_step(self._clock()):
                self._stop.set()
            now_s = time.monotonic()
            due_s = max(due_s + PERIOD_S, now_s)
            for number in self._bell.wait(due_s - now_s):
                if number in _ENDING:
                    return
                if number in EMERGENCIES or number == KEY:
                    self._emergency(number)
            self.pace.note(time.monotonic() - last_s)
            last_s = time.monotonic()

    def _emergency(self, number: int) -> None:
        how = "a key" if number == KEY else signal.Signals(number).name
        self._cut(f"by {how}")
        log.warning("EMERGENCY STOP by %s: it holds until a new start; Ctrl-C saves and ends", how)

    def _cut(self, reason: str) -> None:
        """Stop with all that the link has, now."""
        self._driven.emergency_stop(reason)
        if self._driven.armed:
            with suppress(Exception):  # what else could be done is the vehicle's own timeout
                self._vehicle.emergency_stop()

    def _halt(self) -> None:
        """Stand, hold, and disarm; where somebody else has the car, or nobody, nothing is said any more."""
        self._halting.set()
        if not self._driven.armed or self._driven.left:
            return
        try:
            self._vehicle.stop()
            until_s = time.monotonic() + _HALT_S
            while time.monotonic() < until_s:
                self._vehicle.poll()
                time.sleep(PERIOD_S)
            self._vehicle.disarm()
        except DriverError as error:
            log.warning("%s", error)

    def _look(self) -> None:
        """See to it that a thread that hangs or has died leaves no car driving.

        Looks are counted, not seconds: where this thread gets no time either, the whole process is held up, and that is
        for the vehicle's own timeout.
        """
        steps, still, is_cut = -1, 0, False
        while not self._over.wait(WATCH_S):
            if self.failure is not None:
                with suppress(Exception):  # repeats the emergency stop until the vehicle has heard it
                    self._vehicle.poll()
                continue
            still = still + 1 if self.pace.steps == steps and not self._halting.is_set() else 0
            steps = self.pace.steps
            if still < HANGING:
                is_cut = False
            elif self._driven.armed and not is_cut:
                is_cut = True
                self._cut("the drive's thread hangs")
                log.error("no command for %.1f s: EMERGENCY STOP", still * WATCH_S)
