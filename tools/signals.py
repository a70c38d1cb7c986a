"""Ending a command cleanly on Ctrl-C and on SIGTERM."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Stop(threading.Event):
    """Set by the first signal; `asked` counts them all, since a second one asks to leave out what can be left out."""

    def __init__(self) -> None:
        super().__init__()
        self.asked = 0


@contextmanager
def stop_on_signals() -> Iterator[Stop]:
    """Yield an event that SIGINT and SIGTERM set; the former handlers return at the end. Main thread only."""
    stop = Stop()

    def handle(_number: int, _frame: FrameType | None) -> None:
        stop.asked += 1
        stop.set()

    former = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
