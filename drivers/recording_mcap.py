"""MCAP records, read one by one however the file ends, and written; the only user of the mcap package.

Format: https://mcap.dev/spec. A file is magic, records (opcode u8, length u64, content), magic; chunks hold compressed
records. The package's own readers give nothing, or only complete chunks, once the end of the file is missing.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import BinaryIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.writer import Writer

from drivers.wording import fault_in

__all__ = [
    "MAGIC",
    "Attachment",
    "Channel",
    "ChunkIndex",
    "DataEnd",
    "Fault",
    "Footer",
    "Header",
    "Leaf",
    "McapMessage",
    "McapSink",
    "Metadata",
    "MetadataIndex",
    "Schema",
    "Statistics",
    "walk",
]

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")  # opcode, length
_CHUNK_HEAD = struct.Struct("<QQQI")  # start time, end time, uncompressed size, uncompressed CRC
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_PARSERS: dict[int, Callable[[ReadDataStream], McapRecord]] = {
    Opcode.ATTACHMENT: Attachment.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.CHUNK_INDEX: ChunkIndex.read,
    Opcode.DATA_END: DataEnd.read,
    Opcode.FOOTER: Footer.read,
    Opcode.HEADER: Header.read,
    Opcode.METADATA: Metadata.read,
    Opcode.METADATA_INDEX: MetadataIndex.read,
    Opcode.SCHEMA: Schema.read,
    Opcode.STATISTICS: Statistics.read,
}


@dataclass(frozen=True, slots=True)
class McapMessage:
    """A message record; times in ns."""

    channel_id: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Leaf:
    """A record that is not a chunk; offset and end (bytes) of the record of the file that it is or is in."""

    record: McapMessage | McapRecord
    offset: int
    end: int


@dataclass(frozen=True, slots=True)
class Fault:
    """A place of the file from which nothing (more) could be read, and how many bytes that cost."""

    offset: int
    lost_bytes: int
    text: str


def walk(stream: BinaryIO, start: int, end: int) -> Iterator[Leaf | Fault]:
    """Yield the records between two positions, those inside chunks too, and a Fault wherever some are lost.

    A chunk that ends early gives its complete records first. After a damaged chunk or record the walk goes on with the
    next one; it ends where the framing of the records is lost. Indexes and unknown records are left out.
    """
    position = start
    while position < end:
        stream.seek(position)
        head = stream.read(min(_HEAD.size, end - position))
        opcode, length = _HEAD.unpack(head) if len(head) == _HEAD.size else (-1, 0)
        if opcode == 0:
            yield Fault(position, end - position, f"no record at byte {position}: the file is damaged from there on")
            return
        record_end = position + len(head) + length
        content = stream.read(min(length, end - position - len(head)))
        cut = opcode == -1 or len(content) < length
        if opcode == Opcode.CHUNK:
            yield from _chunk_leaves(content, position, min(record_end, end), cut=cut)
        elif cut:
            yield Fault(position, end - position, f"cut inside a record: its {end - position} bytes are lost")
        else:
            yield from _leaf(opcode, content, position, record_end)
        if cut:
            return
        position = record_end


def _leaf(opcode: int, content: bytes, offset: int, end: int) -> Iterator[Leaf | Fault]:
    """Yield the record, nothing if it is of no interest, or the fault in it."""
    try:
        if opcode == Opcode.MESSAGE:
            channel, sequence, log_ns, publish_ns = _MESSAGE_HEAD.unpack_from(content)
            message = McapMessage(channel, sequence, log_ns, publish_ns, content[_MESSAGE_HEAD.size :])
            yield Leaf(message, offset, end)
        elif opcode in _PARSERS:
            yield Leaf(_PARSERS[opcode](ReadDataStream(io.BytesIO(content))), offset, end)
    except (struct.error, McapError, UnicodeDecodeError) as error:
        yield Fault(offset, len(content), f"record of type {opcode} at byte {offset} does not parse: {fault_in(error)}")


def _chunk_leaves(content: bytes, offset: int, end: int, *, cut: bool) -> Iterator[Leaf | Fault]:
    try:
        records, size = _uncompress(content, cut=cut)
    except ValueError as error:
        yield Fault(offset, end - offset, f"chunk at byte {offset} ({end - offset} bytes): {error}")
        return
    position = 0
    while position + _HEAD.size <= len(records):
        opcode, length = _HEAD.unpack_from(records, position)
        body = position + _HEAD.size
        if opcode == 0 or body + length > len(records):
            break
        yield from _leaf(opcode, records[body : body + length], offset, end)
        position = body + length
    lost = size - position
    if cut:
        yield Fault(offset, lost, f"cut inside the chunk at byte {offset}: {position} of {size} bytes of records saved")
    elif lost:
        yield Fault(offset, lost, f"chunk at byte {offset}: {lost} bytes at its end are no record")


def _uncompress(content: bytes, *, cut: bool) -> tuple[bytes, int]:
    """Return the records of a chunk, as far as they go if it is cut, and their full size (bytes).

    Raises ValueError for damage. A zstd block (128 kB uncompressed) comes whole or not at all.
    """
    stream = ReadDataStream(io.BytesIO(content))
    try:
        _, _, size, crc = _CHUNK_HEAD.unpack(stream.read(_CHUNK_HEAD.size))
        compression = stream.read_prefixed_string()
        stream.read8()  # length of the data: what is there counts
        data = content[stream.count :]
        records = _decompressed(compression, data)
    except (struct.error, McapError, UnicodeDecodeError) as error:
        raise ValueError(f"damaged head ({fault_in(error)})") from error
    if not cut and len(records) != size:
        raise ValueError(f"{len(records)} bytes when uncompressed, expected {size}")
    if not cut and crc and zlib.crc32(records) != crc:
        raise ValueError(f"CRC {zlib.crc32(records):08x}, expected {crc:08x}")
    return records, size


def _decompressed(compression: str, data: bytes) -> bytes:
    """Undo the compression of a chunk, as far as the data go."""
    if not compression:
        return data
    try:
        if compression == "zstd":
            return zstandard.ZstdDecompressor().decompressobj().decompress(data)
        if compression == "lz4":
            lz4_frame = import_module("lz4.frame")  # has no type information
            return bytes(lz4_frame.LZ4FrameDecompressor().decompress(data))
    except (zstandard.ZstdError, RuntimeError, MemoryError) as error:
        raise ValueError(f"does not uncompress ({error})") from error
    raise ValueError(f"compression {compression!r}, expected zstd, lz4 or none")


class McapSink:
    """Writes an MCAP file (profile ros2, zstd chunks) to a stream that the caller opened and will close.

    Every method may raise the stream's OSError.
    """

    def __init__(self, stream: BinaryIO, library: str, profile: str = "ros2") -> None:
        self._stream = stream
        self._writer = Writer(stream)
        self._writer.start(profile=profile, library=library)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record right away, outside of the chunks."""
        self._writer.add_metadata(name, dict(values))

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Declare a type; return its id in this file."""
        schema_id: int = self._writer.register_schema(name, encoding, data)
        return schema_id

    def add_channel(self, topic: str, encoding: str, schema_id: int, metadata: Mapping[str, str]) -> int:
        """Declare a topic; return its id in this file."""
        channel_id: int = self._writer.register_channel(topic, encoding, schema_id, dict(metadata))
        return channel_id

    def add_message(self, message: McapMessage) -> None:
        """Append a message; its channel_id must be of this file."""
        self._writer.add_message(
            message.channel_id, message.log_time_ns, message.data, message.publish_time_ns, message.sequence
        )

    def add_attachment(self, attachment: Attachment) -> None:
        """Copy an attachment."""
        self._writer.add_attachment(
            attachment.create_time, attachment.log_time, attachment.name, attachment.media_type, attachment.data
        )

    def flush(self) -> None:
        """End the chunk in progress and hand all bytes to the operating system."""
        flush: Callable[[], None] = self._writer.flush  # the package leaves some methods without annotations
        flush()

    def finish(self) -> None:
        """Write index and summary and hand all bytes to the operating system."""
        finish: Callable[[], None] = self._writer.finish
        finish()
        self._stream.flush()
