"""CARMEN logs: the text format of the classic laser data sets (Radish), as a recording.

Read are ODOM and the lines of the front laser: ROBOTLASER1, FLASER or RAWLASER1 (see carmen_lines); the rest, rear
lasers among it, is counted.
"""

from __future__ import annotations

import heapq
import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.carmen_lines import (
    LASER_FRAME,
    SCAN_NAMES,
    StatedLaser,
    count_readings,
    new_histogram,
    no_return_limit,
    parse_laser,
    parse_odometry,
    parse_parameters,
)
from drivers.errors import RecordingError
from drivers.messages import FloatArray, LaserScan, Message, Odometry, Transform
from drivers.recording_storage import TopicInfo
from drivers.sources import Closing
from drivers.text_log import TextLog, first_lines

BASE_FRAME = "base_link"
ODOMETRY_TOPIC = "ODOM"
_KNOWN = (b"FLASER", b"ODOM", b"PARAM", b"SYNC", b"RLASER", b"ROBOTLASER", b"RAWLASER", b"TRUEPOS")
_SORT_WINDOW = 1000
_TYPES = {name: f"CARMEN {name}" for name in (*SCAN_NAMES, ODOMETRY_TOPIC)}


class CarmenLog(Closing):
    """An open log, plain or compressed (.gz, .bz2); a MessageSource with a table of contents, see Recording.

    Where several kinds of lines hold scans, the first of SCAN_NAMES that has at least half as many as any other is
    taken. The laser's pose on the robot is the median difference of the two poses that a scan's line carries. Robot
    poses that never change are no odometry. Raises RecordingError if there are neither scans nor ODOM lines.
    """

    has_raw = False
    depth_topic: str | None = None

    def __init__(self, path: Path) -> None:
        self.path = path
        self.metadata: dict[str, dict[str, str]] = {}
        self._text = TextLog(path)
        survey = _Survey(self._text)
        counts = survey.counts
        if not survey.stamps:
            raise RecordingError(f"{path}: a CARMEN log without one whole line of {', '.join(_TYPES)}: nothing to map")
        self._broken = [f"{count} {name} lines do not parse" for name, count in survey.broken.items()]
        self._survey = survey
        self.start_ns, self.end_ns = survey.stamps
        most = max(counts[name] for name in SCAN_NAMES)
        self.scan_topic = next((name for name in SCAN_NAMES if most and 2 * counts[name] >= most), None)
        scans_have_odometry = self.scan_topic is not None and survey.moves(self.scan_topic)
        self.odometry_topic = ODOMETRY_TOPIC if counts[ODOMETRY_TOPIC] else None
        if self.odometry_topic is None and scans_have_odometry:
            self.odometry_topic = self.scan_topic
        self.topics = [
            TopicInfo(name, _TYPES.get(name, f"CARMEN {name}"), count, decoded=name in _TYPES)
            for name, count in sorted(counts.items())
        ]
        self.skipped = {topic.type: topic.count for topic in self.topics if not topic.decoded}

    @property
    def truncated(self) -> bool:
        """True if the file is cut off or damaged."""
        return bool(self._text.damage)

    @property
    def problems(self) -> list[str]:
        """What is wrong with the log, one line each."""
        return self._broken + ([self._text.damage] if self._text.damage else [])

    def messages(self, scan_topic: str | None = None) -> Iterator[Message]:
        """Yield the laser's static transform, then scans and odometry in the order of their stamps.

        Each scan comes with the robot's odometry at its own stamp, if its line tells that. Stamps that step back in the
        file, as loggers make them, are sorted within _SORT_WINDOW messages.
        """
        held = [topic.name for topic in self.topics if topic.name in SCAN_NAMES]
        if scan_topic is not None and scan_topic not in held:
            known = ", ".join(held) or "none"
            raise RecordingError(f"{self.path}: no scans called {scan_topic!r} in this CARMEN log; it has {known}")
        chosen = scan_topic or self.scan_topic
        x, y, yaw = self._survey.mount(chosen).tolist()
        quaternion = np.array([0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)])
        yield Transform(self.start_ns, BASE_FRAME, LASER_FRAME, np.array([x, y, 0.0]), quaternion, static=True)
        window: list[tuple[int, int, Message]] = []
        for number, message in enumerate(self._in_file_order(chosen)):
            heapq.heappush(window, (message.stamp_ns, number, message))
            if len(window) > _SORT_WINDOW:
                yield heapq.heappop(window)[2]
        while window:
            yield heapq.heappop(window)[2]

    def close(self) -> None:
        """Nothing is held open between readings."""

    def __iter__(self) -> Iterator[Message]:
        return self.messages()

    def _in_file_order(self, scan_name: str | None) -> Iterator[LaserScan | Odometry]:
        """Yield what the lines say, as they come."""
        limit = no_return_limit(self._survey.readings(scan_name))
        stated = self._survey.stated
        with_odometry = scan_name is not None and self._survey.moves(scan_name)
        for name, fields in _split(self._text):
            try:
                if name == scan_name:
                    line = parse_laser(name, fields)
                    own = line.odometry()
                    if own is not None and with_odometry:
                        yield own
                    yield line.scan(limit, stated)
                elif name == ODOMETRY_TOPIC:
                    yield parse_odometry(fields)
            except ValueError:
                continue  # counted by the survey


class _Survey:
    """What one reading of the whole log tells: counts by name, extreme stamps, laser poses, readings, parameters."""

    def __init__(self, text: TextLog) -> None:
        self.counts: Counter[str] = Counter()
        self.broken: Counter[str] = Counter()
        self.stamps: tuple[int, int] | None = None
        self._mounts: dict[str, list[FloatArray]] = {name: [] for name in SCAN_NAMES}
        self._robots: dict[str, tuple[FloatArray, bool]] = {}  # first robot pose, and whether it ever changed
        self._readings = {name: new_histogram() for name in SCAN_NAMES}
        parameters: dict[str, str] = {}
        for name, fields in _split(text):
            try:
                stamp = self._take(name, fields)
            except ValueError:
                self.broken[name] += 1
                continue
            self.counts[name] += 1
            if name == "PARAM" and len(fields) >= 2:
                parameters[fields[0].decode("ascii", "replace")] = fields[1].decode("ascii", "replace")
            if stamp is not None:
                low, high = self.stamps or (stamp, stamp)
                self.stamps = min(low, stamp), max(high, stamp)
        self.stated: StatedLaser = parse_parameters(parameters)

    def mount(self, scan_name: str | None) -> FloatArray:
        """Return the laser's pose (3,) on the robot, from the lines' poses or else the parameters."""
        mounts = self._mounts[scan_name] if scan_name is not None else []
        if mounts:
            return np.asarray(np.median(np.array(mounts), axis=0), dtype=np.float64)
        return np.array([np.nan_to_num(self.stated.ahead_m), 0.0, 0.0])

    def moves(self, scan_name: str) -> bool:
        """Whether the lines of this name carry robot poses that change."""
        return scan_name in self._robots and self._robots[scan_name][1]

    def readings(self, scan_name: str | None) -> NDArray[np.int64]:
        """Return the histogram of the readings of this name's lines."""
        return new_histogram() if scan_name is None else self._readings[scan_name]

    def _take(self, name: str, fields: list[bytes]) -> int | None:
        """Take in one line; return its stamp if it is of a kind that is read. Raises ValueError if it is broken."""
        if name == ODOMETRY_TOPIC:
            return parse_odometry(fields).stamp_ns
        if name not in SCAN_NAMES:
            return None
        line = parse_laser(name, fields)
        mount = line.laser_on_robot()
        if mount is not None:
            self._mounts[name].append(mount)
        if line.robot_pose is not None:
            first, moved = self._robots.get(name, (line.robot_pose, False))
            self._robots[name] = first, moved or not np.array_equal(first, line.robot_pose)
        count_readings(self._readings[name], line.ranges_m)
        return line.stamp_ns


def is_carmen_log(path: Path) -> bool:
    """Whether the file begins like a CARMEN log, compressed or not."""
    return any(line.startswith(_KNOWN) and b" " in line for line in first_lines(path))


def _split(text: TextLog) -> Iterator[tuple[str, list[bytes]]]:
    """Yield name and fields of each line that is no comment."""
    for line in text.lines():
        name, _, rest = line.strip().partition(b" ")
        if name and not name.startswith(b"#"):
            yield name.decode("ascii", "replace"), rest.split()
