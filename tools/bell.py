"""Wakes a thread that waits: by other threads, and by signals even while the main thread is in compiled code.

Python calls a signal's handler in the main thread, once it is back from what it does there; the number of the signal
is written to the bell by the system's own handler before (signal.set_wakeup_fd).
"""

from __future__ import annotations

import select
import signal
import socket
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

from drivers.sources import Closing

_MOST_BYTES = 64


class Bell(Closing):
    """One thread waits, any may ring; what was rung is kept until it is waited for."""

    def __init__(self) -> None:
        self._heard, self._button = socket.socketpair()
        for end in (self._heard, self._button):
            end.setblocking(False)

    def ring(self, number: int) -> None:
        """Ring with a number from 1 to 255; never waits."""
        with suppress(OSError):  # full: it rings already; closed: nobody waits any more
            self._button.send(bytes([number]))

    def wait(self, timeout_s: float) -> tuple[int, ...]:
        """Return the numbers that were rung with, () where there was none within the time."""
        if not select.select([self._heard], [], [], max(timeout_s, 0.0))[0]:
            return ()
        return tuple(self._heard.recv(_MOST_BYTES))

    def close(self) -> None:
        """Release it."""
        self._heard.close()
        self._button.close()

    @contextmanager
    def rung_by_signals(self, numbers: Sequence[signal.Signals] = ()) -> Iterator[None]:
        """Ring with the number of each signal that has a handler; these get one that does nothing. Main thread only."""
        former = {number: signal.signal(number, _ignore) for number in numbers}
        before = signal.set_wakeup_fd(self._button.fileno(), warn_on_full_buffer=False)
        try:
            yield
        finally:
            signal.set_wakeup_fd(before)
            for number, handler in former.items():
                signal.signal(number, handler)


def _ignore(_number: int, _frame: object) -> None:
    """Whoever waits at the bell acts."""
