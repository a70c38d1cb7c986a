from __future__ import annotations

import sqlite3
from contextlib import closing
from functools import partial

import numpy as np
import pytest

from drivers.errors import RecordingError
from drivers.messages import LaserScan, Message, Odometry
from drivers.recording_reader import open_recording
from drivers.recording_scan import bin_count
from drivers.ros_codec import encode
from mapping.frames import planar_transform
from tools.live_bench import PacedSource, bench_live
from tools.pipeline import LidarDecoding


@pytest.mark.live(cores=1)
def test_a_live_run_maps_every_scan_and_times_each(round_trip):
    live = bench_live(round_trip, None, 2.5)
    assert live.simulated
    assert live.dropped == 0
    assert 15 <= live.mapped <= 26
    assert live.scans - live.mapped <= 1  # the lidar's first turn may begin anywhere
    assert live.seconds >= 2.0  # at the real pace
    assert 0.0 < live.mapping_ms.median <= live.latency_ms.max


def test_nothing_to_map_is_refused(round_trip):
    with pytest.raises(RecordingError, match="nothing to measure"):
        bench_live(round_trip, None, 0.05)


def scan(stamp_ns: int) -> LaserScan:
    return LaserScan(stamp_ns, np.zeros(2), np.ones(2), np.array([0.0, 0.02]), 0.1, 12.0)


def write_sqlite_bag(path, scans):
    """A .db3 as rosbag2 makes it, with scans on /scan."""
    with closing(sqlite3.connect(path)) as database:
        database.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
            " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,"
            " data BLOB NOT NULL);"
            "INSERT INTO topics VALUES (1, '/scan', 'sensor_msgs/msg/LaserScan', 'cdr', '');"
        )
        database.executemany(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)",
            [(scan.stamp_ns, encode(scan, bin_count(scan))) for scan in scans],
        )
        database.commit()


def each(messages):
    yield from messages


@pytest.mark.live(cores=1)
def test_a_live_run_reads_every_kind_of_recording(round_trip, tmp_path):
    """SQLite serves only the thread that opened it, and the sensor's thread reads here."""
    scans = []
    decoding = LidarDecoding()
    with open_recording(round_trip) as recording:
        for message in recording.messages():
            scans += [decoded for decoded in decoding.feed(message) if isinstance(decoded, LaserScan)]
    write_sqlite_bag(tmp_path / "bag.db3", scans[:15])
    live = bench_live(tmp_path / "bag.db3", None, 10.0)
    assert live.scans == 15
    assert live.mapped >= 13


def test_a_paced_source_ends_at_its_time_and_on_request():
    messages: list[Message] = [Odometry(0, np.zeros(3), np.zeros(3)), scan(0), scan(10_000_000), scan(10**10)]
    assert list(PacedSource(partial(each, messages), 0.1)) == messages[:3]
    stopped = PacedSource(partial(each, messages), 100.0)
    stopped.request_stop()
    assert list(stopped) == []


def test_a_transform_from_long_ago_does_not_set_the_pace():
    built = planar_transform(-(10**15), "base_link", "laser", np.zeros(4), inverted=False)
    messages: list[Message] = [built, scan(0), scan(10_000_000)]
    assert list(PacedSource(partial(each, messages), 0.1)) == messages
