"""Wheel odometry as a motion prior: poses between two messages by interpolation, and the twist over an interval."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from drivers.messages import Odometry
from mapping import se2

FloatArray = NDArray[np.float64]


class WheelOdometry:
    """The last seconds of odometry messages."""

    def __init__(self, keep_s: float = 10.0) -> None:
        self._keep_ns = round(keep_s * 1e9)
        self._stamps: deque[int] = deque()
        self._poses: deque[FloatArray] = deque()

    @property
    def latest_ns(self) -> int | None:
        """Stamp of the newest message, None before the first."""
        return self._stamps[-1] if self._stamps else None

    def add(self, message: Odometry) -> None:
        """Take in a message; one that is not newer than the last is ignored (a log may step back)."""
        if self._stamps and message.stamp_ns <= self._stamps[-1]:
            return
        self._stamps.append(message.stamp_ns)
        self._poses.append(message.pose)
        while self._stamps[0] < message.stamp_ns - self._keep_ns:
            self._stamps.popleft()
            self._poses.popleft()

    def covers(self, start_ns: int, end_ns: int) -> bool:
        """Whether messages lie on both sides of the interval."""
        return bool(self._stamps) and self._stamps[0] <= start_ns and end_ns <= self._stamps[-1]

    def motion(self, start_ns: int, end_ns: int) -> FloatArray:
        """Return the pose (3,) of the body at end_ns as seen at start_ns; both must be covered."""
        return se2.between(self._pose_at(start_ns), self._pose_at(end_ns))

    def _pose_at(self, stamp_ns: int) -> FloatArray:
        index = int(np.searchsorted(np.asarray(self._stamps, dtype=np.int64), stamp_ns))
        if self._stamps[index] == stamp_ns:
            return self._poses[index]
        before, after = self._poses[index - 1], self._poses[index]
        share = (stamp_ns - self._stamps[index - 1]) / (self._stamps[index] - self._stamps[index - 1])
        return se2.compose(before, se2.exp(se2.log(se2.between(before, after)) * share))
