"""Record messages to an MCAP file from a thread of its own, so that no sensor ever waits for a disk."""

from __future__ import annotations

import os
import queue
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import BinaryIO

from drivers.depth_codec import depth_parts
from drivers.errors import RecordingError
from drivers.messages import DepthImage, LaserScan, RawChunk, Recordable
from drivers.recording_mcap import McapMessage, McapSink
from drivers.recording_scan import bin_count, bin_scan, even_scan
from drivers.ros_codec import default_topic, encode, encode_scan, is_latched, ros_type
from drivers.ros_store import schema_text, type_hash
from drivers.sources import Closing

# rosbag2's YAML of a QoS profile; history 1 = keep last, reliability 1 = reliable, liveliness 1 = automatic.
_QOS = """- history: 1
  depth: {depth}
  reliability: 1
  durability: {durability}
  deadline: {{sec: 2147483647, nsec: 4294967295}}
  lifespan: {{sec: 2147483647, nsec: 4294967295}}
  liveliness: 1
  liveliness_lease_duration: {{sec: 2147483647, nsec: 4294967295}}
  avoid_ros_namespace_conventions: false"""
_TRANSIENT_LOCAL, _VOLATILE = 1, 2


@dataclass(frozen=True, slots=True)
class RecordingReport:
    """What a recorder did: messages written and dropped per topic, size of the file, and why it stopped early if so."""

    path: Path
    written: Mapping[str, int]
    dropped: Mapping[str, int]
    bytes: int
    error: str | None


def create_file(path: Path) -> BinaryIO:
    """Create a new binary file; raises FileExistsError rather than overwrite one."""
    return path.open("xb")


class McapRecorder(Closing):
    """Writes what it is given to a new MCAP file (profile ros2, CDR), safely on disk every flush_period_s.

    metadata: {name: {key: value}}, written first, so that it survives a cut file. A disk error ends the recording and
    nothing else: `error` tells. While the disk does not keep up, up to queue_limit messages wait for it, and up to
    depth_limit depth images among them (0.8 MB each at 848x480; waiting_depth: how many do). `open_file` and `clock`
    (s, for the flush period only) can be replaced by tests. Raises RecordingError when the file exists or cannot be
    created.
    """

    def __init__(
        self,
        path: Path,
        *,
        metadata: Mapping[str, Mapping[str, str]],
        queue_limit: int = 20000,
        depth_limit: int = 150,
        flush_period_s: float = 1.0,
        open_file: Callable[[Path], BinaryIO] = create_file,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        try:
            self._stream = open_file(path)
        except FileExistsError as error:
            raise RecordingError(f"{path}: exists already; name a new file, none is overwritten") from error
        except OSError as error:
            raise RecordingError(f"{path}: cannot be created ({error.strerror or error})") from error
        self.path = path
        self.error: str | None = None
        self._metadata = metadata
        self._flush_period_s = flush_period_s
        self._clock = clock
        self._queue: queue.Queue[tuple[str, Recordable] | None] = queue.Queue(queue_limit)
        self._depth_limit = depth_limit
        self.waiting_depth = 0
        self._lock = threading.Lock()
        self._closing = False
        self._written: Counter[str] = Counter()
        self._dropped: Counter[str] = Counter()
        self._thread = threading.Thread(target=self._record, name="recorder", daemon=True)
        self._thread.start()

    def put(self, message: Recordable, topic: str | None = None) -> None:
        """Queue a message for its default topic or another; never waits: if the queue is full, drop and count it."""
        name = topic or default_topic(message)
        with self._lock:
            is_depth = isinstance(message, DepthImage)
            if self._closing or self.error is not None or (is_depth and self.waiting_depth >= self._depth_limit):
                self._dropped[name] += 1
                return
            try:
                self._queue.put_nowait((name, message))
                self.waiting_depth += is_depth
            except queue.Full:
                self._dropped[name] += 1

    def close(self) -> RecordingReport:
        """Write what is queued, finish the file and report; closing again reports again."""
        with self._lock:
            self._closing = True
        with suppress(queue.Full):  # a full queue keeps the thread awake anyway
            self._queue.put_nowait(None)
        self._thread.join()
        while not self._queue.empty():
            if item := self._queue.get_nowait():
                self._dropped[item[0]] += 1
        size = self.path.stat().st_size if self.path.exists() else 0
        return RecordingReport(self.path, dict(self._written), dict(self._dropped), size, self.error)

    def _record(self) -> None:
        """Body of the thread: whatever fails ends the recording, never the run."""
        unsaved: Counter[str] = Counter()
        try:
            try:
                self._write_queue(unsaved)
            finally:
                self._stream.close()
        except Exception as error:  # noqa: BLE001 - an unknown error must reach the report instead of dying here
            reason = error.strerror if isinstance(error, OSError) and error.strerror else repr(error)
            self.error = f"{self.path}: recording stopped: {reason}"
        self._dropped.update(unsaved)

    def _write_queue(self, unsaved: Counter[str]) -> None:
        """Write until closed; messages count as written once they are on the disk, till then they are in `unsaved`."""
        sink = McapSink(self._stream, library())
        for name, values in self._metadata.items():
            sink.add_metadata(name, values)
        channels = MessageChannels(sink)
        done = False
        while not done:
            sink.flush()
            _sync(self._stream)
            self._written.update(unsaved)
            unsaved.clear()
            done = self._write_until(self._clock() + self._flush_period_s, channels, unsaved)
        sink.finish()
        _sync(self._stream)
        self._written.update(unsaved)
        unsaved.clear()

    def _write_until(self, deadline_s: float, channels: MessageChannels, unsaved: Counter[str]) -> bool:
        """Write what comes until the deadline; True when the recorder is closing and the queue is empty."""
        while True:
            try:
                item = self._queue.get(timeout=max(0.0, deadline_s - self._clock()))
            except queue.Empty:
                return False
            if item is not None:
                unsaved[item[0]] += 1
                channels.write(*item)
                with self._lock:
                    self.waiting_depth -= isinstance(item[1], DepthImage)
            if self._closing and self._queue.empty():
                return True
            if self._clock() >= deadline_s:
                return False


class MessageChannels:
    """Serialises messages onto the channels of one file, which are declared as they come up.

    exact_scans: scans with constant steps are written as they are, not onto the bins of a full turn. start_ns: no
    message is taken to have been received earlier.
    """

    def __init__(self, sink: McapSink, *, exact_scans: bool = False, start_ns: int = 0) -> None:
        self._sink = sink
        self._exact_scans = exact_scans
        self._ids: dict[tuple[str, str], int] = {}
        self._schemas: dict[str, int] = {}
        self._scan_bins: dict[str, int] = {}
        self._counts: Counter[int] = Counter()
        self._newest_ns = start_ns

    def write(self, topic: str, message: Recordable) -> None:
        """Append a message; raises RecordingError for what no ROS message can hold, OSError on a full disk."""
        time_ns = self._log_time_ns(message)
        if isinstance(message, DepthImage):
            for part in depth_parts(message, topic):
                channel = self._channel(part.topic, part.type_name, latched=False)
                self._add(channel, time_ns, message.stamp_ns, part.data)
            return
        channel = self._channel(topic, ros_type(message), latched=is_latched(message))
        data = self._scan(topic, message) if isinstance(message, LaserScan) else encode(message)
        self._add(channel, time_ns, message.stamp_ns, data)

    def _scan(self, topic: str, scan: LaserScan) -> bytes:
        rays = even_scan(scan) if self._exact_scans else None
        if rays is None:
            rays = bin_scan(scan, self._scan_bins.setdefault(topic, bin_count(scan)))
        return encode_scan(scan, rays)

    def _add(self, channel: int, time_ns: int, stamp_ns: int, data: bytes) -> None:
        self._counts[channel] += 1
        self._sink.add_message(McapMessage(channel, self._counts[channel], time_ns, max(stamp_ns, 0), data))

    def _log_time_ns(self, message: Recordable) -> int:
        """Return the time of reception: for raw bytes their stamp as it is, for others none before the newest so far.

        So a reader gets the order in which messages were put, and a scan after the bytes that it was decoded from.
        """
        if isinstance(message, RawChunk):
            time_ns = message.stamp_ns
        elif isinstance(message, LaserScan) and message.offsets_s.size:
            time_ns = max(self._newest_ns, message.stamp_ns + round(float(message.offsets_s.max()) * 1e9))
        else:
            time_ns = max(self._newest_ns, message.stamp_ns)
        self._newest_ns = max(self._newest_ns, time_ns)
        return time_ns

    def _channel(self, topic: str, name: str, *, latched: bool) -> int:
        if (topic, name) not in self._ids:
            if name not in self._schemas:
                self._schemas[name] = self._sink.add_schema(name, "ros2msg", schema_text(name).encode())
            durability = _TRANSIENT_LOCAL if latched else _VOLATILE
            metadata = {
                "offered_qos_profiles": _QOS.format(depth=1 if latched else 10, durability=durability),
                "topic_type_hash": type_hash(name),
            }
            self._ids[topic, name] = self._sink.add_channel(topic, "cdr", self._schemas[name], metadata)
        return self._ids[topic, name]


def library() -> str:
    """Return what a recording says it was written by."""
    try:
        return f"mapfuse-robot {version('mapfuse-robot')}"
    except PackageNotFoundError:
        return "mapfuse-robot (not installed)"


def _sync(stream: BinaryIO) -> None:
    """Hand what is buffered to the operating system and wait until it is on the disk."""
    stream.flush()
    (os.fdatasync if hasattr(os, "fdatasync") else os.fsync)(stream.fileno())
