"""Faults put into a recorded log: what a real robot meets, at seeded instants, with the truth of the log left usable.

Pure functions from messages to messages. Where a fault moves stamps, the true instant of each scan is kept, so that
ground truth can still be looked up.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from drivers.messages import LaserScan, Odometry
from mapping import se2
from mapping.deskew import reference_offset_s
from mapping.trajectory import Trajectory
from tools.errors import ToolError

FloatArray = NDArray[np.float64]
Messages = Sequence[LaserScan | Odometry]
Window = tuple[int, int]  # first and last stamp in ns

_GAPS = 5
_LEAST_WAY_SHARE = 0.5  # of the mean speed: a fault while the robot stands still shows nothing
_TRIALS = 1000
_HOUR_NS = 3_600_000_000_000


@dataclass(frozen=True, slots=True, eq=False)
class FaultyLog:
    """Messages with a fault, and how long the log was disturbed: `windows` in the log's own time.

    true_ns: stamp of a pose as the faulty log has it -> stamp in the sound log, where the two differ.
    """

    messages: list[LaserScan | Odometry]
    windows: list[Window]
    true_ns: dict[int, int] = field(default_factory=dict)

    def in_true_time(self, trajectory: Trajectory) -> Trajectory:
        """Return a trajectory of the faulty log with the stamps of the sound one."""
        stamps = np.array([self.true_ns.get(stamp, stamp) for stamp in trajectory.stamps_ns.tolist()], dtype=np.int64)
        order = np.argsort(stamps, kind="stable")
        return Trajectory(stamps[order], trajectory.poses[order])


Fault = Callable[[Messages, Trajectory, np.random.Generator], FaultyLog]


def missing_scans(messages: Messages, driven: Trajectory, random: np.random.Generator) -> FaultyLog:
    """Drop all scans of 2 s, five times; wheel odometry goes on."""
    windows = _windows(driven, 2.0, _GAPS, random)
    kept = [m for m in messages if not (isinstance(m, LaserScan) and _is_in(m.stamp_ns, windows))]
    return FaultyLog(kept, windows)


def missing_everything(messages: Messages, driven: Trajectory, random: np.random.Generator) -> FaultyLog:
    """Drop scans and odometry of 2 s, five times: the wheels' way in the meantime is in the next message."""
    windows = _windows(driven, 2.0, _GAPS, random)
    return FaultyLog([m for m in messages if not _is_in(m.stamp_ns, windows)], windows)


def no_odometry(messages: Messages, _driven: Trajectory, _random: np.random.Generator) -> FaultyLog:
    """Drop all wheel odometry."""
    return FaultyLog([m for m in messages if isinstance(m, LaserScan)], [])


def blinded(messages: Messages, driven: Trajectory, random: np.random.Generator) -> FaultyLog:
    """Let the laser see nothing for 10 s: scans come, without one measurement."""
    windows = _windows(driven, 10.0, 1, random)
    return FaultyLog([_with_share(m, 0.0, random) if _is_in(m.stamp_ns, windows) else m for m in messages], windows)


def blinded_without_odometry(messages: Messages, driven: Trajectory, random: np.random.Generator) -> FaultyLog:
    """The same where there are no wheels either: nothing tells how far the robot went."""
    return blinded([m for m in messages if isinstance(m, LaserScan)], driven, random)


def glass(messages: Messages, _driven: Trajectory, random: np.random.Generator) -> FaultyLog:
    """Take away 30 % of the measurements of every scan, in sectors as glass doors and panes do."""
    return FaultyLog([_with_share(m, 0.7, random) for m in messages], [])


def glass_corridor(messages: Messages, driven: Trajectory, random: np.random.Generator) -> FaultyLog:
    """Take away 60 % of the measurements in a stretch of 60 s, and 30 % elsewhere."""
    windows = _windows(driven, 60.0, 1, random)
    return FaultyLog([_with_share(m, 0.4 if _is_in(m.stamp_ns, windows) else 0.7, random) for m in messages], windows)


def kidnapped(messages: Messages, driven: Trajectory, random: np.random.Generator) -> FaultyLog:
    """Cut out a minute's drive; the wheels say that the robot stood still, and the clock shows the minute."""
    window = _longest_carry(driven, 60.0, random)
    return FaultyLog(_frozen(messages, window), [window])


def kidnapped_in_no_time(messages: Messages, driven: Trajectory, random: np.random.Generator) -> FaultyLog:
    """Cut out a minute's drive so that no gap shows: clock and wheels go on as if nothing had happened."""
    window = _longest_carry(driven, 60.0, random)
    later = [m.stamp_ns for m in messages if isinstance(m, LaserScan) and m.stamp_ns > window[1]]
    before = [m.stamp_ns for m in messages if isinstance(m, LaserScan) and m.stamp_ns < window[0]]
    if not later or len(before) < 2:
        raise ToolError("the log is too short to cut a minute out of it")
    step_ns = int(np.median(np.diff(before)))
    return _shifted(_frozen(messages, window), window[1], before[-1] + step_ns - later[0], window)


def clock_forward(messages: Messages, driven: Trajectory, random: np.random.Generator) -> FaultyLog:
    """Let the clock jump by an hour."""
    window = _windows(driven, 1.0, 1, random)[0]
    return _shifted(messages, window[0], _HOUR_NS, (window[0], window[0]))


def clock_back(messages: Messages, driven: Trajectory, random: np.random.Generator) -> FaultyLog:
    """Let the clock jump back by 5 s."""
    window = _windows(driven, 5.0, 1, random)[0]
    return _shifted(messages, window[0], -5_000_000_000, window)


FAULTS: dict[str, Fault] = {
    "scans missing for 2 s, 5 times": missing_scans,
    "scans and odometry missing, 5 times": missing_everything,
    "no odometry": no_odometry,
    "laser blind for 10 s": blinded,
    "laser blind for 10 s, no odometry": blinded_without_odometry,
    "glass: 30 % invalid": glass,
    "glass: 60 % invalid for 60 s": glass_corridor,
    "kidnapped, 60 s pass": kidnapped,
    "kidnapped, no time passes": kidnapped_in_no_time,
    "clock jumps by +1 h": clock_forward,
    "clock jumps by -5 s": clock_back,
}


def _is_in(stamp_ns: int, windows: Sequence[Window]) -> bool:
    return any(first <= stamp_ns <= last for first, last in windows)


def _windows(driven: Trajectory, seconds: float, count: int, random: np.random.Generator) -> list[Window]:
    """Return windows that do not overlap, after the first and before the last tenth, in which the robot drives."""
    first_ns, last_ns = int(driven.stamps_ns[0]), int(driven.stamps_ns[-1])
    tenth_ns, length_ns = (last_ns - first_ns) // 10, round(seconds * 1e9)
    least_m = _LEAST_WAY_SHARE * driven.length_m * length_ns / (last_ns - first_ns)
    windows: list[Window] = []
    for _ in range(_TRIALS if last_ns - first_ns > 3 * length_ns else 0):
        start = int(random.integers(first_ns + tenth_ns, last_ns - tenth_ns - length_ns))
        window = (start, start + length_ns)
        apart = all(start > last + length_ns or start + length_ns < first - length_ns for first, last in windows)
        if apart and _way_m(driven, window) >= least_m:
            windows.append(window)
        if len(windows) == count:
            return sorted(windows)
    raise ToolError(f"the log has no {count} stretches of {seconds:g} s in which the robot drives: take a longer one")


def _longest_carry(driven: Trajectory, seconds: float, random: np.random.Generator) -> Window:
    """Return, of a few windows, the one over which the robot gets farthest from where it was."""
    few = [_windows(driven, seconds, 1, random)[0] for _ in range(5)]
    ends = [driven.at(np.array(window, dtype=np.int64)) for window in few]
    return few[int(np.argmax([np.hypot(*(last - first)[:2]) for first, last in ends]))]


def _way_m(driven: Trajectory, window: Window) -> float:
    first, last = np.searchsorted(driven.stamps_ns, window)
    return float(np.hypot(*np.diff(driven.poses[first : last + 1, :2], axis=0).T).sum())


def _with_share(message: LaserScan | Odometry, share: float, random: np.random.Generator) -> LaserScan | Odometry:
    """Return a scan that keeps a share of its measurements: sectors of a dozen samples are lost as a whole."""
    if isinstance(message, Odometry):
        return message
    count = len(message.ranges_m)
    sector = max(1, min(12, count // 20))
    lost = np.repeat(random.random(-(-count // sector)) >= share, sector)[:count]
    return replace(message, ranges_m=np.where(lost, 0.0, message.ranges_m))


def _frozen(messages: Messages, window: Window) -> list[LaserScan | Odometry]:
    """Return the messages without those of a window; the wheels go on from where they were before it."""
    kept: list[LaserScan | Odometry] = []
    before: FloatArray | None = None
    T_before_after: FloatArray | None = None
    for message in messages:
        if window[0] <= message.stamp_ns <= window[1]:
            continue
        moved = message
        if isinstance(message, Odometry):
            if message.stamp_ns < window[0]:
                before = message.pose
            elif before is not None:
                if T_before_after is None:
                    T_before_after = se2.compose(before, se2.inverse(message.pose))
                moved = replace(message, pose=se2.compose(T_before_after, message.pose))
        kept.append(moved)
    return kept


def _shifted(messages: Messages, after_ns: int, shift_ns: int, window: Window) -> FaultyLog:
    """Return the messages with the stamps after an instant moved."""
    moved: list[LaserScan | Odometry] = []
    true_ns: dict[int, int] = {}
    for message in messages:
        if message.stamp_ns <= after_ns:
            moved.append(message)
            continue
        moved.append(replace(message, stamp_ns=message.stamp_ns + shift_ns))
        if isinstance(message, LaserScan):
            pose_ns = message.stamp_ns + round(reference_offset_s(message.offsets_s) * 1e9)
            true_ns[pose_ns + shift_ns] = pose_ns
    return FaultyLog(moved, [window], true_ns)
