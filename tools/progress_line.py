"""How far a long job is, and how long it will take: one line that is rewritten on a terminal, else one now and then."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable
from typing import TextIO

from typing_extensions import Self

log = logging.getLogger(__name__)
_REWRITE_S, _SAY_S = 0.2, 15.0
_CLEAR = "\r\033[K"


class ProgressLine:
    """Tells of n of m things done, and of the time left; what: the words around, with {done} and {count} in them.

    stream: where the line goes if that is a terminal; None: standard error. say: takes a line otherwise. clock: s.
    """

    def __init__(
        self,
        what: str,
        *,
        stream: TextIO | None = None,
        say: Callable[[str], None] = log.info,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._what, self._say, self._clock = what, say, clock
        stream = stream or sys.stderr
        self._terminal = stream if stream.isatty() and log.isEnabledFor(logging.INFO) else None
        self._begun_s, self._begun_at, self._count = clock(), 0, 0
        self._told_s = -_SAY_S
        self._open = False  # a line is on the terminal that has no end yet

    def __enter__(self) -> Self:
        """Begin to tell."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the line, also where an error or Ctrl-C ends the job: what is told next stands on a line of its own."""
        if self._terminal is not None and self._open:
            self._terminal.write("\n")
            self._terminal.flush()
        self._open = False

    def tell(self, done: int, count: int) -> None:
        """Tell that so many are done, of so many; the last one of a batch is always told."""
        now_s = self._clock()
        if count != self._count or done < self._begun_at:  # another batch; what was done before took no time
            self._begun_s, self._begun_at, self._count = min(now_s, self._last_s(now_s)), done - 1, count
        ended = done >= count
        if not ended and now_s - self._told_s < (_SAY_S if self._terminal is None else _REWRITE_S):
            return
        self._told_s = now_s
        line = self._what.format(done=done, count=count) + self._left(now_s, done, count)
        if self._terminal is None:
            self._say(line)
            return
        self._terminal.write(f"{_CLEAR}{line}" + ("\n" if ended else ""))
        self._terminal.flush()
        self._open = not ended

    def _last_s(self, now_s: float) -> float:
        """Return when the batch began: now as far as is known, at the construction for the first one."""
        return self._begun_s if self._count == 0 else now_s

    def _left(self, now_s: float, done: int, count: int) -> str:
        made = done - self._begun_at
        if done >= count or made <= 0 or now_s <= self._begun_s:
            return ""
        return f", {time_in_words((now_s - self._begun_s) / made * (count - done))} left"


def time_in_words(seconds: float) -> str:
    """Return a length of time as people say it."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    if seconds < 90.0 * 60.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"
