"""Where long work is done: here and now in a replay, in other threads while the robot drives.

Whoever hands over a task decides at which keyframe its outcome counts, so that both give the same map, bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

_T = TypeVar("_T")


class Background(Protocol):
    """Takes up a task; what it returns waits for the outcome."""

    def __call__(self, task: Callable[[], _T], /) -> Callable[[], _T]:
        """Take up a task."""
        ...


def at_once(task: Callable[[], _T], /) -> Callable[[], _T]:
    """Run a task here and now: the background of a replay."""
    outcome = task()
    return lambda: outcome
