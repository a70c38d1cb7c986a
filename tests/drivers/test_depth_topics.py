from __future__ import annotations

import contextlib
import sqlite3
from dataclasses import replace

import numpy as np
import pytest
from rosbags.typesys.stores import ros2_humble as ros

from drivers.depth_codec import CAMERA_INFO_TYPE, IMAGE_TYPE, depth_parts
from drivers.depth_topics import NO_DEPTH, find_depth
from drivers.messages import DepthImage, Pinhole
from drivers.recording_reader import open_recording
from drivers.recording_sqlite import SqliteFile
from drivers.recording_writer import McapRecorder
from drivers.ros_store import header, to_cdr

CAMERA = Pinhole(4, 3, 2.0, 2.0, 1.5, 1.0)


def image(index, frame_id="depth_frame"):
    return DepthImage(10**9 * (index + 1), np.full((3, 4), index), 0.0005, CAMERA, frame_id, index)


def rgb(topic, stamp_ns=5):
    body = ros.sensor_msgs__msg__Image(header(stamp_ns, "color"), 1, 1, "rgb8", 0, 3, np.zeros(3, np.uint8))
    return topic, IMAGE_TYPE, stamp_ns, to_cdr(body, IMAGE_TYPE)


def rows_of(depth, topic, time_ns):
    return [(part.topic, part.type_name, time_ns, part.data) for part in depth_parts(depth, topic)]


def write_db3(path, rows):
    """A .db3 with (topic, type, time, data) rows; returns the path."""
    topics = {name: (index, type_name) for index, (name, type_name, _, _) in enumerate(rows, 1)}
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
        )
        database.executemany("INSERT INTO topics VALUES (?, ?, ?, 'cdr')", [(i, n, t) for n, (i, t) in topics.items()])
        database.executemany(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)",
            [(topics[name][0], time_ns, data) for name, _, time_ns, data in rows],
        )
        database.commit()
    return path


def found(tmp_path, rows):
    with contextlib.closing(SqliteFile(write_db3(tmp_path / "a.db3", rows))) as file:
        return find_depth([file])


def test_a_depth_topic_with_its_companions_is_found_among_colour_images(tmp_path):
    depth = found(tmp_path, [rgb("/camera/color/image_raw"), *rows_of(image(0), "/cam/depth", 10)])
    assert depth.image == "/cam/depth"
    assert depth.readable == {"/cam/depth"}
    assert depth.companions == {"/cam/camera_info", "/cam/depth_units", "/cam/frame_number"}
    assert len(depth.first) == 3


def test_without_intrinsics_there_is_no_depth(tmp_path):
    rows = [row for row in rows_of(image(0), "/cam/depth", 10) if row[1] != CAMERA_INFO_TYPE]
    assert found(tmp_path, rows) is NO_DEPTH


@pytest.mark.parametrize(
    ("better", "worse"),
    [("/a/depth", "/a/disparity"), ("/a/depth", "/a/aligned_depth_to_color")],
)
def test_of_several_depth_topics_the_plain_one_is_read(better, worse, tmp_path):
    rows = [*rows_of(image(0), worse, 10), *rows_of(image(1), worse, 20), *rows_of(image(0), better, 30)]
    depth = found(tmp_path, rows)
    assert depth.image == better
    assert depth.readable == {better, worse}


@pytest.mark.parametrize("storage", ["mcap", "db3"])
def test_depth_is_read_from_either_storage(storage, tmp_path):
    path = tmp_path / f"r.{storage}"
    if storage == "mcap":
        with McapRecorder(path, metadata={}) as recorder:
            for index in range(5):
                recorder.put(image(index))
    else:
        write_db3(path, [row for i in range(5) for row in rows_of(image(i), "/camera/depth/image_rect_raw", 100 + i)])

    with open_recording(path) as recording:
        assert recording.depth_topic == "/camera/depth/image_rect_raw"
        assert {(topic.count, topic.decoded) for topic in recording.topics} == {(5, True)}
        images = list(recording)
        assert recording.problems == []
        assert recording.skipped == {}
    for index, (got, sent) in enumerate(zip(images, map(image, range(5)), strict=True)):
        assert np.array_equal(got.depth, sent.depth)
        assert (got.stamp_ns, got.unit_m, got.camera, got.frame_id, got.sequence) == (
            (index + 1) * 10**9, 0.0005, CAMERA, "depth_frame", index
        )  # fmt: skip


def test_images_before_their_camera_info_are_read_and_damaged_ones_counted(tmp_path):
    info, unit, number, first = rows_of(image(0), "/cam/depth", 10)
    later = [(name, kind, 20, data) for name, kind, _, data in (info, unit, number)]
    bad = (*first[:2], 30, first[3][:-5])
    with open_recording(write_db3(tmp_path / "a.db3", [first, *later, bad])) as recording:
        (only,) = list(recording)
        assert only.unit_m == 0.0005
        assert len(recording.problems) == 1
        assert "/cam/depth: 1 message not decoded (/cam/depth: " in recording.problems[0]


def test_an_uncalibrated_colour_camera_beside_is_no_problem(tmp_path):
    colour = rows_of(replace(image(0, "color")), "/color/depth", 10)[0]
    damaged = (colour[0], colour[1], 10, colour[3][:20])
    with open_recording(write_db3(tmp_path / "a.db3", [damaged, *rows_of(image(0), "/cam/depth", 11)])) as recording:
        assert len(list(recording)) == 1
        assert recording.problems == []
