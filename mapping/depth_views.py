"""The views of a depth camera that a drive's map is drawn from: few enough, each with its stamp.

A view is taken where the car has moved on since the last one, and a few times where it stands: frames of one place err
alike, and a thousand of them know no more than a handful. Whether the car has moved is known once a pose later than the
frame is, so frames wait for that; which ones are taken then depends on stamps and poses alone, not on when they came.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from mapping import se2
from mapping.depth_grid import DepthGridBuilder
from mapping.depth_sensor_model import DepthModel
from mapping.grid import OccupancyGrid
from mapping.trajectory import Trajectory
from mapping.virtual_scan import VirtualScan

FloatArray = NDArray[np.float64]

_MOST_POSES = 1000  # are kept for frames that come late


@dataclass(frozen=True, slots=True)
class ViewSettings:
    """Which frames become views, and which views are drawn.

    One is taken after distance_m or turn_rad of motion since the last; at the same place one each stand_s, up to
    most_standing of them. most_waiting frames wait for their pose, the oldest goes first. No view is drawn in a gap of
    more than gap_s between the poses before and after it.
    """

    distance_m: float = 0.05
    turn_rad: float = 0.05
    stand_s: float = 0.3
    most_standing: int = 5
    most_waiting: int = 60
    gap_s: float = 1.0


@dataclass(slots=True)
class ViewCounters:
    """What became of the frames: passed_over showed nothing new, dropped came too fast, unplaced have no pose."""

    frames: int = 0
    taken: int = 0
    passed_over: int = 0
    dropped: int = 0
    unplaced: int = 0


class DepthViews:
    """Takes frames and poses as they come, each in the order of their stamps, and keeps the views of the drive."""

    def __init__(self, settings: ViewSettings) -> None:
        self.counters = ViewCounters()
        self._settings = settings
        self._waiting: deque[tuple[int, Callable[[], VirtualScan]]] = deque()
        self._poses: deque[tuple[int, FloatArray]] = deque(maxlen=_MOST_POSES)
        self._last: tuple[int, FloatArray] | None = None  # stamp and pose of the last view
        self._standing = 0  # views taken at its place
        self._views: list[VirtualScan] = []

    def __len__(self) -> int:
        return len(self._views)

    def add_frame(self, stamp_ns: int, look: Callable[[], VirtualScan]) -> None:
        """Take in a frame; `look` makes its scan, and is called only if the frame is taken."""
        self.counters.frames += 1
        self._waiting.append((stamp_ns, look))
        if len(self._waiting) > self._settings.most_waiting:
            self._waiting.popleft()
            self.counters.dropped += 1
        self._choose()

    def add_pose(self, stamp_ns: int, pose: FloatArray) -> None:
        """Take in a pose (3,) in a frame in which it never jumps; one that is not newer than the last is ignored."""
        if self._poses and stamp_ns <= self._poses[-1][0]:
            return
        self._poses.append((stamp_ns, pose))
        self._choose()

    def finish(self) -> None:
        """Let go of frames later than the last pose; call once after the last message."""
        self.counters.unplaced += len(self._waiting)
        self._waiting.clear()

    def grid(self, trajectory: Trajectory, resolution_m: float, model: DepthModel) -> OccupancyGrid:
        """Return the map of all views whose poses the trajectory tells."""
        builder = DepthGridBuilder(resolution_m, model)
        stamps = np.array([view.stamp_ns for view in self._views], dtype=np.int64)
        placed = _is_covered(trajectory.stamps_ns, stamps, round(self._settings.gap_s * 1e9))
        if placed.any():
            poses = trajectory.at(stamps[placed])
            for pose, number in zip(poses, np.flatnonzero(placed).tolist(), strict=True):
                builder.add_scan(pose, self._views[number])
        return builder.grid()

    def _choose(self) -> None:
        """Decide on the frames that are not later than the newest pose."""
        while self._waiting and self._poses and self._waiting[0][0] <= self._poses[-1][0]:
            stamp_ns, look = self._waiting.popleft()
            while len(self._poses) > 1 and self._poses[1][0] <= stamp_ns:
                self._poses.popleft()
            if stamp_ns < self._poses[0][0]:
                self.counters.unplaced += 1
                continue
            around = [*islice(self._poses, 2)]
            around_ns, poses = np.array([each for each, _ in around]), np.array([each for _, each in around])
            pose = Trajectory(around_ns, poses).at(np.array([stamp_ns]))[0]
            if self._shows_something_new(stamp_ns, pose):
                self._views.append(look())
                self.counters.taken += 1
            else:
                self.counters.passed_over += 1

    def _shows_something_new(self, stamp_ns: int, pose: FloatArray) -> bool:
        settings = self._settings
        if self._last is not None:
            last_ns, last = self._last
            x, y, turn = se2.between(last, pose).tolist()
            if (x * x + y * y) ** 0.5 < settings.distance_m and abs(turn) < settings.turn_rad:
                is_due = stamp_ns - last_ns >= settings.stand_s * 1e9 and self._standing < settings.most_standing
                if is_due:
                    self._last, self._standing = (stamp_ns, last), self._standing + 1
                return is_due
        self._last, self._standing = (stamp_ns, pose), 1
        return True


def _is_covered(known_ns: NDArray[np.int64], stamps_ns: NDArray[np.int64], gap_ns: int) -> NDArray[np.bool_]:
    """Return for each stamp (M,) whether known ones (N,), rising, lie at or around it, less than gap_ns apart."""
    if len(known_ns) == 0:
        return np.zeros(len(stamps_ns), np.bool_)
    after = np.searchsorted(known_ns, stamps_ns)
    inside = (stamps_ns >= known_ns[0]) & (after < len(known_ns))
    after = np.minimum(after, len(known_ns) - 1)
    before = np.where(known_ns[after] == stamps_ns, after, np.maximum(after - 1, 0))
    return np.asarray(inside & (known_ns[after] - known_ns[before] <= gap_ns))
