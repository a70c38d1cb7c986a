"""Enter in the terminal where a command runs, as an emergency stop."""

from __future__ import annotations

import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_LOOK_S = 0.2


@contextmanager
def on_enter(act: Callable[[], None], descriptor: int | None = None) -> Iterator[bool]:
    """Call act, in a thread of its own, at each line that is typed; yields False where there is no terminal.

    descriptor: of the terminal, else stdin. A command in the background of its shell is left alone: what is typed then
    is meant for others. Main thread only.
    """
    if descriptor is None:
        try:
            descriptor = sys.stdin.fileno()
        except (OSError, ValueError, AttributeError):  # closed, or not there
            descriptor = -1
    if descriptor < 0 or not os.isatty(descriptor):
        yield False
        return
    ended = threading.Event()
    former = signal.signal(signal.SIGTTIN, signal.SIG_IGN)  # else reading in the background would suspend us
    thread = threading.Thread(target=_listen, args=(descriptor, act, ended), name="stop key", daemon=True)
    thread.start()
    try:
        yield True
    finally:
        ended.set()
        thread.join()
        signal.signal(signal.SIGTTIN, former)


def _listen(descriptor: int, act: Callable[[], None], ended: threading.Event) -> None:
    while not ended.is_set():
        if not _is_in_front(descriptor):
            ended.wait(_LOOK_S)
            continue
        if not select.select([descriptor], [], [], _LOOK_S)[0] or not _is_in_front(descriptor):
            continue
        try:
            if not os.read(descriptor, 1024):  # the end of the input: nothing will be typed any more
                return
        except OSError:
            return
        act()


def _is_in_front(descriptor: int) -> bool:
    """Whether what is typed in the terminal is for this process; so also where the terminal is not ours to ask."""
    try:
        return os.tcgetpgrp(descriptor) == os.getpgrp()
    except OSError:
        return True
