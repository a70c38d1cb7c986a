"""The one clock of a run: wall time that never steps."""

from __future__ import annotations

import time


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
