"""The one clock of a run: wall time that never steps; and that of an emulated world, which waits for its computer."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray


class RunClock:
    """Wall-clock nanoseconds as the monotonic clock plus an offset that is taken once, at construction."""

    def __init__(self) -> None:
        self.offset_ns = time.time_ns() - time.monotonic_ns()

    def __call__(self) -> int:
        """Return the present stamp."""
        return self.monotonic_ns() + self.offset_ns

    @staticmethod
    def monotonic_ns() -> int:
        """Return the clock without its offset."""
        return time.monotonic_ns()


class PatientClock:
    """Monotonic ns that stand still where nobody asks for longer than most_s, however many threads ask.

    A process that a busy computer leaves no time for has then missed nothing: what is emulated in it waits, all at
    once, where it would jump otherwise.
    """

    def __init__(self, most_s: float = 0.1, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._most_ns, self._clock, self._lock = round(most_s * 1e9), clock, threading.Lock()
        self._asked_ns = clock()
        self._waited_ns = [0]
        self._waits_from_ns: list[int] = []

    def __call__(self) -> int:
        """Return the time."""
        with self._lock:
            now_ns = self._clock()
            late_ns = now_ns - self._asked_ns - self._most_ns
            if late_ns > 0:
                self._waits_from_ns.append(self._asked_ns - self._waited_ns[-1])
                self._waited_ns.append(self._waited_ns[-1] + late_ns)
            self._asked_ns = now_ns
            return now_ns - self._waited_ns[-1]

    @property
    def waited_s(self) -> float:
        """How long it stood still so far."""
        return self._waited_ns[-1] * 1e-9

    def monotonic_ns(self, times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return when, on the clock that it is made of, its times (N,) were."""
        waited_ns = np.array(self._waited_ns, dtype=np.int64)
        return np.asarray(times_ns + waited_ns[np.searchsorted(self._waits_from_ns, times_ns)])
