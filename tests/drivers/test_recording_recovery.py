from __future__ import annotations

import itertools
import random
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from drivers.errors import RecordingError
from drivers.messages import LidarStream, Odometry, RawChunk, Recordable
from drivers.recording_reader import open_recording
from drivers.recording_recovery import check, recover
from drivers.recording_writer import McapRecorder
from drivers.ros_codec import ODOMETRY_TYPE, encode
from drivers.ros_store import schema_text

START_NS = 1_700_000_000_000_000_000
STREAM = LidarStream(START_NS, "A2M8", "1.29", 7, "AB12", 115200, "Boost", 0x84, 126.0, 12.0)
CHUNKS = [RawChunk(START_NS + index * 10_000_000, random.Random(index).randbytes(84)) for index in range(400)]


@pytest.fixture
def recorded(tmp_path):
    """A recording of one stream message and 400 raw chunks."""
    ticks = itertools.count().__next__  # a clock that ends a chunk every few dozen messages
    options: dict[str, Any] = {"metadata": {"robot": {"name": "car1"}}, "flush_period_s": 60, "clock": ticks}
    with McapRecorder(tmp_path / "whole.mcap", **options) as recorder:
        messages: list[Recordable] = [STREAM, *CHUNKS]
        for message in messages:
            recorder.put(message)
    return tmp_path / "whole.mcap"


def write_odometry(path, times_ns, data=None, chunk_size=2000):
    body = encode(Odometry(START_NS, np.zeros(3), np.zeros(3))) if data is None else data
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk_size)
        writer.start(profile="ros2", library="someone else")
        schema = writer.register_schema(ODOMETRY_TYPE, "ros2msg", schema_text(ODOMETRY_TYPE).encode())
        channel = writer.register_channel("/odom", "cdr", schema, {"offered_qos_profiles": "x"})
        for index, time_ns in enumerate(times_ns):
            writer.add_message(channel, time_ns, body, time_ns + 1, sequence=index)
        writer.add_attachment(5, 6, "notes", "text/plain", b"hello")
        writer.finish()
    return path


def test_a_cut_recording_is_readable_by_everyone_afterwards(recorded, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recorded.read_bytes()[:20_000])

    report = recover(cut, tmp_path / "saved.mcap")

    assert report.topics == {"/lidar/stream": 1, "/lidar/raw": report.messages - 1}
    assert 100 < report.messages < 401
    assert "cut inside" in report.problems[0]
    with (tmp_path / "saved.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert sum(1 for _ in reader.iter_messages()) == report.messages
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    assert metadata["robot"] == {"name": "car1"}
    assert metadata["recovered"]["lost_bytes"] == str(report.lost_bytes)
    with open_recording(tmp_path / "saved.mcap") as recording:
        assert not recording.truncated
        assert list(recording) == [STREAM, *CHUNKS[: report.messages - 1]]


def test_every_cut_is_recovered_or_refused(recorded, tmp_path):
    data = recorded.read_bytes()
    for cut in sorted(random.Random(4).sample(range(len(data)), 60)):
        (tmp_path / "cut.mcap").write_bytes(data[:cut])
        (tmp_path / "saved.mcap").unlink(missing_ok=True)
        try:
            report = recover(tmp_path / "cut.mcap", tmp_path / "saved.mcap")
        except RecordingError:
            assert not (tmp_path / "saved.mcap").exists()
            continue
        assert check(tmp_path / "saved.mcap").ok
        with open_recording(tmp_path / "saved.mcap") as recording:
            assert len(list(recording)) == report.messages


def test_an_intact_file_is_copied_record_by_record(tmp_path):
    source = write_odometry(tmp_path / "a.mcap", range(100, 200))

    report = recover(source, tmp_path / "b.mcap")

    assert (report.messages, report.topics, report.lost_bytes, report.problems) == (100, {"/odom": 100}, 0, ())
    contents = []
    for path in (source, tmp_path / "b.mcap"):
        with path.open("rb") as stream:
            reader = make_reader(stream)
            header = reader.get_header()
            rows = [
                (schema.name, schema.data, channel.topic, channel.metadata, message.log_time, message.publish_time)
                for schema, channel, message in reader.iter_messages()
            ]
            contents.append((header, rows, list(reader.iter_attachments()), list(reader.iter_metadata())))
    assert contents[0] == contents[1]


def test_recovery_reads_past_a_damaged_chunk(tmp_path):
    source = write_odometry(tmp_path / "a.mcap", range(100))
    data = bytearray(source.read_bytes())
    data[len(data) // 2] ^= 0xFF
    source.write_bytes(data)

    report = recover(source, tmp_path / "b.mcap")

    assert 50 < report.messages < 100
    assert len(report.problems) == 1
    assert report.lost_bytes > 0
    with open_recording(tmp_path / "b.mcap") as recording:
        assert (recording.start_ns, recording.end_ns) == (0, 99)


def test_nothing_is_overwritten(recorded, tmp_path):
    before = recorded.read_bytes()

    for destination in (recorded, tmp_path / "precious.txt"):
        destination.touch()
        with pytest.raises(RecordingError, match="exists already"):
            recover(recorded, destination)

    assert recorded.read_bytes() == before


def test_a_file_without_messages_leaves_no_destination(tmp_path):
    write_odometry(tmp_path / "a.mcap", [])

    with pytest.raises(RecordingError, match="nothing to recover"):
        recover(tmp_path / "a.mcap", tmp_path / "b.mcap")

    assert not (tmp_path / "b.mcap").exists()


def test_check_is_content_with_an_own_recording(recorded):
    report = check(recorded)

    assert (report.ok, report.problems, report.notes) == (True, (), ())


def test_check_finds_a_cut(recorded, tmp_path):
    (tmp_path / "cut.mcap").write_bytes(recorded.read_bytes()[:-5])

    report = check(tmp_path / "cut.mcap")

    assert not report.ok
    assert any("no usable summary" in problem for problem in report.problems)


def test_check_finds_messages_that_do_not_decode(tmp_path):
    report = check(write_odometry(tmp_path / "a.mcap", range(5), data=b"\0\1\0\0nonsense"))

    assert not report.ok
    assert "5 messages not decoded, the first one: /odom: 12 bytes" in report.problems[0]


def test_check_notes_a_gap(tmp_path):
    times = [index * 20_000_000 for index in range(50)]

    report = check(write_odometry(tmp_path / "a.mcap", [*times, *(3_000_000_000 + time for time in times)]))

    assert report.ok
    assert report.notes == ("a.mcap: /odom: 2.0 s without a message, 1.0 s after the start (usually one every 20 ms)",)


@pytest.mark.real_data
def test_recordings_of_others_are_in_order(data_dir):
    files = [*sorted((data_dir / "mcap").glob("*.mcap")), data_dir / "tb4_rplidar_olin"]
    assert len(files) == 7
    for path in files:
        assert check(path).problems == (), path


@pytest.mark.real_data
def test_the_half_of_a_real_recording_is_recovered(data_dir, tmp_path):
    source = data_dir / "mcap" / "evo_nav2_turtlebot.mcap"
    (tmp_path / "half.mcap").write_bytes(source.read_bytes()[:250_000])

    report = recover(tmp_path / "half.mcap", tmp_path / "saved.mcap")

    assert report.messages > 2000
    assert check(tmp_path / "saved.mcap").ok
