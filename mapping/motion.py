"""Where a robot that goes on as it did will be: the guess for the next scan where there are no wheels to ask."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from mapping import se2

FloatArray = NDArray[np.float64]

_WINDOW = 20  # intervals that tell the sensor's pace
_MOST_GAPS = 2  # intervals in the window that may be of any length in a steady stream
_ALIKE = 0.3  # half of the others must be within so much of their median
_TOO_SHORT = 0.5  # in a steady stream a shorter interval, in periods, comes after a scan that was late
_GAP = 1.5  # in bursts an interval so many times the longest usual one is one without scans
_LONGEST_EXTRAPOLATION_S = 0.5  # so long after the last match its velocity says nothing any more


class ConstantVelocity:
    """Learns a velocity from scan to scan, in the times that the scans were taken at.

    Some logs carry the times at which scans came out of a full buffer: a burst within a millisecond, then nothing for
    half a second. Such stamps say how many scans a second there are, but nothing about a single interval, and a
    velocity over a millisecond of them would throw the robot across the building: then each scan counts as one period.
    """

    def __init__(self) -> None:
        self._intervals_s: deque[float] = deque(maxlen=_WINDOW)
        self._is_steady, self._period_s, self._longest_s = True, 0.0, 0.0
        self._newest_ns: int | None = None
        self.restart()

    def restart(self) -> None:
        """Forget the motion, but not the sensor's pace."""
        self._matched: FloatArray | None = None  # the pose of the last match
        self._since_match_s = 0.0
        self._twist: FloatArray = np.zeros(3)

    @property
    def twist(self) -> FloatArray:
        """The body twist (3,) in m/s and rad/s, as last learned."""
        return self._twist

    def twist_to(self, stamp_ns: int, pose: FloatArray) -> FloatArray:
        """Return the mean twist (3,) from the last match to a pose (3,) at a later stamp."""
        if self._matched is None:
            return np.zeros(3)
        return se2.log(se2.between(self._matched, pose)) / self.since_match_s(stamp_ns)

    def since_match_s(self, stamp_ns: int) -> float:
        """Return how long ago, at a stamp after the newest scan's, the last match was."""
        return self._since_match_s + self.interval_s(stamp_ns)

    def predict(self, pose: FloatArray, stamp_ns: int) -> FloatArray:
        """Return where a robot that was at a pose (3,) at the newest scan is at a later stamp."""
        left_s = max(_LONGEST_EXTRAPOLATION_S - self._since_match_s, 0.0)
        return se2.compose(pose, se2.exp(self._twist * min(self.interval_s(stamp_ns), left_s)))

    def enter(self, stamp_ns: int, pose: FloatArray, *, matched: bool) -> None:
        """Learn that the robot was at a pose (3,) at the next scan: as a match says, or else a guess."""
        if matched:
            self._twist, self._since_match_s = self.twist_to(stamp_ns, pose), 0.0
            self._matched = pose
        else:
            self._since_match_s = self.since_match_s(stamp_ns)
        if self._newest_ns is not None:
            self._learn_pace((stamp_ns - self._newest_ns) * 1e-9)
        self._newest_ns = stamp_ns

    def interval_s(self, stamp_ns: int) -> float:
        """Return the time from the newest scan to one at a stamp."""
        if self._newest_ns is None:
            return 0.0
        stated_s = (stamp_ns - self._newest_ns) * 1e-9
        if self._is_steady:
            return self._period_s if stated_s < _TOO_SHORT * self._period_s else stated_s
        return stated_s if stated_s > _GAP * self._longest_s else self._period_s

    def _learn_pace(self, interval_s: float) -> None:
        """Tell a steady stream, a few gaps aside, from bursts, in which the usual interval is no mean one."""
        self._intervals_s.append(interval_s)
        usual_s = np.sort(np.array(self._intervals_s))[: max(len(self._intervals_s) - _MOST_GAPS, 1)]
        middle_s = float(np.median(usual_s))
        alike = np.mean(np.abs(usual_s - middle_s) <= _ALIKE * middle_s) >= 0.5
        self._longest_s = float(usual_s[-1])
        self._is_steady = bool(alike and middle_s > _TOO_SHORT * np.mean(usual_s))
        self._period_s = middle_s if self._is_steady else float(np.mean(self._intervals_s))
