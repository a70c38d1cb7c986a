from __future__ import annotations

import io
import struct

import pytest
from mcap.records import Channel, Metadata, Schema
from mcap.writer import CompressionType, Writer

from drivers.recording_mcap import MAGIC, Fault, Leaf, McapMessage, McapSink, walk


def mcap_file(compression=CompressionType.ZSTD, use_chunking=True, messages=200, chunk_size=1000):
    """An MCAP file made by the package's own writer; returns its bytes."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=chunk_size, compression=compression, use_chunking=use_chunking)
    writer.start(profile="ros2", library="test")
    writer.add_metadata("robot", {"name": "car1"})
    schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
    channel = writer.register_channel("/text", "cdr", schema)
    for index in range(messages):
        writer.add_message(channel, index, index.to_bytes(40, "big"), index)
    writer.finish()
    return stream.getvalue()


def walked(data):
    items = list(walk(io.BytesIO(data), len(MAGIC), len(data)))
    faults = [item for item in items if isinstance(item, Fault)]
    return [item.record for item in items if isinstance(item, Leaf)], faults


def times(records):
    return [record.log_time_ns for record in records if isinstance(record, McapMessage)]


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("use_chunking", [True, False])
def test_every_record_of_an_intact_file_is_found(compression, use_chunking):
    data = mcap_file(compression, use_chunking)

    records, faults = walked(data[: -len(MAGIC)])

    assert faults == []
    assert times(records) == list(range(200))
    assert {Schema, Channel, Metadata} <= {type(record) for record in records}


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("use_chunking", [True, False])
def test_a_cut_anywhere_gives_a_prefix_and_one_fault_at_the_end(compression, use_chunking):
    data = mcap_file(compression, use_chunking, messages=60)
    most = 0

    for cut in range(len(MAGIC), len(data) - len(MAGIC)):
        items = list(walk(io.BytesIO(data[:cut]), len(MAGIC), cut))
        found = times([item.record for item in items if isinstance(item, Leaf)])
        assert found == list(range(len(found)))
        assert not any(isinstance(item, Fault) for item in items[:-1])
        assert len(found) >= most
        most = len(found)
    assert most == 60


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.ZSTD])
def test_the_complete_messages_of_a_cut_chunk_are_saved(compression):
    data = mcap_file(compression, messages=20_000, chunk_size=10_000_000)

    records, faults = walked(data[:60_000])

    assert len(times(records)) > 500
    assert len(faults) == 1
    assert "bytes of records saved" in faults[0].text


def test_a_flipped_bit_costs_its_chunk_and_no_other():
    data = bytearray(mcap_file(CompressionType.NONE, messages=60))
    place = data.index((30).to_bytes(40, "big"))
    data[place + 20] ^= 1

    records, faults = walked(bytes(data[: -len(MAGIC)]))

    lost = set(range(60)) - set(times(records))
    assert 30 in lost
    assert len(lost) < 20
    assert len(faults) == 1
    assert "CRC" in faults[0].text


def test_zeros_after_a_power_cut_end_the_walk():
    data = mcap_file(messages=60)
    cut = data[: len(data) // 2]

    records, faults = walked(cut + bytes(5000))
    assert times(records) == list(range(len(times(records))))
    assert faults
    assert faults[-1].lost_bytes > 0


def test_an_endless_length_is_a_cut():
    _, faults = walked(MAGIC + struct.pack("<BQ", 5, 2**63) + b"abc")

    assert faults == [Fault(8, 12, "cut inside a record: its 12 bytes are lost")]


def test_an_unknown_compression_is_named():
    body = struct.pack("<QQQI", 0, 0, 3, 0) + struct.pack("<I", 3) + b"xyz" + struct.pack("<Q", 3) + b"abc"

    _, faults = walked(MAGIC + struct.pack("<BQ", 6, len(body)) + body)

    assert len(faults) == 1
    assert "compression 'xyz', expected zstd, lz4 or none" in faults[0].text


def test_what_the_sink_writes_is_found_again():
    stream = io.BytesIO()
    sink = McapSink(stream, "test")
    sink.add_metadata("robot", {"name": "car1"})
    channel = sink.add_channel("/a", "cdr", sink.add_schema("t/msg/A", "ros2msg", b"int8 a"), {"key": "value"})
    message = McapMessage(channel, 7, 100, 90, b"payload")
    sink.add_message(message)
    sink.flush()
    flushed = stream.getvalue()
    sink.finish()

    for data in (flushed, stream.getvalue()[: -len(MAGIC)]):
        records, faults = walked(data)
        assert faults == []
        assert message in records
        assert Metadata("robot", {"name": "car1"}) in records
        assert Channel(channel, "/a", "cdr", {"key": "value"}, 1) in records


def test_a_walk_that_is_sent_past_the_end_of_the_file_ends():
    data = mcap_file(messages=5)

    items = list(walk(io.BytesIO(data), len(data) + 50, len(data) + 100))

    assert [type(item) for item in items] == [Fault]
