from __future__ import annotations

import contextlib
import itertools
import random
import sqlite3
from collections import Counter

import numpy as np
import pytest

from drivers.errors import RecordingError
from drivers.messages import (
    GridSnapshot,
    Imu,
    LaserScan,
    LidarStream,
    Odometry,
    PlannedPath,
    RawChunk,
    Transform,
    VelocityCommand,
)
from drivers.recording_reader import open_recording
from drivers.recording_writer import McapRecorder
from drivers.ros_codec import ODOMETRY_TYPE, SCAN_TYPE, encode

START_NS = 1_700_000_000_000_000_000
STREAM = LidarStream(START_NS, "A2M8", "1.29", 7, "AB12", 115200, "Boost", 0x84, 126.0, 12.0)


def raw(index):
    return RawChunk(START_NS + index * 10_000_000, index.to_bytes(40, "big"))


def odometry(index):
    return Odometry(START_NS + index * 20_000_000, np.array([index, 0.0, 0.1]), np.zeros(3))


def scan(index):
    angles = -np.linspace(0, 2 * np.pi, 400, endpoint=False)
    return LaserScan(START_NS + index * 100_000_000, angles, np.full(400, 2.5), np.zeros(400), 0.15, 12.0)


def record(path, *messages, metadata=None):
    """Write (topic, message) pairs or messages for their default topics; return the path."""
    ticks = itertools.count().__next__  # a clock that ends a chunk every few dozen messages
    with McapRecorder(path, metadata=metadata or {}, flush_period_s=60, clock=ticks) as recorder:
        for message in messages:
            topic, body = message if isinstance(message, tuple) else (None, message)
            recorder.put(body, topic)
    return path


def write_db3(path, topics, rows):
    """A .db3 with topics (id, name, type) and rows (topic id, time, data); return the path."""
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
        )
        database.executemany("INSERT INTO topics VALUES (?, ?, ?, 'cdr')", topics)
        database.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
        database.commit()
    return path


def kinds(messages):
    return Counter(type(message).__name__ for message in messages)


def test_table_of_contents_and_messages(tmp_path):
    static = Transform(START_NS, "base_link", "laser", np.zeros(3), np.array([0, 0, 0, 1.0]), static=True)
    grid = GridSnapshot(START_NS + 500_000_000, 0.05, np.zeros(3), np.zeros((2, 2), np.int8))
    way = PlannedPath(START_NS + 500_000_000, np.zeros((3, 3)))
    robot = {"robot": {"name": "x"}}
    path = record(tmp_path / "a.mcap", static, scan(0), scan(1), odometry(20), grid, way, metadata=robot)

    with open_recording(path) as recording:
        assert [(topic.name, topic.count, topic.decoded) for topic in recording.topics] == [
            ("/tf_static", 1, True),
            ("/scan", 2, True),
            ("/odom", 1, True),
            ("/map", 1, False),
            ("/plan", 1, False),
        ]
        assert recording.topics[1].type == SCAN_TYPE
        assert recording.metadata == robot
        assert (recording.start_ns, recording.end_ns) == (START_NS, START_NS + 500_000_000)
        assert (recording.scan_topic, recording.odometry_topic, recording.has_raw) == ("/scan", "/odom", False)
        assert recording.skipped == {"nav_msgs/msg/OccupancyGrid": 1, "nav_msgs/msg/Path": 1}
        messages = list(recording)
        assert (recording.truncated, recording.problems) == (False, [])

    assert [type(message) for message in messages] == [Transform, LaserScan, LaserScan, Odometry]
    assert isinstance(messages[0], Transform)
    assert messages[0].static


def test_raw_bytes_replace_the_scans_unless_these_are_asked_for(tmp_path):
    path = record(tmp_path / "a.mcap", STREAM, raw(0), raw(1), scan(0), odometry(9))

    with open_recording(path) as recording:
        assert recording.has_raw
        assert recording.scan_topic is None
        assert kinds(recording) == {"LidarStream": 1, "RawChunk": 2, "Odometry": 1}
        assert kinds(recording.messages("/scan")) == {"LaserScan": 1, "Odometry": 1}


def test_raw_bytes_that_nobody_can_decode_do_not_replace_the_scans(tmp_path):
    with open_recording(record(tmp_path / "a.mcap", raw(0), scan(0))) as recording:
        assert recording.scan_topic == "/scan"
        assert kinds(recording)["LaserScan"] == 1


def test_of_several_scan_topics_the_one_with_most_messages_is_read(tmp_path):
    path = record(tmp_path / "a.mcap", ("/front", scan(0)), ("/rear", scan(0)), ("/rear", scan(1)))

    with open_recording(path) as recording:
        assert recording.scan_topic == "/rear"
        assert kinds(recording) == {"LaserScan": 2}
        assert kinds(recording.messages("/front")) == {"LaserScan": 1}
        with pytest.raises(RecordingError, match="no LaserScan topic '/left'; LaserScan topics in it: /front, /rear"):
            recording.messages("/left")


def test_of_several_odometry_topics_one_is_read(tmp_path):
    path = record(tmp_path / "a.mcap", ("/ekf", odometry(0)), ("/ekf", odometry(1)), ("/odom", odometry(2)))

    with open_recording(path) as recording:
        assert recording.odometry_topic == "/odom"
        assert kinds(recording) == {"Odometry": 1}


def test_an_imu_is_read_and_what_was_commanded_is_not(tmp_path):
    felt = Imu(START_NS, np.array([0.0, 0.0, 0.5]), np.array([0.0, 0.0, 9.81]))
    told = VelocityCommand(START_NS + 1, 0.5, 0.1)
    path = record(tmp_path / "a.mcap", ("/imu", felt), ("/cmd_vel", told))

    with open_recording(path) as recording:
        assert kinds(recording) == {"Imu": 1}
        assert {topic.name: topic.decoded for topic in recording.topics} == {"/imu": True, "/cmd_vel": False}


def test_messages_that_do_not_decode_are_counted_and_the_rest_is_read(tmp_path):
    good = encode(odometry(1))
    rows = [(1, 10, good), (1, 20, good[:60]), (1, 30, b""), (1, 40, good), (2, 50, b"?")]
    path = write_db3(tmp_path / "a.db3", [(1, "/odom", ODOMETRY_TYPE), (2, "/fix", "sensor_msgs/msg/NavSatFix")], rows)

    with open_recording(path) as recording:
        for _ in range(2):
            assert kinds(recording) == {"Odometry": 2}
            assert recording.problems == ["/odom: 2 messages not decoded"]
        assert recording.skipped == {"sensor_msgs/msg/NavSatFix": 1}


def test_the_parts_of_a_split_recording_are_one(tmp_path):
    record(tmp_path / "run_0.mcap", STREAM, *(raw(index) for index in range(50)))
    record(tmp_path / "run_1.mcap", *(raw(index) for index in range(50, 80)))

    with open_recording(tmp_path) as recording:
        assert list(recording) == [STREAM, *(raw(index) for index in range(80))]
        assert recording.end_ns == raw(79).stamp_ns
        assert {topic.name: topic.count for topic in recording.topics} == {"/lidar/stream": 1, "/lidar/raw": 80}


def test_a_missing_part_is_a_truncation(tmp_path):
    record(tmp_path / "run_0.mcap", STREAM, raw(0))
    (tmp_path / "run_1.mcap").write_bytes(b"")

    with open_recording(tmp_path) as recording:
        assert recording.truncated
        assert "run_1.mcap: empty recording" in recording.problems[0]
        assert kinds(recording) == {"LidarStream": 1, "RawChunk": 1}


def test_a_recording_cut_anywhere_gives_a_prefix_or_one_clear_line(tmp_path):
    messages = [STREAM, *(raw(index) for index in range(300))]
    data = record(tmp_path / "whole.mcap", *messages, metadata={"robot": {"name": "x"}}).read_bytes()
    cut_file = tmp_path / "cut.mcap"
    most = 0

    for cut in [*range(60), *sorted(random.Random(1).sample(range(60, len(data)), 150))]:
        cut_file.write_bytes(data[:cut])
        try:
            with open_recording(cut_file) as recording:
                found = list(recording)
                assert recording.truncated
                assert recording.problems
        except RecordingError as error:
            assert "\n" not in str(error)  # noqa: PT017 - before the first message there is nothing to read
            assert most == 0
            continue
        assert found == messages[: len(found)]
        assert len(found) >= most
        most = len(found)
    assert most == len(messages)


def test_flipped_bytes_give_a_prefix_or_one_clear_line(tmp_path):
    messages = [STREAM, *(raw(index) for index in range(300))]
    data = record(tmp_path / "whole.mcap", *messages).read_bytes()
    noise = random.Random(2)

    for _ in range(150):
        damaged = bytearray(data)
        place = noise.randrange(len(data))
        damaged[place] ^= 1 << noise.randrange(8)
        (tmp_path / "damaged.mcap").write_bytes(damaged)
        with contextlib.suppress(RecordingError), open_recording(tmp_path / "damaged.mcap") as recording:
            found = list(recording)
            assert len(found) in (0, len(messages)) or recording.truncated
            assert found == messages[: len(found)]


def test_a_magic_followed_by_garbage_is_one_clear_line(tmp_path):
    noise = random.Random(3)
    for _ in range(20):
        (tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n" + noise.randbytes(500))
        with pytest.raises(RecordingError, match=r"a\.mcap: no messages in it \(.*\)"):
            open_recording(tmp_path / "a.mcap")


def test_a_recording_without_messages_is_refused(tmp_path):
    with pytest.raises(RecordingError, match=r"no messages in it$"):
        open_recording(record(tmp_path / "a.mcap"))
    with pytest.raises(RecordingError, match=r"no messages in it$"):
        open_recording(write_db3(tmp_path / "a.db3", [(1, "/odom", ODOMETRY_TYPE)], []))


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("name", "count", "messages"),
    [
        ("evo_nav2_turtlebot.mcap", 8197, {"Odometry": 2639, "Transform": 7313}),
        ("rosbag2_topics_and_services.mcap", 13, {}),
        ("rosbag2_wbag_0.mcap", 1246, {}),
        ("truck_default_conf.mcap_0.mcap", 3, {}),
        ("wifi_0_0_dc2_0.mcap", 54, {}),
        ("wifi_1_0_test_0.mcap", 305, {}),
        ("../rosbag_misc/plotjuggler_rosbag2_test_0.db3", 4695, {"Imu": 1565}),
    ],
)
def test_recordings_of_others_are_read_and_foreign_types_named(data_dir, name, count, messages):
    with open_recording(data_dir / "mcap" / name) as recording:
        assert kinds(recording) == messages
        assert sum(topic.count for topic in recording.topics) == count
        decoded = sum(topic.count for topic in recording.topics if topic.decoded)
        assert sum(recording.skipped.values()) == count - decoded
        assert (recording.truncated, recording.problems) == (False, [])


@pytest.mark.real_data
def test_a_turtlebot_folder_is_read_beside_foreign_metadata_and_without_a_write(data_dir):
    with open_recording(data_dir / "tb4_rplidar_olin") as recording:
        messages = list(recording)
        assert recording.scan_topic == "/scan"
        assert recording.skipped == {"std_msgs/msg/String": 1, "geometry_msgs/msg/Twist": 192}
        assert (recording.truncated, recording.problems) == (False, [])

    assert kinds(messages)["LaserScan"] == 357
    assert kinds(messages)["Odometry"] == 920
    static = {(t.parent, t.child): t for t in messages if isinstance(t, Transform) and t.static}
    laser = next(t for (_, child), t in static.items() if child == "rplidar_link")
    assert 2 * np.arctan2(laser.quaternion[2], laser.quaternion[3]) == pytest.approx(np.pi / 2, abs=1e-6)
    scans = [message for message in messages if isinstance(message, LaserScan)]
    assert {len(scan.ranges_m) for scan in scans} == {720}
    infinite = np.mean([np.isposinf(scan.ranges_m).mean() for scan in scans])
    assert infinite == pytest.approx(0.229, abs=0.001)
    assert all(scan.offsets_s[-1] == pytest.approx(0.13, abs=0.03) for scan in scans)


@pytest.mark.real_data
@pytest.mark.parametrize("name", ["evo_ROS_example", "plotjuggler_example", "plotjuggler_tilt_laser"])
def test_ros1_bags_are_named_and_refused(data_dir, name):
    with pytest.raises(RecordingError, match="a ROS 1 bag; convert it"):
        open_recording(data_dir / "rosbag_misc" / f"{name}.bag")


@pytest.mark.real_data
def test_a_folder_of_unrelated_recordings_is_refused(data_dir):
    with pytest.raises(RecordingError, match="6 different recordings"):
        open_recording(data_dir / "mcap")
