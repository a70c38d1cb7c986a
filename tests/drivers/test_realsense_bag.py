from __future__ import annotations

import dataclasses
import random
import struct
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.stores import ros1_noetic as ros1

from drivers.errors import RecordingError
from drivers.messages import DepthImage, Pinhole
from drivers.realsense_bag import RealsenseBag, is_ros1_bag
from drivers.recording_reader import open_recording, read_through

STORE = get_typestore(Stores.ROS1_NOETIC)
SENSOR = "/device_0/sensor_0"
STREAM = f"{SENSOR}/Depth_0"
CAMERA = Pinhole(4, 3, 390.5, 391.5, 1.25, 0.75)
SYSTEM_MS = "1534232519732.935547"
CAMERA_NS = 360_815_089_000


def counts(index):
    return (np.arange(12, dtype=np.uint16) + 1000 * index).reshape(3, 4)


def header(index, frame_id, stamp_ns):
    stamp = ros1.builtin_interfaces__msg__Time(*divmod(stamp_ns, 10**9))
    return ros1.std_msgs__msg__Header(169 + index, stamp, frame_id)


def image(index, frame_id="0", stamp_ns=CAMERA_NS):
    head = header(index, frame_id, stamp_ns + index * 10**8)
    return ros1.sensor_msgs__msg__Image(head, 3, 4, "mono16", 0, 8, counts(index).view(np.uint8).ravel())


def camera_info():
    k = np.array([390.5, 0, 1.25, 0, 391.5, 0.75, 0, 0, 1.0])
    roi = ros1.sensor_msgs__msg__RegionOfInterest(0, 0, 0, 0, do_rectify=False)
    return ros1.sensor_msgs__msg__CameraInfo(
        header(0, "", 0), 3, 4, "Brown Conrady", np.zeros(5), k, np.zeros(9), np.zeros(12), 0, 0, roi
    )


def value(key, text):
    return ros1.diagnostic_msgs__msg__KeyValue(key, text)


def write_bag(path, rows):
    """A ROS 1 bag with (topic, log time, message, bytes behind it) rows; returns the path."""
    with Writer(path) as writer:
        connections: dict[str, Any] = {}
        for topic, time_ns, body, trailer in rows:
            kind = body.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], time_ns, bytes(STORE.serialize_ros1(body, kind)) + trailer)
    return path


def rows(frame_id="0", trailer=b"", unit=0.0001, stamp_ns=CAMERA_NS, values=True):
    head = [
        (f"{STREAM}/info/camera_info", 1, camera_info(), b""),
        (f"{SENSOR}/option/Depth Units/value", 1, ros1.std_msgs__msg__Float32(unit), b""),
    ]
    frames = []
    for index in range(2):
        time_ns = 1000 + index * 10**8
        frames.append((f"{STREAM}/image/data", time_ns, image(index, frame_id, stamp_ns), trailer))
        texts = {
            "system_time": SYSTEM_MS if index == 0 else "1534232519900.0",
            "Frame Timestamp": "360815089",
            "Sensor Timestamp": "360811863",
        }
        if values:
            frames += [(f"{STREAM}/image/metadata", time_ns, value(*pair), b"") for pair in texts.items()]
    return head + frames


def read(path) -> list[DepthImage]:
    with RealsenseBag(path) as bag:
        messages = list(bag)
        assert bag.problems == []
    images = [message for message in messages if isinstance(message, DepthImage)]
    assert len(images) == len(messages)
    return images


def test_images_have_intrinsics_unit_number_and_the_wall_clock_of_mid_exposure(tmp_path):
    path = write_bag(tmp_path / "a.bag", rows())
    assert is_ros1_bag(path)
    images = read(path)
    for index, got in enumerate(images):
        assert np.array_equal(got.depth, counts(index))
        assert (got.unit_m, got.camera, got.sequence) == (0.0001, CAMERA, 169 + index)
        assert got.frame_id == "camera_depth_optical_frame"
    half_exposure_ns = (360815089 - 360811863) * 1000
    assert images[0].stamp_ns == pytest.approx(1534232519_732_935_547 - half_exposure_ns, abs=1000)
    assert images[1].stamp_ns - images[0].stamp_ns == 10**8  # by the camera's clock, not by when the host got them


def test_values_stored_before_their_image_are_found_too(tmp_path):
    shuffled = sorted(rows(), key=lambda row: (row[1], "metadata" not in row[0]))
    first, second = read(write_bag(tmp_path / "a.bag", rows())), read(write_bag(tmp_path / "b.bag", shuffled))
    assert [image.stamp_ns for image in first] == [image.stamp_ns for image in second]


def test_stamps_without_more_are_the_images_own(tmp_path):
    images = read(write_bag(tmp_path / "a.bag", rows(values=False)))
    assert [image.stamp_ns for image in images] == [CAMERA_NS, CAMERA_NS + 10**8]


def test_stamps_of_the_system_clock_are_not_moved(tmp_path):
    images = read(write_bag(tmp_path / "a.bag", rows(stamp_ns=1_600_000_000 * 10**9)))
    assert images[0].stamp_ns == 1_600_000_000 * 10**9 - 3_226_000


def test_the_undeclared_unit_behind_the_data_is_read(tmp_path):
    images = read(write_bag(tmp_path / "a.bag", rows(frame_id="1", trailer=struct.pack("<f", 0.00025))))
    assert [image.unit_m for image in images] == [0.00025] * 2
    assert np.array_equal(images[1].depth, counts(1))


def test_images_that_cannot_be_read_are_counted(tmp_path):
    damaged = rows()
    body = dataclasses.replace(image(1), encoding="rgb8")
    damaged.append((f"{STREAM}/image/data", 10**9, body, b""))
    with RealsenseBag(write_bag(tmp_path / "a.bag", damaged)) as bag:
        for _ in range(2):
            assert len(list(bag)) == 2
            assert len(bag.problems) == 1
            assert "1 image cannot be read: encoding 'rgb8'" in bag.problems[0]
        assert not bag.truncated


def test_images_without_intrinsics_are_counted(tmp_path):
    with RealsenseBag(write_bag(tmp_path / "a.bag", rows()[1:])) as bag:
        assert list(bag) == []
        assert bag.problems == [
            f"2 images cannot be read: no {STREAM}/info/camera_info before it: its intrinsics are unknown"
        ]


def test_table_of_contents_names_what_is_left_out(tmp_path):
    more = [*rows(), ("/device_0/sensor_1/Color_0/image/data", 5, image(0), b"")]
    with open_recording(write_bag(tmp_path / "a.bag", more)) as bag:
        assert (bag.depth_topic, bag.scan_topic, bag.has_raw) == (f"{STREAM}/image/data", None, False)
        assert bag.skipped == {"sensor_msgs/msg/Image": 1}
        assert sum(topic.count for topic in bag.topics) == len(more)
        with pytest.raises(RecordingError, match="no scans called '/scan'"):
            bag.messages("/scan")


def test_another_ros1_bag_is_named_and_refused(tmp_path):
    path = write_bag(tmp_path / "a.bag", [("/x", 1, ros1.std_msgs__msg__Float32(1.0), b"")])
    with pytest.raises(RecordingError, match="a ROS 1 bag; convert it to ROS 2 with rosbags-convert"):
        open_recording(path)
    with pytest.raises(RecordingError, match="a ROS 1 bag; convert it"):
        open_recording(write_bag(tmp_path / "b.bag", []))


def test_a_cut_bag_is_called_cut_and_a_hole_is_found_by_reading_through(tmp_path):
    whole = write_bag(tmp_path / "a.bag", rows()).read_bytes()
    cut, holed = tmp_path / "cut.bag", tmp_path / "holed.bag"
    cut.write_bytes(whole[:-40])
    with pytest.raises(RecordingError, match="was cut"):
        RealsenseBag(cut)
    at = whole.index(counts(1).tobytes())
    holed.write_bytes(whole[: at - 80] + bytes(80) + whole[at:])
    with RealsenseBag(holed) as recording:
        read_through(recording)
        assert recording.problems


def test_a_bag_cut_or_damaged_anywhere_is_read_as_far_as_it_goes_or_one_clear_line(tmp_path):
    data = write_bag(tmp_path / "a.bag", rows()).read_bytes()
    noise = random.Random(4)
    cuts = [data[:cut] for cut in [*range(13, 60), *noise.sample(range(60, len(data)), 100)]]
    for _ in range(200):
        flipped = bytearray(data)
        flipped[noise.randrange(13, len(data))] ^= 1 << noise.randrange(8)
        cuts.append(bytes(flipped))
    for content in cuts:
        (tmp_path / "b.bag").write_bytes(content)
        try:
            with open_recording(tmp_path / "b.bag") as bag:
                assert len(list(bag)) == 2 or bag.problems
        except RecordingError as error:
            assert "\n" not in str(error)  # noqa: PT017 - most damage of so small a file leaves nothing to read


@pytest.mark.real_data
def test_a_real_d435_recording(data_dir):
    path = data_dir / "rosbag_misc" / "librealsense_single_depth_color_640x480.bag"
    images = read(path)
    assert [image.sequence for image in images] == [169, 170]
    assert {image.unit_m for image in images} == {0.001}
    assert images[0].camera.fx == pytest.approx(390.43, abs=0.005)
    assert np.mean([(image.depth > 0).mean() for image in images]) == pytest.approx(0.93, abs=0.005)
    assert images[1].stamp_ns - images[0].stamp_ns == (360978539 - 360811863) * 1000
    median_m = np.median(images[0].depth[images[0].depth > 0]) * images[0].unit_m
    assert 0.3 < median_m < 10
