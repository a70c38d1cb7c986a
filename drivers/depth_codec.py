"""Depth images <-> the ROS messages of a depth camera, which stand on topics beside each other.

| topic | ROS type | content |
|---|---|---|
| /camera/depth/image_rect_raw | sensor_msgs/msg/Image | 16UC1: the camera's counts |
| /camera/depth/camera_info | sensor_msgs/msg/CameraInfo | its intrinsics |
| /camera/depth/depth_units | std_msgs/msg/Float64 | metres per count: 16UC1 alone would mean mm (REP-118) |
| /camera/depth/frame_number | std_msgs/msg/Int64 | the camera's frame number, where it has one |

Each frame has all of them, at one log time, the image last. Read are also mono16, 32FC1, either byte order, and
CompressedImage of the transport compressedDepth; in recordings of others an image has the intrinsics of its frame_id.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys.stores import ros2_humble as ros

from drivers.depth_pixels import METRES_UNIT_M, RAW_ENCODINGS, DepthCounts, compressed_counts, raw_counts
from drivers.errors import RecordingError
from drivers.messages import DepthImage, Pinhole
from drivers.recording_storage import StoredMessage
from drivers.ros_store import from_cdr, header, header_stamp_ns, to_cdr

DEPTH_TOPIC = "/camera/depth/image_rect_raw"
IMAGE_TYPE = "sensor_msgs/msg/Image"
COMPRESSED_TYPE = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO_TYPE = "sensor_msgs/msg/CameraInfo"
UNIT_TYPE = "std_msgs/msg/Float64"
UNIT_TYPES = (UNIT_TYPE, "std_msgs/msg/Float32")
NUMBER_TYPE = "std_msgs/msg/Int64"
IMAGE_TYPES = (IMAGE_TYPE, COMPRESSED_TYPE)


@dataclass(frozen=True, slots=True)
class RosPart:
    """One of the ROS messages that make up a depth image."""

    topic: str
    type_name: str
    data: bytes


@dataclass(frozen=True, slots=True, eq=False)
class DepthPixels:
    """An image message without what others say about it; encoding: 16UC1, mono16 or 32FC1."""

    stamp_ns: int
    frame_id: str
    encoding: str
    counts: DepthCounts


@dataclass(frozen=True, slots=True)
class CameraInfo:
    """The intrinsics that hold for one frame."""

    frame_id: str
    camera: Pinhole


def beside(image_topic: str, name: str) -> str:
    """Return the topic of this name in the namespace of an image, whatever the image's transport."""
    base = image_topic.removesuffix("/compressedDepth")
    return f"{base.rpartition('/')[0]}/{name}"


def depth_parts(image: DepthImage, topic: str = DEPTH_TOPIC) -> tuple[RosPart, ...]:
    """Return the ROS messages of a depth image, in the order in which they are to be written."""
    camera = image.camera
    stamped = header(image.stamp_ns, image.frame_id)
    body = ros.sensor_msgs__msg__Image(
        header=stamped,
        height=camera.height,
        width=camera.width,
        encoding="16UC1",
        is_bigendian=0,
        step=2 * camera.width,
        data=np.ascontiguousarray(image.depth, dtype="<u2").view(np.uint8).ravel(),
    )
    unit = to_cdr(ros.std_msgs__msg__Float64(image.unit_m), UNIT_TYPE)
    number = to_cdr(ros.std_msgs__msg__Int64(image.sequence), NUMBER_TYPE)
    parts = (
        RosPart(beside(topic, "camera_info"), CAMERA_INFO_TYPE, _encode_camera(camera, stamped)),
        RosPart(beside(topic, "depth_units"), UNIT_TYPE, unit),
        RosPart(beside(topic, "frame_number"), NUMBER_TYPE, number),
        RosPart(topic, IMAGE_TYPE, to_cdr(body, IMAGE_TYPE)),
    )
    return parts if image.sequence >= 0 else (*parts[:2], parts[3])


def _encode_camera(camera: Pinhole, stamped: ros.std_msgs__msg__Header) -> bytes:
    k = [camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0]
    p = [*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0]
    body = ros.sensor_msgs__msg__CameraInfo(
        header=stamped,
        height=camera.height,
        width=camera.width,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.array(k),
        r=np.eye(3).ravel(),
        p=np.array(p),
        binning_x=0,
        binning_y=0,
        roi=ros.sensor_msgs__msg__RegionOfInterest(0, 0, 0, 0, do_rectify=False),
    )
    return to_cdr(body, CAMERA_INFO_TYPE)


def _body(stored: StoredMessage) -> object:
    try:
        return from_cdr(stored.data, stored.type_name)
    except (SerdeError, ValueError, TypeError) as error:
        raise RecordingError(
            f"{stored.topic}: {len(stored.data)} bytes are not a {stored.type_name}: {error}"
        ) from error


def decode_camera(stored: StoredMessage) -> CameraInfo:
    """Return the intrinsics in a CameraInfo: those of the rectified image (P), or K where P is not filled in."""
    body = _body(stored)
    assert isinstance(body, ros.sensor_msgs__msg__CameraInfo)
    fx, cx, fy, cy = body.p[[0, 2, 5, 6]] if body.p[0] else body.k[[0, 2, 4, 5]]
    binned = max(body.binning_x, 1), max(body.binning_y, 1)
    camera = pinhole((body.width, body.height), (fx, fy, cx, cy), stored.topic)
    if binned == (1, 1):
        return CameraInfo(body.header.frame_id, camera)
    across, down = binned  # the middle of a binned pixel is the middle of those that it is made of
    smaller = Pinhole(
        width=camera.width // across,
        height=camera.height // down,
        fx=camera.fx / across,
        fy=camera.fy / down,
        cx=(camera.cx + 0.5) / across - 0.5,
        cy=(camera.cy + 0.5) / down - 0.5,
    )
    return CameraInfo(body.header.frame_id, smaller)


def pinhole(size: tuple[int, int], focus: tuple[float, float, float, float], where: str) -> Pinhole:
    """Return the camera of (width, height) and (fx, fy, cx, cy), px; raises RecordingError if there is none such."""
    fx, fy, cx, cy = (float(value) for value in focus)
    if not (min(size) > 0 and fx > 0 and fy > 0 and all(map(math.isfinite, (fx, fy, cx, cy)))):
        raise RecordingError(
            f"{where}: intrinsics {size[0]}x{size[1]} px, fx {fx}, fy {fy}, cx {cx}, cy {cy}: no camera"
        )
    return Pinhole(size[0], size[1], fx, fy, cx, cy)


def decode_pixels(stored: StoredMessage) -> DepthPixels:
    """Return the pixels of an image message; raises RecordingError if it does not hold depth."""
    body = _body(stored)
    assert isinstance(body, ros.sensor_msgs__msg__Image | ros.sensor_msgs__msg__CompressedImage)
    try:
        if isinstance(body, ros.sensor_msgs__msg__Image):
            encoding = body.encoding
            size = body.height, body.width
            counts = raw_counts(encoding, size, body.step, body.data, big=bool(body.is_bigendian))
        else:
            encoding = body.format.partition(";")[0].strip()
            counts = compressed_counts(body.format, body.data.tobytes())
    except ValueError as error:
        raise RecordingError(f"{stored.topic}: {error}") from error
    stamp_ns = header_stamp_ns(body.header) or stored.log_time_ns
    return DepthPixels(stamp_ns, body.header.frame_id, encoding, counts)


def depth_encoding(stored: StoredMessage) -> tuple[str, str] | None:
    """Return encoding and frame_id of an image message, None if it is not one of depth.

    mono16 may be anything: it counts as depth only where its topic says so.
    """
    try:
        body = _body(stored)
    except RecordingError:
        return None
    if isinstance(body, ros.sensor_msgs__msg__CompressedImage):
        encoding, _, transport = body.format.partition(";")
        return (encoding.strip(), body.header.frame_id) if "compressedDepth" in transport else None
    assert isinstance(body, ros.sensor_msgs__msg__Image)
    is_depth = body.encoding in RAW_ENCODINGS and (body.encoding != "mono16" or "depth" in stored.topic.lower())
    return (body.encoding, body.header.frame_id) if is_depth else None


class DepthPairing:
    """Puts the images of one topic together with the newest intrinsics and unit, and the frame number of their time."""

    def __init__(self, image_topic: str | None, first: Iterable[StoredMessage] = ()) -> None:
        """first: messages about images that may be recorded before them."""
        self._topic = image_topic or ""
        self._cameras: dict[str, CameraInfo] = {}
        self._unit_m = METRES_UNIT_M
        self._number = (-1, -1)  # log time, frame number
        for stored in first:
            with suppress(RecordingError):  # comes again in its place
                self.feed(stored)

    def feed(self, stored: StoredMessage) -> tuple[DepthImage, ...]:
        """Take in a message of any of the topics; return the depth image if it is one.

        Raises RecordingError if it does not decode, or if no intrinsics are of the image's frame and size.
        """
        if stored.type_name == CAMERA_INFO_TYPE:
            self._cameras[stored.topic] = decode_camera(stored)
        elif stored.topic == self._topic and stored.type_name in IMAGE_TYPES:
            return (self._image(stored),)
        elif stored.topic == beside(self._topic, "depth_units"):
            self._unit_m = _decode_unit(stored)
        elif stored.topic == beside(self._topic, "frame_number") and stored.type_name == NUMBER_TYPE:
            body = _body(stored)
            assert isinstance(body, ros.std_msgs__msg__Int64)
            self._number = stored.log_time_ns, body.data
        return ()

    def _image(self, stored: StoredMessage) -> DepthImage:
        pixels = decode_pixels(stored)
        rows, cols = pixels.counts.shape
        info = find_camera(self._cameras, stored.topic, pixels.frame_id, (cols, rows))
        if info is None:
            where = f"frame {pixels.frame_id!r} and {cols}x{rows} px"
            raise RecordingError(f"{stored.topic}: no camera_info of {where}: its intrinsics are unknown")
        image = DepthImage(
            stamp_ns=pixels.stamp_ns,
            depth=pixels.counts,
            unit_m=METRES_UNIT_M if pixels.encoding == "32FC1" else self._unit_m,
            camera=info.camera,
            frame_id=pixels.frame_id,
        )
        log_time_ns, number = self._number
        return replace(image, sequence=number) if log_time_ns == stored.log_time_ns else image


def find_camera(
    infos: Mapping[str, CameraInfo], image_topic: str, frame_id: str, size: tuple[int, int] | None = None
) -> CameraInfo | None:
    """Return the intrinsics for an image of this frame and size (width, height), by camera_info topic.

    Among those of the same frame the topic beside the image comes first; of another frame only that topic will do.
    """
    sibling = beside(image_topic, "camera_info")
    fitting = [
        (info.frame_id == frame_id, topic == sibling, info)
        for topic, info in infos.items()
        if size in (None, (info.camera.width, info.camera.height)) and (info.frame_id == frame_id or topic == sibling)
    ]
    return max(fitting, key=lambda candidate: candidate[:2], default=(False, False, None))[2]


def _decode_unit(stored: StoredMessage) -> float:
    """Return metres per count; of a Float32 the shortest decimal number that it stands for."""
    body = _body(stored)
    if isinstance(body, ros.std_msgs__msg__Float64):
        unit_m = body.data
    elif isinstance(body, ros.std_msgs__msg__Float32):
        unit_m = shortest_decimal(body.data)
    else:
        raise RecordingError(f"{stored.topic}: a {stored.type_name}, expected {' or '.join(UNIT_TYPES)}")
    if not (math.isfinite(unit_m) and unit_m > 0):
        raise RecordingError(f"{stored.topic}: depth unit {unit_m} m, expected a positive length")
    return unit_m


def shortest_decimal(value: float) -> float:
    """Return what was meant by a number that went through float32: 0.001, not 0.0010000000474974513."""
    return float(str(np.float32(value)))
