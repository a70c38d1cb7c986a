from __future__ import annotations

import struct
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.stores import ros2_humble as ros

from drivers.depth_codec import (
    CAMERA_INFO_TYPE,
    COMPRESSED_TYPE,
    IMAGE_TYPE,
    DepthPairing,
    beside,
    decode_camera,
    depth_encoding,
    depth_parts,
    shortest_decimal,
)
from drivers.errors import RecordingError
from drivers.messages import DepthImage, Pinhole
from drivers.recording_storage import StoredMessage
from drivers.ros_store import header, to_cdr

STAMP_NS = 1_700_000_000_123_456_789
CAMERA = Pinhole(4, 3, 425.25, 426.5, 1.75, 0.5)
COUNTS = np.random.default_rng(2).integers(0, 65536, (3, 4), dtype=np.uint16)
IMAGE = DepthImage(STAMP_NS, COUNTS, 0.00025, CAMERA, sequence=70_000)
TOPIC = "/camera/depth/image_rect_raw"


def stored(image, time_ns=7, topic=TOPIC):
    return [StoredMessage(part.topic, part.type_name, time_ns, part.data) for part in depth_parts(image, topic)]


def read(messages, topic=TOPIC):
    pairing = DepthPairing(topic)
    return [image for message in messages for image in pairing.feed(message)]


def same(a, b):
    return np.array_equal(a.depth, b.depth) and all(
        getattr(a, name) == getattr(b, name) for name in ("stamp_ns", "unit_m", "camera", "frame_id", "sequence")
    )


def edited(message, edit):
    store = get_typestore(Stores.ROS2_HUMBLE)
    body: Any = store.deserialize_cdr(message.data, message.type_name)
    edit(body)
    return replace(message, data=bytes(store.serialize_cdr(body, message.type_name)))


@pytest.mark.parametrize("image", [IMAGE, replace(IMAGE, sequence=-1, unit_m=0.001), replace(IMAGE, sequence=0)])
def test_a_depth_image_survives_unchanged(image):
    (back,) = read(stored(image))
    assert same(back, image)
    assert back.depth.dtype == np.uint16


def test_the_image_is_16uc1_as_ros_reads_it():
    parts = {part.topic: part for part in depth_parts(IMAGE)}
    store = get_typestore(Stores.ROS2_HUMBLE)
    body: Any = store.deserialize_cdr(parts[TOPIC].data, IMAGE_TYPE)
    assert (body.encoding, body.height, body.width, body.step, body.is_bigendian) == ("16UC1", 3, 4, 8, 0)
    assert body.data.tobytes() == COUNTS.astype("<u2").tobytes()
    info: Any = store.deserialize_cdr(parts["/camera/depth/camera_info"].data, CAMERA_INFO_TYPE)
    assert info.header.stamp == body.header.stamp
    assert info.header.frame_id == body.header.frame_id == "camera_depth_optical_frame"
    point = np.array([0.3, -0.2, 2.0, 1.0])
    u, v, w = info.p.reshape(3, 4) @ point
    assert (u / w, v / w) == pytest.approx((425.25 * 0.15 + 1.75, -426.5 * 0.1 + 0.5))


def test_other_writers_images_are_millimetres():
    messages = [message for message in stored(IMAGE) if message.type_name in (IMAGE_TYPE, CAMERA_INFO_TYPE)]
    (back,) = read(messages)
    assert (back.unit_m, back.sequence) == (0.001, -1)


def test_metres_are_not_scaled_by_the_unit_of_the_counts():
    def to_metres(body):
        body.encoding, body.step = "32FC1", 16
        body.data = np.full((3, 4), 1.5, np.float32).view(np.uint8).ravel()

    messages = stored(IMAGE)
    (back,) = read([*messages[:-1], edited(messages[-1], to_metres)])
    assert back.depth * back.unit_m == pytest.approx(np.full((3, 4), 1.5))


def test_compressed_depth_has_the_camera_info_of_its_namespace():
    data = np.frombuffer(struct.pack("<iff", 0, 0, 0) + cv2.imencode(".png", COUNTS)[1].tobytes(), np.uint8)
    body = ros.sensor_msgs__msg__CompressedImage(header(STAMP_NS, "cam"), "16UC1; compressedDepth", data)
    topic = TOPIC + "/compressedDepth"
    compressed = StoredMessage(topic, COMPRESSED_TYPE, 7, to_cdr(body, COMPRESSED_TYPE))
    assert beside(topic, "camera_info") == "/camera/depth/camera_info"
    (back,) = read([*stored(IMAGE)[:-1], compressed], topic)
    assert same(back, replace(IMAGE, frame_id="cam"))
    assert depth_encoding(compressed) == ("16UC1", "cam")


def test_intrinsics_are_those_of_the_images_frame_and_size():
    other_camera = replace(CAMERA, fx=99.0)
    other = replace(IMAGE, camera=other_camera, frame_id="color_frame")
    (back,) = read([*stored(IMAGE, topic="/a/image")[:1], *stored(other)[:2], stored(IMAGE)[-1]])
    assert back.camera == CAMERA  # same frame on another topic before another frame beside it
    (back,) = read([*stored(other)[:2], stored(IMAGE)[-1]])
    assert back.camera == other_camera
    larger = DepthImage(STAMP_NS, np.zeros((6, 8), np.uint16), 0.001, replace(CAMERA, width=8, height=6))
    with pytest.raises(RecordingError, match="no camera_info of frame 'camera_depth_optical_frame' and 4x3 px"):
        read([*stored(larger)[:2], stored(IMAGE)[-1]])


def test_intrinsics_that_change_hold_from_then_on():
    later = replace(IMAGE, camera=replace(CAMERA, fx=1.0), unit_m=0.001, sequence=-1)
    first, second = read([*stored(IMAGE), *stored(later, time_ns=8)])
    assert same(first, IMAGE)
    assert same(second, later)


def test_messages_before_the_first_camera_info_take_what_is_known_of_it():
    *companions, image = stored(IMAGE)
    pairing = DepthPairing(TOPIC, companions)
    (back,) = pairing.feed(image)
    assert same(back, IMAGE)


def test_p_comes_before_k_and_binning_scales_both():
    def rectified(body):
        body.k = np.eye(3).ravel()
        body.binning_x, body.binning_y, body.width, body.height = 2, 2, 8, 6

    info = decode_camera(edited(stored(IMAGE)[0], rectified))
    assert info.camera == Pinhole(4, 3, 425.25 / 2, 426.5 / 2, (1.75 + 0.5) / 2 - 0.5, (0.5 + 0.5) / 2 - 0.5)
    info = decode_camera(edited(stored(IMAGE)[0], lambda body: setattr(body, "p", np.zeros(12))))
    assert info.camera == CAMERA


@pytest.mark.parametrize("nonsense", [0.0, -1.0, np.nan, np.inf])
def test_a_camera_that_was_never_calibrated_is_refused(nonsense):
    def edit(body):
        body.p = np.zeros(12)
        body.k = np.array([nonsense, *body.k[1:]])

    with pytest.raises(RecordingError, match="/camera/depth/camera_info: intrinsics 4x3 px.*no camera"):
        decode_camera(edited(stored(IMAGE)[0], edit))


@pytest.mark.parametrize("unit_m", [0.0, -0.001, np.nan, np.inf])
def test_a_unit_that_is_no_length_is_refused(unit_m):
    with pytest.raises(RecordingError, match="depth unit"):
        read(stored(replace(IMAGE, unit_m=unit_m)))


@pytest.mark.parametrize(
    ("encoding", "topic", "expected"),
    [
        ("16UC1", "/x", True),
        ("32FC1", "/x", True),
        ("mono16", "/x/depth", True),
        ("mono16", "/ir/image", False),
        ("rgb8", "/x/depth", False),
    ],
)
def test_depth_is_told_by_its_encoding(encoding, topic, expected):
    message = replace(edited(stored(IMAGE)[-1], lambda body: setattr(body, "encoding", encoding)), topic=topic)
    kind = depth_encoding(message)
    assert (kind is not None) is expected
    assert kind in (None, (encoding, "camera_depth_optical_frame"))


def test_cut_messages_are_one_clear_line():
    for message in stored(IMAGE):
        with pytest.raises(RecordingError, match=message.topic):
            read([replace(message, data=message.data[:9])])
    assert depth_encoding(replace(stored(IMAGE)[-1], data=b"")) is None


@pytest.mark.parametrize("unit_m", [0.001, 0.00025, 0.0001, 1.0])
def test_the_number_meant_by_a_float32_is_found(unit_m):
    assert shortest_decimal(float(np.float32(unit_m))) == unit_m
