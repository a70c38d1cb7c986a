from __future__ import annotations

import contextlib

import pytest
from mcap.writer import CompressionType, IndexType, Writer

from drivers.recording_mcap_file import McapFile


def write_mcap(path, times, chunk_size=500, **options):
    """An MCAP file with messages of these log times, alternating between /a and /b; returns the path."""
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk_size, **options)
        writer.start(profile="ros2", library="test")
        writer.add_metadata("robot", {"name": "car1"})
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channels = [writer.register_channel(topic, "cdr", schema) for topic in ("/a", "/b")]
        for index, time_ns in enumerate(times):
            writer.add_message(channels[index % 2], time_ns, index.to_bytes(20, "big"), time_ns)
        writer.finish()
    return path


def log_times(path, topics=("/a", "/b")):
    with contextlib.closing(McapFile(path)) as file:
        return [message.log_time_ns for message in file.messages(topics)]


INDEXES = [
    {},
    {"index_types": IndexType.NONE},
    {"use_statistics": False},
    {"repeat_channels": False, "repeat_schemas": False},
    {"use_chunking": False},
    {"enable_crcs": False, "enable_data_crcs": True},
]


@pytest.mark.parametrize("options", INDEXES, ids=str)
def test_every_kind_of_summary_gives_the_same_table_of_contents(tmp_path, options):
    path = write_mcap(tmp_path / "a.mcap", range(100, 301), **options)

    with contextlib.closing(McapFile(path)) as file:
        assert [(topic.name, topic.type_name, topic.count) for topic in file.topics] == [
            ("/a", "std_msgs/msg/String", 101),
            ("/b", "std_msgs/msg/String", 100),
        ]
        assert (file.start_ns, file.end_ns) == (100, 300)
        assert file.metadata == {"robot": {"name": "car1"}}
        assert (file.truncated, file.problems) == (False, [])
        assert [message.log_time_ns for message in file.messages({"/a", "/b"})] == list(range(100, 301))
        assert [message.log_time_ns for message in file.messages({"/b"})] == list(range(101, 301, 2))


@pytest.mark.parametrize("options", INDEXES, ids=str)
def test_messages_come_in_the_order_of_time_however_they_lie(tmp_path, options):
    times = [(index * 37) % 200 for index in range(200)]

    assert log_times(write_mcap(tmp_path / "a.mcap", times, **options)) == sorted(times)


def test_a_walk_without_summary_sorts_overlapping_chunks_too(tmp_path):
    times = [index ^ 15 for index in range(256)]
    path = write_mcap(tmp_path / "a.mcap", times)
    path.write_bytes(path.read_bytes()[:-1])

    assert log_times(path) == list(range(256))


def test_a_cut_chunk_that_is_not_the_last_in_time_hides_no_other(tmp_path):
    times = [*range(1000, 1040), *range(40)]
    path = write_mcap(tmp_path / "a.mcap", times, chunk_size=1500, compression=CompressionType.NONE)
    with contextlib.closing(McapFile(path)) as file:
        last = max(file.index.spans, key=lambda span: span.offset)
    path.write_bytes(path.read_bytes()[: last.end - 70])

    found = log_times(path)

    assert found == sorted(found)
    assert set(range(1000, 1040)) < set(found)
    assert 37 <= len(found) - 40 < 40


def test_equal_times_keep_the_order_of_writing(tmp_path):
    with contextlib.closing(McapFile(write_mcap(tmp_path / "a.mcap", [5] * 100))) as file:
        assert [int.from_bytes(m.data, "big") for m in file.messages({"/a", "/b"})] == list(range(100))


def test_two_readers_of_one_file_do_not_disturb_each_other(tmp_path):
    with contextlib.closing(McapFile(write_mcap(tmp_path / "a.mcap", range(200)))) as file:
        pairs = list(zip(file.messages({"/a", "/b"}), file.messages({"/a", "/b"}), strict=True))

    assert len(pairs) == 200
    assert all(left == right for left, right in pairs)


def test_a_file_still_being_written_says_so(tmp_path):
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="test")
        stream.flush()
        with contextlib.closing(McapFile(tmp_path / "a.mcap")) as file:
            assert file.truncated
            assert file.problems == ["ends without its closing records: cut, or still being written"]
            assert file.topics == []


def test_damage_behind_an_intact_summary_shows_while_reading(tmp_path):
    path = write_mcap(tmp_path / "a.mcap", range(200))
    data = bytearray(path.read_bytes())
    with contextlib.closing(McapFile(path)) as file:
        middle = file.index.spans[len(file.index.spans) // 2]
    data[middle.offset + 80] ^= 0xFF
    path.write_bytes(data)

    with contextlib.closing(McapFile(path)) as file:
        assert not file.truncated
        found = [message.log_time_ns for message in file.messages({"/a", "/b"})]
        assert found == list(range(len(found)))
        assert 0 < len(found) == middle.start_ns
        assert file.truncated
        assert f"chunk at byte {middle.offset}" in file.problems[0]


def test_channels_of_other_encodings_have_no_ros_type(tmp_path):
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        json = writer.register_channel("/json", "json", 0)
        writer.add_message(json, 1, b"{}", 1)
        writer.finish()

    with contextlib.closing(McapFile(tmp_path / "a.mcap")) as file:
        assert [(topic.name, topic.type_name, topic.count) for topic in file.topics] == [("/json", "", 1)]


def test_verify_finds_nothing_in_an_intact_file(tmp_path):
    with contextlib.closing(McapFile(write_mcap(tmp_path / "a.mcap", range(50), enable_data_crcs=True))) as file:
        assert file.verify() == ([], [])


@pytest.mark.parametrize(
    ("place", "text"),
    [
        (-1, "no usable summary"),
        (-30, "no usable summary"),
        (60, "CRC of the data section"),
        (-200, "no usable summary"),
    ],
)
def test_verify_finds_a_flipped_byte(tmp_path, place, text):
    path = write_mcap(tmp_path / "a.mcap", range(50), enable_data_crcs=True)
    data = bytearray(path.read_bytes())
    data[place] ^= 0x10
    path.write_bytes(data)

    with contextlib.closing(McapFile(path)) as file:
        assert any(text in problem for problem in file.verify()[0])


def test_verify_notes_times_that_go_back(tmp_path):
    with contextlib.closing(McapFile(write_mcap(tmp_path / "a.mcap", [0, 5_000_000_000, 2_000_000_000]))) as file:
        assert file.verify() == ([], ["log times in the file go back by up to 3.0 s"])


def test_closing_twice_is_allowed(tmp_path):
    file = McapFile(write_mcap(tmp_path / "a.mcap", [1]))
    file.close()
    file.close()

    with pytest.raises(ValueError, match="closed file"):
        list(file.messages({"/a"}))
