from __future__ import annotations

import contextlib
import sqlite3

import pytest

from drivers.errors import RecordingError
from drivers.recording_sqlite import SqliteFile

TOPICS = [
    (1, "/scan", "sensor_msgs/msg/LaserScan", "cdr"),
    (2, "/odd", "my_msgs/msg/Thing", "xml"),
    (3, "/empty", "std_msgs/msg/String", "cdr"),
]


def write_db3(path, times, data=b"x" * 600):
    """A .db3 as rosbag2 makes it, with messages of these times, on /scan and /odd in turn; returns the path."""
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
            " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,"
            " data BLOB NOT NULL);"
            "CREATE INDEX timestamp_idx ON messages (timestamp ASC);"
        )
        database.executemany("INSERT INTO topics VALUES (?, ?, ?, ?, '')", TOPICS)
        database.executemany(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)",
            [(1 + index % 2, time_ns, data) for index, time_ns in enumerate(times)],
        )
        database.commit()
    return path


def read(path):
    with contextlib.closing(SqliteFile(path)) as file:
        return [message.log_time_ns for message in file.messages({"/scan", "/odd"})], file.truncated, file.problems


def test_topics_times_and_messages_of_an_intact_file(tmp_path):
    path = write_db3(tmp_path / "a.db3", range(100, 200))

    with contextlib.closing(SqliteFile(path)) as file:
        assert [(topic.name, topic.type_name, topic.count) for topic in file.topics] == [
            ("/scan", "sensor_msgs/msg/LaserScan", 50),
            ("/odd", "", 50),
            ("/empty", "std_msgs/msg/String", 0),
        ]
        assert (file.start_ns, file.end_ns) == (100, 199)
        scans = list(file.messages({"/scan"}))
        assert [scan.log_time_ns for scan in scans] == list(range(100, 200, 2))
        assert scans[0].data == b"x" * 600
        assert file.verify() == ([], [])
    assert list(tmp_path.iterdir()) == [path]  # no journal beside it


def test_messages_come_in_the_order_of_time(tmp_path):
    times = [(index * 37) % 100 for index in range(100)]

    assert read(write_db3(tmp_path / "a.db3", times)) == (sorted(times), False, [])


def test_a_cut_file_gives_what_is_left_in_order(tmp_path):
    data = write_db3(tmp_path / "a.db3", range(500)).read_bytes()
    most = 0

    for cut in range(100, len(data), 4096 + 1000):
        path = tmp_path / "cut.db3"
        path.write_bytes(data[:cut])
        try:
            found, truncated, problems = read(path)
        except RecordingError as error:
            assert "cut.db3" in str(error)  # noqa: PT017 - early cuts leave nothing, later ones a prefix
            continue
        assert found == list(range(len(found)))
        assert truncated
        assert "cut" in problems[0]
        most = max(most, len(found))
    assert most > 300


@pytest.mark.parametrize("seed", range(20))
def test_flipped_bytes_end_the_reading_and_raise_nothing_else(tmp_path, seed):
    path = write_db3(tmp_path / "a.db3", range(300))
    data = bytearray(path.read_bytes())
    for step in range(8):
        data[4096 + (seed * 7919 + step * 104729) % (len(data) - 4096)] ^= 0xA5
    path.write_bytes(data)

    with contextlib.suppress(RecordingError):
        found, truncated, _ = read(path)
        assert truncated or len(found) > 280


def test_messages_in_the_write_ahead_log_are_read(tmp_path):
    path = tmp_path / "a.db3"
    write_db3(path, range(10))
    with contextlib.closing(sqlite3.connect(path)) as writer:
        writer.execute("PRAGMA journal_mode = WAL")
        writer.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, 77, x'00')")
        writer.commit()
        found, truncated, _ = read(path)

    assert found == [*range(10), 77]
    assert not truncated


def test_another_database_is_refused(tmp_path):
    with contextlib.closing(sqlite3.connect(tmp_path / "a.db3")) as database:
        database.execute("CREATE TABLE messages(id)")
        database.commit()

    with pytest.raises(RecordingError, match="without the tables of a ROS 2 bag"):
        SqliteFile(tmp_path / "a.db3")


def test_a_strange_path_is_no_sql_and_no_uri(tmp_path):
    assert read(write_db3(tmp_path / "a b?mode=rw#%41'.db3", range(3)))[0] == [0, 1, 2]
