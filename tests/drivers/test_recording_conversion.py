from __future__ import annotations

import contextlib
import dataclasses
import sqlite3

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader

from drivers.errors import RecordingError
from drivers.messages import DepthImage, Odometry, Pinhole, RawChunk, Transform
from drivers.recording_conversion import convert
from drivers.recording_reader import open_recording
from drivers.recording_recovery import check
from drivers.recording_writer import McapRecorder
from drivers.ros_codec import ODOMETRY_TYPE, encode

CARMEN = """PARAM laser_front_laser_resolution 1.0
FLASER 4 1.00 2.00 81.83 3.25 1.5 0.5 0.25 1.5 0.5 0.25 976052890.25 nohost 0.25
ODOM 1.5 0.5 0.25 0 0 0 976052890.5 nohost 0.5
FLASER 4 1.10 2.10 3.10 3.35 1.6 0.5 0.25 1.6 0.5 0.25 976052890.75 nohost 0.75
RLASER 4 1.10 2.10 3.10 3.35 1.6 0.5 0.25 1.6 0.5 0.25 976052890.8 nohost 0.75
"""


def tinyslam():
    ranges = " ".join(str(1000 + beam) for beam in range(682))
    return "".join(f"{200_000 + 100_000 * line} 0 {line * 10} {line * 10} {'0 ' * 21}{ranges}\n" for line in range(5))


def depth_folder(path):
    path.mkdir()
    (path / "camera-intrinsics.txt").write_text("500 0 2\n0 500 2\n0 0 1\n")
    for number in range(3):
        image = cv2.imencode(".png", np.full((4, 5), 700 + number, np.uint16))[1]
        (path / f"frame-{number:06d}.depth.png").write_bytes(image.tobytes())
        np.savetxt(path / f"frame-{number:06d}.pose.txt", np.eye(4))
    return path


def write(path, text):
    path.write_text(text)
    return path


def assert_same(got, sent):
    assert type(got) is type(sent)
    for field in dataclasses.fields(sent):
        left, right = getattr(got, field.name), getattr(sent, field.name)
        if isinstance(right, np.ndarray) and right.dtype == np.float64:
            assert left == pytest.approx(right, rel=2e-7, abs=2e-7)  # LaserScan has float32
        elif isinstance(right, float):
            assert left == pytest.approx(right, rel=2e-7)
        else:
            assert np.array_equal(left, right), field.name


def converted(source, destination, **options):
    with open_recording(source, **options) as opened:
        report = convert(opened, destination)
    assert check(destination).ok
    return report


@pytest.mark.parametrize(
    ("make", "written"),
    [
        (lambda path: write(path / "a.log", CARMEN), {"/tf_static": 1, "/odom": 3, "/scan": 2}),
        (lambda path: write(path / "a.dat", tinyslam()), {"/tf_static": 1, "/odom": 5, "/scan": 5}),
        (lambda path: depth_folder(path / "frames"), {"/tf": 3, "/camera/depth/image_rect_raw": 3}),
    ],
    ids=["carmen", "tinyslam", "depth folder"],
)
def test_every_message_of_another_format_is_in_the_new_file(make, written, tmp_path):
    source = make(tmp_path)
    report = converted(source, tmp_path / "new.mcap")
    assert (report.topics, report.problems) == (written, ())
    with open_recording(source) as before, open_recording(tmp_path / "new.mcap") as after:
        sent, got = list(before), list(after)
        for left, right in zip(got, sent, strict=True):
            undated = isinstance(right, Transform) and right.static and right.stamp_ns == 0
            assert_same(left, dataclasses.replace(right, stamp_ns=left.stamp_ns) if undated else right)
        assert after.end_ns - after.start_ns < 10 * 10**9
        assert report.messages == len(sent)


def test_lines_of_another_laser_are_named_as_left_out(tmp_path):
    report = converted(write(tmp_path / "a.log", CARMEN), tmp_path / "new.mcap")
    assert report.left_out == {"CARMEN PARAM": 1, "CARMEN RLASER": 1}


def test_notes_of_a_depth_folder_are_kept(tmp_path):
    converted(depth_folder(tmp_path / "frames"), tmp_path / "new.mcap")
    with open_recording(tmp_path / "new.mcap") as opened:
        assert opened.metadata["depth_folder"]["camera-intrinsics.txt"].startswith("500 0 2")
        assert opened.metadata["mapfuse.source"] == {"file": "frames"}


def raw(index):
    return RawChunk(10**9 + index, bytes([index]) * 50)


def stored(path):
    """All that an MCAP file holds, as other readers see it."""
    with path.open("rb") as stream:
        return [
            (schema.name, channel.topic, channel.metadata, message.log_time, message.publish_time, message.data)
            for schema, channel, message in make_reader(stream).iter_messages()
        ]


def test_the_parts_of_an_mcap_recording_become_one_file_byte_for_byte(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    camera = Pinhole(2, 1, 1.0, 1.0, 0.5, 0.5)
    for part in range(2):
        with McapRecorder(folder / f"run_{part}.mcap", metadata={"robot": {"name": "x"}}) as recorder:
            for index in range(20):
                recorder.put(raw(20 * part + index))
            recorder.put(DepthImage(10**9 + 100 * part, np.zeros((1, 2), np.uint16), 0.001, camera))

    report = converted(folder, tmp_path / "new.mcap")

    assert report.topics["/lidar/raw"] == 40
    assert stored(tmp_path / "new.mcap") == sorted(
        stored(folder / "run_0.mcap") + stored(folder / "run_1.mcap"), key=lambda row: row[3]
    )
    with open_recording(tmp_path / "new.mcap") as opened:
        assert opened.metadata == {"robot": {"name": "x"}}


def test_a_cut_mcap_recording_is_converted_as_far_as_it_goes(tmp_path):
    with McapRecorder(tmp_path / "a.mcap", metadata={}) as recorder:
        for index in range(20):
            recorder.put(raw(index))
    data = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[:-100])
    report = converted(tmp_path / "cut.mcap", tmp_path / "new.mcap")
    assert report.messages == 20
    assert report.problems


@pytest.mark.parametrize("definition", ["", "float64 x\n"])
def test_types_that_nobody_here_knows_are_copied_from_sqlite(definition, tmp_path):
    odometry = encode(Odometry(5, np.zeros(3), np.zeros(3)))
    with contextlib.closing(sqlite3.connect(tmp_path / "a.db3")) as database:
        database.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,"
            " offered_qos_profiles TEXT);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
        )
        if definition:
            database.execute(
                "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT, encoding TEXT,"
                " encoded_message_definition TEXT, type_description_hash TEXT)"
            )
            database.execute(
                "INSERT INTO message_definitions VALUES (1, 'my_msgs/msg/Thing', 'ros2msg', ?, '')", [definition]
            )
        database.execute("INSERT INTO topics VALUES (1, '/odom', ?, 'cdr', '- depth: 7')", [ODOMETRY_TYPE])
        database.execute("INSERT INTO topics VALUES (2, '/odd', 'my_msgs/msg/Thing', 'cdr', '')")
        rows = [(1, 10, odometry), (2, 20, b"\0\1\0\0what"), (1, 30, odometry)]
        database.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
        database.commit()

    report = converted(tmp_path / "a.db3", tmp_path / "new.mcap")

    assert report.topics == {"/odom": 2, "/odd": 1}
    assert [(name, time_ns, data) for name, _, _, time_ns, _, data in stored(tmp_path / "new.mcap")] == [
        (ODOMETRY_TYPE, 10, odometry),
        ("my_msgs/msg/Thing", 20, b"\0\1\0\0what"),
        (ODOMETRY_TYPE, 30, odometry),
    ]
    with (tmp_path / "new.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary is not None
        schemas = {schema.name: schema.data.decode() for schema in summary.schemas.values()}
        channels = {channel.topic: channel.metadata for channel in summary.channels.values()}
    assert schemas["my_msgs/msg/Thing"] == definition
    assert "geometry_msgs/PoseWithCovariance" in schemas[ODOMETRY_TYPE]
    assert channels["/odom"]["offered_qos_profiles"] == "- depth: 7"


def test_nothing_is_overwritten_and_nothing_half_done_stays(tmp_path):
    source = write(tmp_path / "a.log", CARMEN)
    kept = write(tmp_path / "kept.mcap", "years of work")
    with open_recording(source) as opened:
        with pytest.raises(RecordingError, match="exists already"):
            convert(opened, kept)
        with pytest.raises(RecordingError, match="cannot be created"):
            convert(opened, tmp_path / "missing" / "new.mcap")
        source.unlink()
        with pytest.raises(RecordingError, match=r"a\.log: No such file or directory"):
            convert(opened, tmp_path / "new.mcap")
    assert kept.read_text() == "years of work"
    assert not (tmp_path / "new.mcap").exists()


@pytest.mark.real_data
@pytest.mark.parametrize(
    "name", ["tinyslam_mines/exp1.dat", "rosbag_misc/librealsense_single_depth_color_640x480.bag", "tb4_rplidar_olin"]
)
def test_real_recordings_give_the_same_messages_once_converted(name, data_dir, tmp_path):
    converted(data_dir / name, tmp_path / "new.mcap")
    with open_recording(data_dir / name) as before, open_recording(tmp_path / "new.mcap") as after:
        for index, (got, sent) in enumerate(zip(after, before, strict=True)):
            if isinstance(sent, Transform) and sent.stamp_ns == 0:
                continue
            if index < 50 or isinstance(sent, DepthImage):
                assert_same(got, sent)
            assert got.stamp_ns == sent.stamp_ns


@pytest.mark.real_data
def test_all_streams_of_a_realsense_recording_are_taken_along(data_dir, tmp_path):
    source = data_dir / "rosbag_misc" / "librealsense_single_depth_color_640x480.bag"
    report = converted(source, tmp_path / "new.mcap")
    with open_recording(source) as before, open_recording(tmp_path / "new.mcap") as after:
        assert report.messages == sum(topic.count for topic in before.topics)
        assert (report.left_out, report.problems) == ({}, ())
        assert after.depth_topic == "/camera/depth/image_rect_raw"
        assert after.end_ns - after.start_ns < 10**9
        assert after.problems == []
    colour = [row for row in stored(tmp_path / "new.mcap") if row[1].endswith("Color_0/image/data")]
    assert [len(row[-1]) // 1000 for row in colour] == [640 * 480 * 3 // 1000]
