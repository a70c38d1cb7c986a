"""Whether a car does what it is told, by the speed that it reports: one that is deaf, stuck or stalled does not."""

from __future__ import annotations

from collections import deque

_ANSWER_S = 1.0  # latency, speeding up, braking, and telemetry on its way
_PATIENCE_S = 0.5
_TOLERANCE_MPS = 0.15
_TOLERANCE = 0.3  # of the fastest command
_OLD_S = 0.5


class SpeedWatch:
    """Times are s of one clock, in the order of time. A car that reports no speed is not judged."""

    def __init__(self) -> None:
        self._told: deque[tuple[float, float]] = deque()
        self._reported: tuple[float, float] | None = None
        self._amiss_s: float | None = None

    def report(self, now_s: float, speed_mps: float) -> None:
        """Take what the car says of its speed."""
        self._reported = now_s, speed_mps

    def tell(self, now_s: float, speed_mps: float) -> str:
        """Take what it is told now; return in words what is amiss, empty where nothing is."""
        self._told.append((now_s, speed_mps))
        while len(self._told) > 1 and self._told[1][0] <= now_s - _ANSWER_S:  # one before the span holds in it
            self._told.popleft()
        if self._reported is None or now_s - self._reported[0] > _OLD_S or self._follows(self._reported[1]):
            self._amiss_s = None
            return ""
        self._amiss_s = now_s if self._amiss_s is None else self._amiss_s
        if now_s - self._amiss_s < _PATIENCE_S:
            return ""
        return f"the vehicle does not follow: told {speed_mps:.2f} m/s, it reports {self._reported[1]:.2f} m/s"

    def _follows(self, speed_mps: float) -> bool:
        """Whether a speed is among those that it was told of late."""
        told = [speed for _, speed in self._told]
        room = _TOLERANCE_MPS + _TOLERANCE * max(abs(speed) for speed in told)
        return min(told) - room <= speed_mps <= max(told) + room
