from __future__ import annotations

import contextlib
import errno
import io
import os
import subprocess
import sys
import threading
import time
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from drivers.errors import RecordingError
from drivers.messages import DepthImage, GridSnapshot, LaserScan, LidarStream, Odometry, Pinhole, RawChunk, Transform
from drivers.recording_reader import open_recording
from drivers.recording_writer import McapRecorder

START_NS = 1_700_000_000_000_000_000
METADATA = {"clock": {"offset_ns": "42"}, "robot": {"name": "car1", "config": '{"a": 1}'}}
STREAM = LidarStream(START_NS, "A2M8", "1.29", 7, "AB12", 115200, "Boost", 0x84, 126.0, 12.0)


def raw(index):
    return RawChunk(START_NS + index * 10_000_000, bytes([index % 256]) * 84)


def odometry(index):
    return Odometry(START_NS + index * 20_000_000, np.array([index, 0.0, 0.1]), np.zeros(3))


def scan(index, samples=400):
    angles = -np.linspace(0, 2 * np.pi, samples, endpoint=False)
    offsets = np.linspace(0, 0.1, samples, endpoint=False)
    return LaserScan(START_NS + index * 100_000_000, angles, np.full(samples, 2.5), offsets, 0.15, 12.0)


def one_of_each():
    turn = np.array([0, 0, 0, 1.0])
    return [
        STREAM,
        Transform(START_NS, "base_link", "laser", np.zeros(3), turn, static=True),
        *(raw(index) for index in range(20)),
        scan(0),
        odometry(12),
        Transform(START_NS + 250_000_000, "odom", "base_link", np.ones(3), turn),
        GridSnapshot(START_NS + 260_000_000, 0.05, np.zeros(3), np.full((4, 3), -1)),
    ]


def record(path, messages, **options):
    recorder = McapRecorder(path, metadata=METADATA, **options)
    for message in messages:
        recorder.put(message)
    return recorder.close()


class BlockedFile(io.FileIO):
    """A disk that takes nothing until it is released."""

    released = threading.Event()

    def write(self, data):
        assert self.released.wait(30)
        return super().write(data)


class FullFile(io.FileIO):
    """A disk with room for some bytes only."""

    room = 4000

    def write(self, data):
        if self.tell() + len(data) > self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(data)


def test_everything_is_written_and_reported(tmp_path):
    path = tmp_path / "run.mcap"

    report = record(path, one_of_each())

    topics = {"/lidar/stream", "/tf_static", "/scan", "/odom", "/tf", "/map"}
    assert report.written == {"/lidar/raw": 20} | dict.fromkeys(topics, 1)
    assert (report.dropped, report.error, report.path) == ({}, None, path)
    assert report.bytes == path.stat().st_size > 0


def test_the_file_is_a_ros2_mcap_for_other_readers(tmp_path):
    record(tmp_path / "run.mcap", one_of_each())

    with (tmp_path / "run.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        header = reader.get_header()
        summary = reader.get_summary()
        rows = [(schema, channel, message) for schema, channel, message in reader.iter_messages()]
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}

    assert header.profile == "ros2"
    assert header.library.startswith("mapfuse-robot ")
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(rows) == 26
    assert {(schema.encoding, channel.message_encoding) for schema, channel, _ in rows} == {("ros2msg", "cdr")}
    store = get_typestore(Stores.ROS2_HUMBLE)
    assert all(channel.metadata["topic_type_hash"] == store.hash_rihs01(schema.name) for schema, channel, _ in rows)
    assert metadata == METADATA
    times = [message.log_time for _, channel, message in rows if channel.topic == "/lidar/raw"]
    assert times == [raw(index).stamp_ns for index in range(20)]


def test_rosbags_reads_it_with_its_schemas_and_qos(tmp_path):
    record(tmp_path / "run.mcap", one_of_each())

    with AnyReader([tmp_path / "run.mcap"]) as reader:
        found: dict[str, Any] = {c.topic: reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()}
        latched = {
            c.topic for c in reader.connections if c.ext.offered_qos_profiles[0].durability.name == "TRANSIENT_LOCAL"
        }

    assert found["/odom"].pose.pose.position.x == 12
    assert found["/scan"].ranges.size == 400
    assert found["/map"].info.height == 4
    assert found["/lidar/raw"].data.tobytes() == raw(19).data
    assert latched == {"/lidar/stream", "/tf_static", "/map"}


def test_a_message_can_go_to_another_topic(tmp_path):
    with McapRecorder(tmp_path / "run.mcap", metadata={}) as recorder:
        recorder.put(raw(0), topic="/rear/lidar/raw")

    assert recorder.close().written == {"/rear/lidar/raw": 1}


def test_all_scans_of_a_stream_get_the_bins_of_its_first(tmp_path):
    record(tmp_path / "run.mcap", [scan(0, 790), scan(1, 700), scan(2, 900)])

    with open_recording(tmp_path / "run.mcap") as recording:
        assert [len(message.ranges_m) for message in recording] == [800, 800, 800]


def test_log_times_keep_the_order_in_which_messages_were_put(tmp_path):
    late = odometry(0)  # its stamp is older than the bytes that were read before it
    record(tmp_path / "run.mcap", [STREAM, raw(50), late, raw(60)])

    with open_recording(tmp_path / "run.mcap") as recording:
        kinds = [type(message).__name__ for message in recording]
        stamps = [message.stamp_ns for message in recording]

    assert kinds == ["LidarStream", "RawChunk", "Odometry", "RawChunk"]
    assert stamps[2] == late.stamp_ns


def test_depth_images_that_wait_for_the_disk_leave_room_for_the_rest(tmp_path):
    def depth(index):
        return DepthImage(START_NS + index, np.zeros((1, 2), np.uint16), 0.001, Pinhole(2, 1, 1.0, 1.0, 0.5, 0.5))

    BlockedFile.released.clear()
    recorder = McapRecorder(
        tmp_path / "run.mcap",
        metadata=METADATA,
        depth_limit=3,
        open_file=lambda path: io.BufferedWriter(BlockedFile(path, "xb")),
    )
    for index in range(30):
        recorder.put(depth(index))
        recorder.put(raw(index))
    BlockedFile.released.set()
    while recorder.waiting_depth:
        time.sleep(0.001)
    recorder.put(depth(40))
    report = recorder.close()

    topic = "/camera/depth/image_rect_raw"
    assert report.written == {"/lidar/raw": 30, topic: 4}
    assert report.dropped == {topic: 27}


def test_a_full_queue_drops_and_counts_per_topic_without_waiting(tmp_path):
    BlockedFile.released.clear()
    recorder = McapRecorder(
        tmp_path / "run.mcap",
        metadata=METADATA,
        queue_limit=10,
        open_file=lambda path: io.BufferedWriter(BlockedFile(path, "xb")),
    )
    for index in range(30):
        recorder.put(raw(index))
        recorder.put(odometry(index))
    BlockedFile.released.set()
    report = recorder.close()

    assert report.error is None
    assert report.written == {"/lidar/raw": 5, "/odom": 5}
    assert report.dropped == {"/lidar/raw": 25, "/odom": 25}
    with open_recording(tmp_path / "run.mcap") as recording:
        assert {topic.name: topic.count for topic in recording.topics} == report.written


def test_a_full_disk_ends_the_recording_and_nothing_else(tmp_path):
    path = tmp_path / "run.mcap"
    noise = np.random.default_rng(1)
    recorder = McapRecorder(
        path,
        metadata=METADATA,
        flush_period_s=0.0,
        open_file=lambda path: io.BufferedWriter(FullFile(path, "xb")),
    )
    sent = 0
    while recorder.error is None:
        recorder.put(RawChunk(START_NS + sent, noise.bytes(500)))
        sent += 1
        threading.Event().wait(0.001)
    recorder.put(odometry(1))
    report = recorder.close()

    assert report.error == f"{path}: recording stopped: No space left on device"
    assert report.written["/lidar/raw"] + report.dropped["/lidar/raw"] == sent
    assert report.dropped["/odom"] == 1
    assert report.written["/lidar/raw"] > 0
    with open_recording(path) as recording:
        chunks = list(recording.messages())
        assert recording.truncated
    assert len(chunks) >= report.written["/lidar/raw"]


def test_a_message_that_cannot_be_encoded_is_reported(tmp_path):
    report = record(tmp_path / "run.mcap", [odometry(0), RawChunk(-5, b"before 1970"), odometry(1)])

    assert report.error is not None
    assert "recording stopped" in report.error
    assert report.dropped == {"/odom": 2, "/lidar/raw": 1}


def test_closing_twice_reports_the_same_and_later_messages_are_dropped(tmp_path):
    recorder = McapRecorder(tmp_path / "run.mcap", metadata={})
    recorder.put(raw(0))
    first = recorder.close()

    assert recorder.close() == first
    recorder.put(raw(1))
    assert recorder.close().dropped == {"/lidar/raw": 1}
    assert recorder.close().written == {"/lidar/raw": 1}


def test_an_existing_file_is_never_overwritten(tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(b"precious")

    with pytest.raises(RecordingError, match="exists already"):
        McapRecorder(path, metadata={})

    assert path.read_bytes() == b"precious"


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(RecordingError, match=r"none/run\.mcap: cannot be created \(No such file or directory\)"):
        McapRecorder(tmp_path / "none" / "run.mcap", metadata={})


ENDLESS_RECORDER = """
import sys, threading
from pathlib import Path
from drivers.messages import RawChunk
from drivers.recording_writer import McapRecorder

recorder = McapRecorder(Path(sys.argv[1]), metadata={"robot": {"name": "car1"}}, flush_period_s=0.02)
for index in range(500):
    recorder.put(RawChunk(index * 10, bytes([index % 256]) * 84))
threading.Event().wait(60)
"""


def test_a_killed_process_leaves_all_that_was_flushed(tmp_path, project_root):
    path = tmp_path / "run.mcap"
    process = subprocess.Popen([sys.executable, "-c", ENDLESS_RECORDER, str(path)], cwd=project_root)
    try:
        give_up_s = time.monotonic() + 50
        found = 0
        while found < 500 and time.monotonic() < give_up_s:
            time.sleep(0.05)
            with contextlib.suppress(RecordingError), open_recording(path) as recording:
                found = sum(topic.count for topic in recording.topics)
    finally:
        process.kill()
        process.wait()

    with open_recording(path) as recording:
        messages = list(recording.messages())
        assert recording.truncated
        assert recording.metadata == {"robot": {"name": "car1"}}
    assert [message.stamp_ns for message in messages] == [index * 10 for index in range(500)]
