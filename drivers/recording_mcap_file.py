"""One MCAP file as the storage of a recording: by its summary if it has one, else by a walk through all of it."""

from __future__ import annotations

import heapq
import zlib
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from drivers.recording_mcap import (
    MAGIC,
    Channel,
    ChunkIndex,
    DataEnd,
    Fault,
    Footer,
    Leaf,
    McapMessage,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    walk,
)
from drivers.recording_storage import Metadatas, StoredMessage, StoredTopic

_FOOTER_BYTES = 9 + 20  # head of the record, content
_SPAN_BYTES = 1 << 20  # messages outside of chunks are read in stretches of this size
_DISORDER_NS = 1_000_000_000


@dataclass(slots=True)
class Span:
    """A stretch of the file (bytes) with the messages of these times (ns), read as a whole."""

    offset: int
    end: int
    start_ns: int
    end_ns: int


@dataclass(slots=True)
class McapIndex:
    """What a file holds and where; counts and problems are complete up to the first fault."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    spans: list[Span] = field(default_factory=list)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    start_ns: int = 0
    end_ns: int = 0
    disorder_ns: int = 0  # the longest step back in time, known after a walk only
    problems: list[str] = field(default_factory=list)
    data_end: tuple[int, int] | None = None  # where the data section ends (byte), and its CRC (0: not given)


class McapFile:
    """One open MCAP file; see Storage. Raises OSError when it cannot be opened."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._stream = path.open("rb")
        try:
            self._size = path.stat().st_size
            self.index = summary_index(self._stream, self._size) or walked_index(self._stream, self._size)
        except BaseException:
            self._stream.close()
            raise
        index = self.index
        self.metadata: Metadatas = index.metadata
        self.start_ns, self.end_ns = index.start_ns, index.end_ns
        self.problems = index.problems
        self.truncated = index.data_end is None
        if index.data_end and not self._ends_with_magic():
            self.truncated = True
            self.problems.append("cut behind its last message: the summary is lost, no message is")
        self.topics = _stored_topics(index)
        self._known_faults = frozenset(self.problems)

    def messages(self, topics: Collection[str]) -> Iterator[StoredMessage]:
        """Yield the messages of these topics in the order of their log times, up to the first damage.

        Chunks may overlap in time: a heap holds the messages of those that do, no more.
        """
        index = self.index
        channels = {id_: channel for id_, channel in index.channels.items() if channel.topic in topics}
        pending: list[tuple[int, int, McapMessage]] = []
        order = 0
        for span in sorted(index.spans, key=lambda span: (span.start_ns, span.offset)):
            while pending and pending[0][0] < span.start_ns:
                yield self._stored(heapq.heappop(pending)[2])
            fault = None
            for leaf in walk(self._stream, span.offset, span.end):
                if isinstance(leaf, Fault):
                    fault = leaf
                    break
                if isinstance(leaf.record, McapMessage) and leaf.record.channel_id in channels:
                    heapq.heappush(pending, (leaf.record.log_time_ns, order, leaf.record))
                    order += 1
            if fault and fault.text not in self._known_faults:  # what the index knows of it has left out
                self._note(fault)
                break
        while pending:
            yield self._stored(heapq.heappop(pending)[2])

    def verify(self) -> tuple[list[str], list[str]]:
        """Read everything; return what is wrong with the file itself, and what is worth knowing about it."""
        walked = walked_index(self._stream, self._size, stop_at_fault=False)
        problems = list(walked.problems)
        if not self._data_crc_agrees(walked):
            problems.append("the CRC of the data section does not agree")
        summary = summary_index(self._stream, self._size)
        if summary is None:
            problems.append("no usable summary at its end: readers without a fallback see nothing")
        elif summary.counts != walked.counts:
            total, found = summary.counts.total(), walked.counts.total()
            problems.append(f"the summary counts {total} messages, the file holds {found} readable ones")
        orphans = [channel for channel in walked.channels.values() if channel.schema_id not in {0, *walked.schemas}]
        problems += [f"{channel.topic}: its schema {channel.schema_id} is missing" for channel in orphans]
        notes = []
        if walked.disorder_ns > _DISORDER_NS:
            notes.append(f"log times in the file go back by up to {walked.disorder_ns / 1e9:.1f} s")
        return problems, notes

    def close(self) -> None:
        """Release the file; closing twice is allowed."""
        self._stream.close()

    def _stored(self, message: McapMessage) -> StoredMessage:
        channel = self.index.channels[message.channel_id]
        return StoredMessage(channel.topic, _type_name(self.index, channel), message.log_time_ns, message.data)

    def _ends_with_magic(self) -> bool:
        self._stream.seek(max(0, self._size - len(MAGIC)))
        return self._stream.read() == MAGIC

    def _data_crc_agrees(self, index: McapIndex) -> bool:
        if index.data_end is None or index.data_end[1] == 0:
            return True
        left, expected = index.data_end
        crc = 0
        self._stream.seek(0)
        while left > 0 and (block := self._stream.read(min(left, _SPAN_BYTES))):
            crc = zlib.crc32(block, crc)
            left -= len(block)
        return crc == expected

    def _note(self, fault: Fault) -> None:
        self.truncated = True
        if fault.text not in self.problems:
            self.problems.append(fault.text)


def _type_name(index: McapIndex, channel: Channel) -> str:
    schema = index.schemas.get(channel.schema_id)
    return schema.name if schema is not None and channel.message_encoding == "cdr" else ""


def _stored_topics(index: McapIndex) -> list[StoredTopic]:
    return [
        StoredTopic(channel.topic, _type_name(index, channel), index.counts[id_])
        for id_, channel in sorted(index.channels.items())
    ]


def summary_index(stream: BinaryIO, size: int) -> McapIndex | None:
    """Return the index that the file's own summary gives; None where it is missing, damaged or says too little."""
    tail = _FOOTER_BYTES + len(MAGIC)
    footer_start = size - tail
    if footer_start < len(MAGIC):
        return None
    stream.seek(footer_start)
    footer_bytes = stream.read(tail)
    leaf = next(walk(stream, footer_start, size - len(MAGIC)), None)
    footer = leaf.record if isinstance(leaf, Leaf) and footer_bytes.endswith(MAGIC) else None
    if not isinstance(footer, Footer) or not len(MAGIC) < footer.summary_start < footer_start:
        return None
    stream.seek(footer.summary_start)
    summary = stream.read(footer_start - footer.summary_start) + footer_bytes[: _FOOTER_BYTES - 4]
    if footer.summary_crc and footer.summary_crc != zlib.crc32(summary):
        return None
    return _read_summary(stream, footer.summary_start, footer_start)


def _read_summary(stream: BinaryIO, start: int, end: int) -> McapIndex | None:
    index = McapIndex(data_end=(start, 0))
    statistics = None
    places: list[MetadataIndex] = []
    for leaf in walk(stream, start, end):
        if isinstance(leaf, Fault):
            return None
        record = leaf.record
        if isinstance(record, ChunkIndex):
            chunk_end = record.chunk_start_offset + record.chunk_length
            index.spans.append(
                Span(record.chunk_start_offset, chunk_end, record.message_start_time, record.message_end_time)
            )
        elif isinstance(record, Statistics):
            statistics = record
        elif isinstance(record, MetadataIndex):
            places.append(record)
        else:
            _note_declaration(index, record)
    if statistics is None or len(places) != statistics.metadata_count:
        return None
    if len(index.spans) != statistics.chunk_count or (statistics.message_count and not index.spans):
        return None
    if not set(statistics.channel_message_counts) <= set(index.channels):
        return None
    index.counts.update(statistics.channel_message_counts)
    index.start_ns, index.end_ns = statistics.message_start_time, statistics.message_end_time
    for place in places:
        for leaf in walk(stream, place.offset, place.offset + place.length):
            if not isinstance(leaf, Fault):
                _note_declaration(index, leaf.record)
    return index


def walked_index(stream: BinaryIO, size: int, *, stop_at_fault: bool = True) -> McapIndex:
    """Return the index of what can be read from the start of the file on; memory does not grow with its size."""
    index = McapIndex()
    for leaf in walk(stream, len(MAGIC), size):
        if isinstance(leaf, Fault):
            index.problems.append(leaf.text)
            if stop_at_fault:
                return index
            continue
        record = leaf.record
        if isinstance(record, McapMessage):
            _note_message(index, record, leaf.offset, leaf.end)
        elif isinstance(record, DataEnd):
            index.data_end = (leaf.offset, record.data_section_crc)
            return index
        else:
            _note_declaration(index, record)
    index.problems.append("ends without its closing records: cut, or still being written")
    return index


def _note_declaration(index: McapIndex, record: object) -> None:
    if isinstance(record, Schema):
        index.schemas[record.id] = record
    elif isinstance(record, Channel):
        index.channels[record.id] = record
    elif isinstance(record, Metadata):
        index.metadata.setdefault(record.name, {}).update(record.metadata)


def _note_message(index: McapIndex, message: McapMessage, offset: int, end: int) -> None:
    """Count a message and put the record of the file that holds it into the last span or a new one."""
    time_ns = message.log_time_ns
    index.start_ns = min(time_ns, index.start_ns) if index.counts else time_ns
    index.end_ns = max(time_ns, index.end_ns)
    index.disorder_ns = max(index.disorder_ns, index.end_ns - time_ns)
    index.counts[message.channel_id] += 1
    last = index.spans[-1] if index.spans else None
    if last and (last.end == end or (last.end == offset and end - last.offset <= _SPAN_BYTES)):
        last.end, last.start_ns, last.end_ns = end, min(time_ns, last.start_ns), max(time_ns, last.end_ns)
    else:
        index.spans.append(Span(offset, end, time_ns, time_ns))
