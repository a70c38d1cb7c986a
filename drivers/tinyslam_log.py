"""tinySLAM logs: the text format of the MINES rover (a Hokuyo URG-04LX and two wheel encoders), as a recording.

A line is one scan: numbers of the robot, of which the first is the time in us and two are the wheels' encoder counts,
then 682 ranges in mm. Two kinds are known, by how many numbers precede the ranges: 25 (counts of the left and the right
wheel are the 3rd and 4th) and 13 (the 2nd and 3rd, the right one's with its sign reversed). Sources: the readers and
the rover's dimensions in the test programs of tinySLAM (Steux and El Hamzaoui, "CoreSLAM: a SLAM algorithm in less than
200 lines of C code", ICARCV 2010). The layout of the beams is the answer to the PP command in Hokuyo's SCIP 2.0 manual
(URG-04LX: 1024 steps a turn, first 44, last 725, front 384, 600 rpm, 20 mm to 5600 mm); steps count counter-clockwise.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.errors import RecordingError
from drivers.messages import FloatArray, LaserScan, Message, Odometry, Transform
from drivers.recording_storage import TopicInfo
from drivers.sources import Closing
from drivers.text_log import TextLog, first_lines

LASER_FRAME, BASE_FRAME = "laser", "base_link"
SCAN_TOPIC, ODOMETRY_TOPIC = "ranges", "encoders"

STEPS_PER_TURN, FIRST_STEP, LAST_STEP, FRONT_STEP = 1024, 44, 725, 384
BEAMS = LAST_STEP - FIRST_STEP + 1
STEP_S = 0.1 / STEPS_PER_TURN
SCAN_AGE_S = 0.12  # from the last sample to the line's counts; found where the laser's turning fits the wheels' best
RANGE_MIN_M, RANGE_MAX_M = 0.020, 5.600  # what is smaller than 20 mm is an error code

WHEEL_RADIUS_M = 0.077
AXLE_M = 0.306  # between the wheels, as the laser's turning has it in all three known logs; published is 0.330
COUNTS_PER_TURN = 2000
LASER_AHEAD_M = 0.145
_FASTEST_MPS = 5.0  # a wheel that seems faster had its counter reset
_LEAST_INTERVAL_S = 0.1  # lines that the logger wrote late follow each other closely
_CLOCK_STEPS = 2**32  # the us counter and the encoder counters are 32-bit integers


@dataclass(frozen=True, slots=True)
class _Layout:
    """Which of the numbers before the ranges are the wheels' counts, and their signs for driving forward."""

    left: int
    right: int
    right_sign: int


_LAYOUTS = {25: _Layout(2, 3, 1), 13: _Layout(1, 2, -1)}  # by how many numbers precede the ranges


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """One parsed line: time in us, counts (2,) of the left and right wheel, ranges (682,) in mm."""

    time_us: int
    counts: tuple[int, int]
    ranges_mm: FloatArray


class TinyslamLog(Closing):
    """An open log, plain or compressed; a MessageSource with a table of contents, see Recording.

    Raises RecordingError if not one line is whole.
    """

    has_raw = False
    depth_topic: str | None = None
    scan_topic: str | None = SCAN_TOPIC
    odometry_topic: str | None = ODOMETRY_TOPIC

    def __init__(self, path: Path) -> None:
        self.path = path
        self.metadata: dict[str, dict[str, str]] = {}
        self.skipped: dict[str, int] = {}
        self.truncated = False
        self._text = TextLog(path)
        self._faults: Counter[str] = Counter()
        scans = [scan.stamp_ns for scan in self if isinstance(scan, LaserScan)]
        if not scans:
            raise RecordingError(f"{path}: a tinySLAM log without one whole line: nothing to map")
        self.start_ns, self.end_ns = scans[0], scans[-1]
        self.topics = [
            TopicInfo(SCAN_TOPIC, "tinySLAM ranges", len(scans), decoded=True),
            TopicInfo(ODOMETRY_TOPIC, "tinySLAM encoders", len(scans), decoded=True),
        ]

    @property
    def problems(self) -> list[str]:
        """What is wrong with the file, one line each."""
        faults = [f"{count} {text}" for text, count in self._faults.items()]
        return faults + ([self._text.damage] if self._text.damage else [])

    def messages(self, scan_topic: str | None = None) -> Iterator[Message]:
        """Yield the laser's static transform, then each line's odometry and scan.

        The odometry has the line's stamp. The scan's samples were taken before it: the last of them SCAN_AGE_S earlier.
        """
        if scan_topic not in (None, SCAN_TOPIC):
            raise RecordingError(f"{self.path}: no scans called {scan_topic!r} in a tinySLAM log; it has {SCAN_TOPIC}")
        wheels = _Wheels()
        upright = np.array([0.0, 0.0, 0.0, 1.0])
        static = Transform(0, BASE_FRAME, LASER_FRAME, np.array([LASER_AHEAD_M, 0.0, 0.0]), upright, static=True)
        first = True
        for line in self._whole_lines():
            odometry, reset = wheels.turn_to(line)
            if reset:
                self._faults["jumps of an encoder: its counter was reset"] += 1
            if first:
                first = False
                yield static
            yield odometry
            yield _scan(line, odometry.stamp_ns)

    def close(self) -> None:
        """Nothing is held open between readings."""

    def __iter__(self) -> Iterator[Message]:
        return self.messages()

    def _whole_lines(self) -> Iterator[_Line]:
        """Yield the lines that parse and whose time rises; count the others anew."""
        self._faults.clear()
        latest_us = None
        for text in self._text.lines():
            if not text.strip():
                continue
            try:
                line = _parse(text)
            except ValueError:
                is_last = not text.endswith(b"\n")
                self.truncated |= is_last
                self._faults["line at the end of the file is cut off" if is_last else "lines do not parse"] += 1
                continue
            if latest_us is not None:
                time_us = latest_us + _signed(line.time_us - latest_us)
                if time_us <= latest_us:
                    self._faults["lines are not later than the one before"] += 1
                    continue
                line = _Line(time_us, line.counts, line.ranges_mm)
            latest_us = line.time_us
            yield line
        self.truncated |= bool(self._text.damage)


def is_tinyslam_log(path: Path) -> bool:
    """Whether one of the first lines is whole; only numbers may stand in any of them."""
    return any(_is_whole(line) for line in first_lines(path))


def beam_angles() -> FloatArray:
    """Return the directions (682,) in rad of the beams, rising: -119.5 to 119.9 deg, 0 = ahead."""
    steps = np.arange(FIRST_STEP, LAST_STEP + 1)
    return np.asarray((steps - FRONT_STEP) * (2.0 * math.pi / STEPS_PER_TURN), dtype=np.float64)


class _Wheels:
    """Odometry of a differential drive from its encoder counts: dead reckoning from the first line on."""

    def __init__(self) -> None:
        self._last: _Line | None = None
        self._pose = np.zeros(3)

    def turn_to(self, line: _Line) -> tuple[Odometry, bool]:
        """Return the odometry at the line, and whether a counter jumped (the robot then counts as standing)."""
        stamp_ns = line.time_us * 1000
        last, self._last = self._last, line
        if last is None:
            return Odometry(stamp_ns, self._pose, np.zeros(3)), False
        elapsed_s = (line.time_us - last.time_us) * 1e-6
        metres_per_count = 2.0 * math.pi * WHEEL_RADIUS_M / COUNTS_PER_TURN
        left, right = (
            _signed(now - before) * metres_per_count for now, before in zip(line.counts, last.counts, strict=True)
        )
        if max(abs(left), abs(right)) > _FASTEST_MPS * max(elapsed_s, _LEAST_INTERVAL_S):
            return Odometry(stamp_ns, self._pose, np.zeros(3)), True
        forward, turn = (left + right) / 2.0, (right - left) / AXLE_M
        x, y, yaw = self._pose.tolist()
        middle = yaw + turn / 2.0
        chord = forward * float(np.sinc(turn / (2.0 * math.pi)))
        self._pose = np.array([x + chord * math.cos(middle), y + chord * math.sin(middle), yaw + turn])
        return Odometry(stamp_ns, self._pose, np.array([forward, 0.0, turn]) / elapsed_s), False


def _signed(difference: int) -> int:
    """Return the difference of two 32-bit counters the short way round."""
    return (difference + _CLOCK_STEPS // 2) % _CLOCK_STEPS - _CLOCK_STEPS // 2


def _is_whole(text: bytes) -> bool:
    try:
        _parse(text)
    except ValueError:
        return False
    return True


def _parse(text: bytes) -> _Line:
    """Return the line; raises ValueError for one that is not whole."""
    fields = text.split()
    layout = _LAYOUTS.get(len(fields) - BEAMS)
    if layout is None:
        expected = " or ".join(str(count + BEAMS) for count in sorted(_LAYOUTS))
        raise ValueError(f"{len(fields)} fields, {expected} expected")
    ranges = np.array(fields[-BEAMS:], dtype=np.float64)
    if not np.isfinite(ranges).all() or (ranges < 0).any():
        raise ValueError("a range is no distance")
    counts = int(fields[layout.left]), layout.right_sign * int(fields[layout.right])
    return _Line(int(fields[0]), counts, ranges)


def _scan(line: _Line, stamp_ns: int) -> LaserScan:
    """Return the scan of a line that was written at stamp_ns."""
    before_s = SCAN_AGE_S + (BEAMS - 1) * STEP_S
    return LaserScan(
        stamp_ns=stamp_ns - round(before_s * 1e9),
        angles_rad=beam_angles(),
        ranges_m=line.ranges_mm * 1e-3,
        offsets_s=np.asarray(np.arange(BEAMS) * STEP_S, dtype=np.float64),
        range_min_m=RANGE_MIN_M,
        range_max_m=RANGE_MAX_M,
        frame_id=LASER_FRAME,
    )
