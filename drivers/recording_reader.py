"""Open a recording, whatever it is stored in, and yield our messages in the order in which they were received.

Accepted: an MCAP file, a ROS 2 bag file (.db3), a folder of either, with or without metadata.yaml, the text logs of
CARMEN and tinySLAM, the .bag files of the RealSense SDK, and a folder of depth PNGs. Damaged or unfinished files are
read as far as they go.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Protocol

from typing_extensions import Self

from drivers.carmen_log import CarmenLog, is_carmen_log
from drivers.depth_codec import DepthPairing
from drivers.depth_folder import DepthFolder, is_depth_folder
from drivers.depth_pixels import METRES_UNIT_M
from drivers.depth_topics import find_depth
from drivers.errors import RecordingError
from drivers.messages import Message, Product, Recordable
from drivers.realsense_bag import RealsenseBag, is_ros1_bag
from drivers.recording_files import open_storages
from drivers.recording_storage import Storage, TopicInfo
from drivers.ros_codec import (
    IMU_TYPE,
    ODOMETRY_TYPE,
    PRODUCT_TYPES,
    RAW_TYPE,
    SCAN_TYPE,
    STREAM_TYPE,
    TRANSFORM_TYPE,
    decode,
    is_decodable,
)
from drivers.sources import Closing
from drivers.tinyslam_log import TinyslamLog, is_tinyslam_log
from drivers.wording import counted


class Recording(Protocol):
    """An open recording: a MessageSource with a table of contents.

    topics: all of them. metadata: the writer's records {name: {key: value}}. start_ns, end_ns: first and last log time.
    skipped: messages of types that nothing here decodes, counted by type. scan_topic: the LaserScan topic that is
    yielded (the one with the most messages), None where raw lidar bytes replace it or there is none. odometry_topic:
    likewise, /odom first. depth_topic: the topic whose depth images are yielded, None where there are none. Damage may
    show only while reading: see `truncated` and `problems` after the last message.
    """

    path: Path
    topics: list[TopicInfo]
    metadata: dict[str, dict[str, str]]
    start_ns: int
    end_ns: int
    skipped: dict[str, int]
    has_raw: bool
    scan_topic: str | None
    odometry_topic: str | None
    depth_topic: str | None

    @property
    def truncated(self) -> bool:
        """True if part of the recording is known to be lost."""
        ...

    @property
    def problems(self) -> list[str]:
        """What is wrong with the recording, as far as it was read, one line each."""
        ...

    def messages(self, scan_topic: str | None = None) -> Iterator[Message]:
        """Yield the messages in the order of their log times.

        scan_topic: take the LaserScans of this topic instead of the default, and instead of raw lidar bytes. Raises
        RecordingError if there is no such topic.
        """
        ...

    def close(self) -> None:
        """Release the files; closing twice is allowed."""
        ...

    def __iter__(self) -> Iterator[Message]: ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class BagRecording(Closing):
    """A recording made of MCAP or SQLite files; see Recording."""

    def __init__(self, path: Path, storages: Sequence[Storage], problems: Sequence[str] = ()) -> None:
        self.path = path
        self.storages = storages
        self._missing = tuple(problems)
        self._undecodable: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}
        self._depth = find_depth(storages)
        self.depth_topic = self._depth.image
        self.topics = _merged_topics(storages, self._depth.readable | self._depth.companions)
        self.metadata = {name: dict(values) for storage in storages for name, values in storage.metadata.items()}
        self.start_ns = min((storage.start_ns for storage in storages if storage.end_ns), default=0)
        self.end_ns = max(storage.end_ns for storage in storages)
        skipped: Counter[str] = Counter()
        for topic in self.topics:
            skipped[topic.type] += 0 if topic.decoded else topic.count
        self.skipped = {name: count for name, count in skipped.items() if count}
        self._raw_topics = {t.name for t in self.topics if t.type in (RAW_TYPE, STREAM_TYPE) and t.decoded and t.count}
        self.has_raw = {t.type for t in self.topics if t.name in self._raw_topics} == {RAW_TYPE, STREAM_TYPE}
        self.scan_topic = None if self.has_raw else _main_topic(self.topics, SCAN_TYPE)
        self.odometry_topic = _main_topic(self.topics, ODOMETRY_TYPE, first_choice="/odom")
        self._imu_topic = _main_topic(self.topics, IMU_TYPE, first_choice="/imu")

    def messages(self, scan_topic: str | None = None) -> Iterator[Message]:
        """Yield the messages in the order of their log times.

        scan_topic: take the LaserScans of this topic instead of the default, and instead of raw lidar bytes. Raises
        RecordingError if there is no such topic.
        """
        scans = [topic.name for topic in self.topics if topic.type == SCAN_TYPE]
        if scan_topic is not None and scan_topic not in scans:
            known = ", ".join(scans) or "none"
            raise RecordingError(f"{self.path}: no LaserScan topic {scan_topic!r}; LaserScan topics in it: {known}")
        chosen = {scan_topic or self.scan_topic, self.odometry_topic, self._imu_topic, self.depth_topic} - {None}
        chosen |= self._depth.companions
        chosen |= {topic.name for topic in self.topics if topic.type == TRANSFORM_TYPE}
        if scan_topic is None:
            chosen |= self._raw_topics
        return self._decoded({name for name in chosen if name is not None})

    @property
    def truncated(self) -> bool:
        """True if part of the recording is known to be lost."""
        return bool(self._missing) or any(storage.truncated for storage in self.storages)

    @property
    def problems(self) -> list[str]:
        """What is wrong with the recording, as far as it was read, one line each."""
        damage = [f"{storage.path.name}: {text}" for storage in self.storages for text in storage.problems]
        undecodable = [
            f"{topic}: {counted(count, 'message')} not decoded{self._reasons.get(topic, '')}"
            for topic, count in self._undecodable.items()
        ]
        return [*self._missing, *damage, *undecodable]

    def close(self) -> None:
        """Release the files; closing twice is allowed."""
        for storage in self.storages:
            storage.close()

    def __iter__(self) -> Iterator[Message]:
        return self.messages()

    def _decoded(self, topics: Collection[str]) -> Iterator[Message]:
        self._undecodable.clear()
        depth = DepthPairing(self._depth.image, self._depth.first)
        of_depth = {self._depth.image, *self._depth.companions}
        files = [storage.messages(topics) for storage in self.storages]
        for stored in heapq.merge(*files, key=lambda message: message.log_time_ns):
            try:
                if stored.topic in of_depth:
                    decoded: Sequence[Recordable] = depth.feed(stored)
                elif is_decodable(stored.type_name, stored.topic):
                    decoded = decode(stored.type_name, stored.data, stored.topic, stored.log_time_ns)
                else:
                    continue  # a second type on a topic that we read
            except RecordingError as error:
                self._undecodable[stored.topic] += 1
                if stored.topic in of_depth:
                    self._reasons.setdefault(stored.topic, f" ({error})")
                continue
            for message in decoded:
                if not isinstance(message, Product):
                    yield message


def open_recording(path: Path, *, intrinsics: Path | None = None, depth_unit_m: float = METRES_UNIT_M) -> Recording:
    """Open a recording for reading, whatever it is of what is accepted.

    intrinsics and depth_unit_m are for a folder of depth PNGs: a file with the camera's 3x3 matrix instead of the one
    in the folder, and metres per count.

    Raises RecordingError, with what was found and what is accepted, for anything that is not one or holds no message.
    """
    other = open_other(path, intrinsics=intrinsics, depth_unit_m=depth_unit_m)
    if other is not None:
        return other
    storages, problems = open_storages(path)
    recording = BagRecording(path, storages, problems)
    if not any(topic.count for topic in recording.topics):
        recording.close()
        why = f" ({recording.problems[0]})" if recording.problems else ""
        raise RecordingError(f"{path}: no messages in it{why}")
    return recording


def open_other(path: Path, *, intrinsics: Path | None = None, depth_unit_m: float = METRES_UNIT_M) -> Recording | None:
    """Open what is neither MCAP nor a bag of ROS 2; None if it is none of that. See open_recording."""
    if is_carmen_log(path):
        return CarmenLog(path)
    if is_tinyslam_log(path):
        return TinyslamLog(path)
    if is_ros1_bag(path):
        return RealsenseBag(path)
    if is_depth_folder(path):
        return DepthFolder(path, intrinsics=intrinsics, unit_m=depth_unit_m)
    return None


def read_through(recording: Recording) -> None:
    """Read all of a recording that no index vouches for, so that its damage is known; quick for MCAP and ROS 2 bags."""
    if not isinstance(recording, BagRecording):
        for _ in recording.messages():
            pass


def _merged_topics(storages: Sequence[Storage], of_depth: Collection[str]) -> list[TopicInfo]:
    counts: Counter[tuple[str, str]] = Counter()
    for storage in storages:
        for topic in storage.topics:
            counts[topic.name, topic.type_name] += topic.count
    return [
        TopicInfo(
            name,
            type_name,
            count,
            name in of_depth or (is_decodable(type_name, name) and type_name not in PRODUCT_TYPES),
        )
        for (name, type_name), count in counts.items()
    ]


def _main_topic(topics: Sequence[TopicInfo], type_name: str, first_choice: str = "") -> str | None:
    """Return the topic of this type with the most messages, or `first_choice` if that has any."""
    candidates = [topic for topic in topics if topic.type == type_name and topic.count]
    best = max(candidates, key=lambda topic: (topic.name == first_choice, topic.count), default=None)
    return best.name if best else None
