"""Ending a command cleanly on Ctrl-C, on SIGTERM, and when its terminal goes, as with a broken ssh connection."""

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
    """Yield an event that SIGINT, SIGTERM and SIGHUP set; the former handlers return at the end. Main thread only.

    SIGHUP stays ignored where it is, under nohup.
    """
    stop = Stop()

    def handle(_number: int, _frame: FrameType | None) -> None:
        stop.asked += 1
        stop.set()

    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    former = {number: signal.signal(number, handle) for number in numbers}
    try:
        yield stop
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
