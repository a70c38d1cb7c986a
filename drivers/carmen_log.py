"""CARMEN logs: the text format of the classic laser data sets (Radish), as a recording.

A line is one message: name, content, IPC time stamp, host, logger time stamp. Read are FLASER (a front laser: number of
readings, readings in m, laser pose, robot odometry) and ODOM; the rest is counted. Source: the format comment at the
head of the logs themselves.
"""

from __future__ import annotations

import bz2
import gzip
import heapq
import io
import math
import zlib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

import numpy as np
from typing_extensions import Self

from drivers.errors import RecordingError
from drivers.messages import FloatArray, LaserScan, Message, Odometry, Transform
from drivers.recording_storage import TopicInfo

FIELD_OF_VIEW_RAD = math.pi  # of the SICK scanners that these logs were made with
NO_RETURN_M = 81.0  # and more: SICK's "no return"
RANGE_MAX_M = 80.0
LASER_FRAME, BASE_FRAME = "laser", "base_link"
SCAN_TOPIC, ODOMETRY_TOPIC = "FLASER", "ODOM"
_KNOWN = (b"FLASER", b"ODOM", b"PARAM", b"SYNC", b"RLASER", b"ROBOTLASER", b"RAWLASER", b"TRUEPOS")
_HEAD_BYTES = 65536
_SORT_WINDOW = 1000
_TYPES = {SCAN_TOPIC: "CARMEN FLASER", ODOMETRY_TOPIC: "CARMEN ODOM"}
_DAMAGE = (EOFError, OSError, zlib.error, gzip.BadGzipFile)


class CarmenLog:
    """An open log, plain or compressed (.gz, .bz2); a MessageSource with a table of contents, see Recording.

    The laser's pose on the robot is the median
    difference of the two poses that a FLASER line carries. Raises RecordingError if there is no FLASER or ODOM line.
    """

    has_raw = False

    def __init__(self, path: Path) -> None:
        self.path = path
        self.metadata: dict[str, dict[str, str]] = {}
        self.problems: list[str] = []
        self.truncated = False
        counts, stamps, mounts = self._survey()
        if not counts[SCAN_TOPIC] and not counts[ODOMETRY_TOPIC]:
            raise RecordingError(f"{path}: a CARMEN log without FLASER and ODOM lines: nothing to map")
        self.start_ns, self.end_ns = min(stamps), max(stamps)
        self.scan_topic = SCAN_TOPIC if counts[SCAN_TOPIC] else None
        self.odometry_topic = ODOMETRY_TOPIC if counts[ODOMETRY_TOPIC] else self.scan_topic
        self.topics = [
            TopicInfo(name, _TYPES.get(name, f"CARMEN {name}"), count, decoded=name in _TYPES)
            for name, count in sorted(counts.items())
        ]
        self.skipped = {topic.type: topic.count for topic in self.topics if not topic.decoded}
        self._mount = np.median(np.array(mounts), axis=0) if mounts else np.zeros(3)

    def messages(self, scan_topic: str | None = None) -> Iterator[Message]:
        """Yield the laser's static transform, then scans and odometry in the order of their stamps.

        Each scan comes with the robot's odometry at its own stamp. Stamps that step back in the file, as loggers make
        them, are sorted within _SORT_WINDOW messages.
        """
        if scan_topic not in (None, SCAN_TOPIC):
            raise RecordingError(f"{self.path}: no scans called {scan_topic!r} in a CARMEN log; it has {SCAN_TOPIC}")
        x, y, yaw = self._mount.tolist()
        quaternion = np.array([0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)])
        yield Transform(self.start_ns, BASE_FRAME, LASER_FRAME, np.array([x, y, 0.0]), quaternion, static=True)
        window: list[tuple[int, int, Message]] = []
        for number, message in enumerate(self._in_file_order()):
            heapq.heappush(window, (message.stamp_ns, number, message))
            if len(window) > _SORT_WINDOW:
                yield heapq.heappop(window)[2]
        while window:
            yield heapq.heappop(window)[2]

    def close(self) -> None:
        """Nothing is held open between readings."""

    def __iter__(self) -> Iterator[Message]:
        return self.messages()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _in_file_order(self) -> Iterator[Message]:
        """Yield what the lines say, as they come."""
        for line in self._lines():
            name, _, rest = line.strip().partition(b" ")
            fields = rest.split()
            try:
                if name == b"FLASER":
                    scan = _parse_scan(fields)
                    yield Odometry(scan.stamp_ns, np.array(fields[-6:-3], dtype=np.float64), np.zeros(3))
                    yield scan
                elif name == b"ODOM":
                    yield _parse_odometry(fields)
            except ValueError:
                continue  # counted by the survey

    def _survey(self) -> tuple[Counter[str], list[int], list[FloatArray]]:
        """Read everything once; return counts by name, the extreme stamps, and the laser poses on the robot."""
        counts: Counter[str] = Counter()
        broken: Counter[str] = Counter()
        stamps: list[int] = []
        mounts: list[FloatArray] = []
        for line in self._lines():
            name, _, rest = line.strip().partition(b" ")
            if not name or name.startswith(b"#"):
                continue
            fields = rest.split()
            try:
                if name == b"FLASER":
                    _parse_scan(fields)
                    mounts.append(_laser_on_robot(fields))
                elif name == b"ODOM":
                    _parse_odometry(fields)
            except ValueError:
                broken[name.decode("ascii", "replace")] += 1
                continue
            counts[name.decode("ascii", "replace")] += 1
            if name in (b"FLASER", b"ODOM"):
                stamp = parse_stamp_ns(fields[-3])
                stamps = [stamp] if not stamps else [min(stamps[0], stamp), max(stamps[-1], stamp)]
        self.problems += [f"{count} {name} lines do not parse" for name, count in broken.items()]
        return counts, stamps, mounts

    def _lines(self) -> Iterator[bytes]:
        """Yield the lines up to the end of the file or of what can be uncompressed."""
        with _open(self.path) as stream:
            try:
                yield from stream
            except _DAMAGE as error:
                self.truncated = True
                text = f"cut or damaged: {str(error).lower()}"
                if text not in self.problems:
                    self.problems.append(text)


def is_carmen_log(path: Path) -> bool:
    """Whether the file begins like a CARMEN log, compressed or not."""
    try:
        with _open(path) as stream:
            head = stream.read(_HEAD_BYTES)
    except _DAMAGE:
        return False
    return b"\0" not in head and any(line.startswith(_KNOWN) and b" " in line for line in head.splitlines())


def parse_stamp_ns(text: bytes) -> int:
    """Return decimal seconds as ns, exactly: relations name their scans by these digits."""
    whole, _, fraction = text.partition(b".")
    return int(whole) * 1_000_000_000 + int((fraction + b"000000000")[:9])


def _open(path: Path) -> io.BufferedIOBase:
    """Open a log whatever it is compressed with, by its first bytes."""
    with path.open("rb") as stream:
        head = stream.read(3)
    if head == b"BZh":
        return bz2.open(path, "rb")
    if head[:2] == b"\x1f\x8b":
        return gzip.open(path, "rb")
    return path.open("rb")


def _parse_scan(fields: list[bytes]) -> LaserScan:
    """Return the scan of a FLASER line without its name; raises ValueError for one that is not whole."""
    count = int(fields[0]) if fields else 0
    if count < 1 or len(fields) != count + 10:
        raise ValueError(f"{len(fields)} fields for {count} readings")
    ranges = np.array(fields[1 : count + 1], dtype=np.float64)
    return LaserScan(
        stamp_ns=parse_stamp_ns(fields[-3]),
        angles_rad=beam_angles(count),
        ranges_m=np.where(ranges >= NO_RETURN_M, np.inf, ranges),
        offsets_s=np.zeros(count),
        range_min_m=0.0,
        range_max_m=RANGE_MAX_M,
        frame_id=LASER_FRAME,
    )


def beam_angles(count: int) -> FloatArray:
    """Return the directions (count,) in rad of the beams over the field of view, rising.

    An odd number has a beam at either end (361 beams: every half degree from -90 to 90 deg); an even one lacks the last
    (180 beams: every degree from -90 to 89 deg).
    """
    intervals = count - 1 if count % 2 else count
    steps = np.arange(count, dtype=np.float64)
    return np.asarray(steps * (FIELD_OF_VIEW_RAD / max(intervals, 1)) - FIELD_OF_VIEW_RAD / 2.0, dtype=np.float64)


def _parse_odometry(fields: list[bytes]) -> Odometry:
    """Return the odometry of an ODOM line without its name; raises ValueError for one that is not whole."""
    if len(fields) != 9:
        raise ValueError(f"{len(fields)} fields, 9 expected")
    x, y, yaw, forward, turn = (float(field) for field in fields[:5])
    if not all(map(math.isfinite, (x, y, yaw, forward, turn))):
        raise ValueError("not finite")
    return Odometry(parse_stamp_ns(fields[6]), np.array([x, y, yaw]), np.array([forward, 0.0, turn]))


def _laser_on_robot(fields: list[bytes]) -> FloatArray:
    """Return the pose (3,) of the laser as the robot sees it, from a FLASER line's two poses."""
    lx, ly, lyaw, rx, ry, ryaw = (float(field) for field in fields[-9:-3])
    dx, dy = lx - rx, ly - ry
    cos, sin = math.cos(ryaw), math.sin(ryaw)
    turn = (lyaw - ryaw + math.pi) % (2.0 * math.pi) - math.pi
    return np.array([cos * dx + sin * dy, -sin * dx + cos * dy, turn])
