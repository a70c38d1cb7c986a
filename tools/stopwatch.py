"""A stopwatch from outside: CPU and wall time by stage, of code that itself never looks at a clock."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any


@dataclass(slots=True)
class StageTime:
    """Seconds that one stage took, of this process's CPU and on the wall, and how often it began."""

    cpu_s: float = 0.0
    wall_s: float = 0.0
    calls: int = 0


class Stopwatch:
    """Charges each instant to the innermost stage that runs then; for one thread.

    clocks: CPU time and wall time in s. What a stage calls that is a stage itself counts there and not here.
    """

    def __init__(
        self, clocks: tuple[Callable[[], float], Callable[[], float]] = (time.process_time, time.perf_counter)
    ) -> None:
        self.stages: dict[str, StageTime] = {}
        self._clocks = clocks
        self._running: list[StageTime] = []
        self._mark = (0.0, 0.0)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the body of the with statement."""
        self._charge()
        entered = self.stages.setdefault(name, StageTime())
        entered.calls += 1
        self._running.append(entered)
        try:
            yield
        finally:
            self._charge()
            self._running.pop()

    def timed(self, function: Callable[..., Any], name: str) -> Callable[..., Any]:
        """Return a function that does the same and is timed."""

        @functools.wraps(function)
        def timed(*arguments: Any, **named: Any) -> Any:
            with self.stage(name):
                return function(*arguments, **named)

        return timed

    @contextmanager
    def timing(self, parts: tuple[tuple[Any, str, str], ...]) -> Iterator[None]:
        """Time parts (owner, attribute, stage) while the body runs: functions of a module or methods of a class.

        Each is put back as it was at the end. Raises AttributeError where there is no such part.
        """
        originals = [(owner, attribute, vars(owner).get(attribute)) for owner, attribute, _ in parts]
        for owner, attribute, original in originals:
            if original is None:
                raise AttributeError(f"{owner!r} has no {attribute!r} of its own that could be timed")
        try:
            for (owner, attribute, stage), (_, _, original) in zip(parts, originals, strict=True):
                setattr(owner, attribute, self.timed(original, stage))
            yield
        finally:
            for owner, attribute, original in originals:
                setattr(owner, attribute, original)

    def _charge(self) -> None:
        now = (self._clocks[0](), self._clocks[1]())
        if self._running:
            self._running[-1].cpu_s += now[0] - self._mark[0]
            self._running[-1].wall_s += now[1] - self._mark[1]
        self._mark = now
