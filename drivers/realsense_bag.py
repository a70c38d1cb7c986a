"""Depth in the .bag files of Intel's RealSense SDK (rs-record, RealSense Viewer), as a recording.

They are ROS 1 bags: /device_D/sensor_S/Depth_K/image/data (sensor_msgs/Image, mono16), .../info/camera_info,
.../image/metadata (one diagnostic_msgs/KeyValue per value, behind its image) and /device_D/sensor_S/option/Depth
Units/value. Where an image's frame_id is "1", that is a version: behind the data stands one float32 more, the depth
unit, which the message definition in the file does not mention. Source: librealsense, third-party/realsense-file and
src/media/ros.
"""

from __future__ import annotations

import re
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import groupby
from operator import itemgetter
from pathlib import Path

from rosbags.rosbag1 import Reader, ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.stores import ros1_noetic as ros1

from drivers.depth_codec import IMAGE_TYPE, pinhole, shortest_decimal
from drivers.depth_pixels import METRES_UNIT_M, raw_counts
from drivers.errors import RecordingError
from drivers.messages import DepthImage, Message, Pinhole
from drivers.recording_storage import StoredMessage, TopicInfo
from drivers.ros1_translation import Ros1Translation
from drivers.sources import Closing
from drivers.wording import counted

MAGIC = b"#ROSBAG V"
DEPTH_FRAME = "camera_depth_optical_frame"
_IMAGE = re.compile(r"(?P<sensor>.*)/Depth_\d+/image/data")
_STORE = get_typestore(Stores.ROS1_NOETIC)
_HEADER = struct.Struct("<IIII")  # sequence, s, ns, length of frame_id
_WALL_CLOCK_NS = 10**18  # a stamp this late counts from 1970, an earlier one from the start of the camera
_LONGEST_EXPOSURE_US = 1_000_000
_DAMAGE = (
    ReaderError,
    SerdeError,
    ValueError,
    TypeError,
    LookupError,
    ArithmeticError,
    AssertionError,
    struct.error,
    RuntimeError,
    EOFError,
    OSError,
    MemoryError,
)


class RealsenseBag(Closing):
    """An open .bag of the RealSense SDK; a MessageSource with a table of contents, see Recording.

    Raises RecordingError for a ROS 1 bag that cannot be read or was not written by the SDK with depth in it.
    """

    has_raw = False
    scan_topic: str | None = None
    odometry_topic: str | None = None

    def __init__(self, path: Path) -> None:
        self.path = path
        self.metadata: dict[str, dict[str, str]] = {}
        self._damage = ""
        self._undecodable: Counter[str] = Counter()
        self._reader = Reader(path)
        try:
            self._reader.open()
            topics = {name: (topic.msgtype or "", topic.msgcount) for name, topic in self._reader.topics.items()}
            self.start_ns, self.end_ns = (self._reader.start_time, self._reader.end_time) if topics else (0, 0)
        except _DAMAGE as error:
            self.close()
            why = "its index, at the end, is missing or damaged, as in a file that was cut"
            if not isinstance(error, ReaderError) or "index" not in _reason(error):
                why = _reason(error)
            raise RecordingError(f"{path}: a damaged ROS 1 bag: {why}; `rosbag reindex` may mend it") from error
        images = {name: count for name, (_, count) in topics.items() if _IMAGE.fullmatch(name) and count}
        if not images:
            self.close()
            raise RecordingError(
                f"{path}: a ROS 1 bag; convert it to ROS 2 with rosbags-convert (comes with rosbags): "
                "read as it is would be only depth that the RealSense SDK recorded"
            )
        self.depth_topic: str | None = max(images, key=lambda name: images[name])
        self._declared = images[self.depth_topic]
        self._places = _Places(self.depth_topic)
        self.topics = [
            TopicInfo(name, type_name, count, name in self._places.all) for name, (type_name, count) in topics.items()
        ]
        self.untranslated: Counter[str] = Counter()
        self._translation = Ros1Translation({link.msgtype: link.msgdef.data for link in self._reader.connections})
        skipped: Counter[str] = Counter()
        for topic in self.topics:
            skipped[topic.type] += 0 if topic.decoded else topic.count
        self.skipped = {name: count for name, count in skipped.items() if count}

    @property
    def truncated(self) -> bool:
        """True if the file is damaged."""
        return bool(self._damage)

    @property
    def problems(self) -> list[str]:
        """What is wrong with the file, as far as it was read, one line each."""
        undecodable = [f"{counted(count, 'image')} cannot be read: {why}" for why, count in self._undecodable.items()]
        return undecodable + ([self._damage] if self._damage else [])

    def messages(self, scan_topic: str | None = None) -> Iterator[Message]:
        """Yield the depth images in the order of the file.

        Their stamps are the middle of the exposure, where the file tells it. The camera's own clock is moved to the
        host's wall clock by the difference of the two at the first image. Raises RecordingError for any scan_topic.
        """
        if scan_topic is not None:
            raise RecordingError(f"{self.path}: no scans called {scan_topic!r}: a RealSense recording holds none")
        return self._images()

    def others(self) -> Iterator[StoredMessage]:
        """Yield all messages but the depth images as ROS 2 messages, at their log times.

        Types are translated by the definitions in the file; `untranslated` counts, by type, those that could not be.
        """
        self.untranslated.clear()
        wanted = [connection for connection in self._reader.connections if connection.topic != self._places.image]
        try:
            for connection, time_ns, raw in self._reader.messages(wanted) if wanted else ():
                name = connection.msgtype
                whole = raw[:-4] if name == IMAGE_TYPE and _has_trailer(raw) else raw
                try:
                    data = self._translation.to_cdr(whole, name)
                except ValueError:
                    self.untranslated[name] += 1
                else:
                    yield StoredMessage(connection.topic, name, time_ns, data)
        except _DAMAGE as error:
            self._damage = f"a part of the file cannot be read ({_reason(error)}); read as far as it goes"

    def schema_text(self, type_name: str) -> str:
        """Return the ros2msg definition of a type of `others`."""
        return self._translation.schema_text(type_name)

    def close(self) -> None:
        """Release the file; closing twice is allowed."""
        if self._reader.bio is not None:
            self._reader.close()

    def __iter__(self) -> Iterator[Message]:
        return self.messages()

    def _images(self) -> Iterator[DepthImage]:
        """Yield each image with the values that have its log time."""
        self._undecodable.clear()
        decoding = _Decoding(self._places)
        found = 0
        for _, together in groupby(self._raw_messages(), key=itemgetter(0)):
            images: list[bytes] = []
            values: dict[str, str] = {}
            for _, topic, raw in together:
                if topic == self._places.image:
                    images.append(raw)
                    found += 1
                elif topic == self._places.metadata:
                    values.update(_key_value(raw))
                else:
                    decoding.take(topic, raw)
            for raw in images:
                try:
                    image = decoding.image(raw, values)
                except (*_DAMAGE, RecordingError) as error:
                    self._undecodable[_reason(error)] += 1
                else:
                    yield image
        if found < self._declared and not self._damage:
            self._damage = f"{found} of its {self._declared} images are there"

    def _raw_messages(self) -> Iterator[tuple[int, str, bytes]]:
        """Yield log time, topic and bytes of what belongs to the depth images, up to the first damage."""
        wanted = [connection for connection in self._reader.connections if connection.topic in self._places.all]
        try:
            for connection, time_ns, raw in self._reader.messages(wanted):
                yield time_ns, connection.topic, raw
        except _DAMAGE as error:
            self._damage = f"a part of the file cannot be read ({_reason(error)}); read as far as it goes"


class _Places:
    """The topics that belong to one stream of depth images."""

    def __init__(self, image: str) -> None:
        match = _IMAGE.fullmatch(image)
        assert match is not None
        stream = image.removesuffix("/image/data")
        self.image = image
        self.metadata = f"{stream}/image/metadata"
        self.camera = f"{stream}/info/camera_info"
        self.units = tuple(f"{match['sensor']}/option/{name}/value" for name in ("Depth Units", "Depth_Units"))
        self.all = frozenset({self.image, self.metadata, self.camera, *self.units})


class _Decoding:
    """The intrinsics, the unit and the clock that hold for the next image."""

    def __init__(self, places: _Places) -> None:
        self._places = places
        self._camera: Pinhole | None = None
        self._unit_m = METRES_UNIT_M
        self._to_wall_ns: int | None = None

    def take(self, topic: str, raw: bytes) -> None:
        """Take in a message about the images; one that does not decode changes nothing."""
        if topic == self._places.camera:
            self._camera = _camera(raw)
        elif topic in self._places.units and len(raw) == 4:
            self._unit_m = shortest_decimal(struct.unpack("<f", raw)[0])

    def image(self, raw: bytes, values: Mapping[str, str]) -> DepthImage:
        """Return the depth image in a raw message and the values behind it; raises any of _DAMAGE."""
        sequence, seconds, nanoseconds, _ = _HEADER.unpack_from(raw)
        if _has_trailer(raw):
            raw, unit = raw[:-4], raw[-4:]
            self._unit_m = shortest_decimal(struct.unpack("<f", unit)[0])
        body = _STORE.deserialize_ros1(raw, IMAGE_TYPE)
        assert isinstance(body, ros1.sensor_msgs__msg__Image)
        if self._camera is None:
            raise RecordingError(f"no {self._places.camera} before it: its intrinsics are unknown")
        if self._unit_m <= 0:
            raise RecordingError(f"its depth unit is {self._unit_m} m")
        size = body.height, body.width
        return DepthImage(
            stamp_ns=self._stamp_ns(seconds * 10**9 + nanoseconds, values),
            depth=raw_counts(body.encoding, size, body.step, body.data, big=bool(body.is_bigendian)),
            unit_m=METRES_UNIT_M if body.encoding == "32FC1" else self._unit_m,
            camera=self._camera,
            frame_id=DEPTH_FRAME,
            sequence=sequence,
        )

    def _stamp_ns(self, sent_ns: int, values: Mapping[str, str]) -> int:
        """Return the wall-clock time of the middle of the exposure of an image that the camera began to send then."""
        if self._to_wall_ns is None and sent_ns < _WALL_CLOCK_NS and "system_time" in values:
            self._to_wall_ns = round(float(values["system_time"]) * 1000) * 1000 - sent_ns  # text of ms
        exposed_us = 0
        if "Sensor Timestamp" in values and "Frame Timestamp" in values:
            exposed_us = int(values["Sensor Timestamp"]) - int(values["Frame Timestamp"])
        if abs(exposed_us) > _LONGEST_EXPOSURE_US:
            exposed_us = 0
        return sent_ns + (self._to_wall_ns or 0) + exposed_us * 1000


def _has_trailer(raw: bytes) -> bool:
    """Tell whether a raw image has the depth unit behind its data."""
    return len(raw) > _HEADER.size and raw[12 : _HEADER.size + 1] == b"\1\0\0\0" + b"1"


def is_ros1_bag(path: Path) -> bool:
    """Whether the file begins like a ROS 1 bag."""
    try:
        with path.open("rb") as stream:
            return stream.read(len(MAGIC)) == MAGIC
    except OSError:
        return False


def _reason(error: Exception) -> str:
    """Return what an error says, on one line; some say nothing but their name."""
    return " ".join(str(error).split()) or type(error).__name__


def _camera(raw: bytes) -> Pinhole | None:
    try:
        body = _STORE.deserialize_ros1(raw, "sensor_msgs/msg/CameraInfo")
        assert isinstance(body, ros1.sensor_msgs__msg__CameraInfo)
        fx, cx, fy, cy = body.K[[0, 2, 4, 5]]
        return pinhole((body.width, body.height), (fx, fy, cx, cy), "camera_info")
    except (*_DAMAGE, RecordingError):
        return None


def _key_value(raw: bytes) -> dict[str, str]:
    try:
        body = _STORE.deserialize_ros1(raw, "diagnostic_msgs/msg/KeyValue")
    except _DAMAGE:
        return {}
    assert isinstance(body, ros1.diagnostic_msgs__msg__KeyValue)
    return {body.key: body.value}
