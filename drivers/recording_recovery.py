"""Repair MCAP files that lost their end, and check recordings for damage."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

import numpy as np

from drivers.errors import RecordingError
from drivers.recording_files import open_storage, open_storages
from drivers.recording_mcap import (
    MAGIC,
    Attachment,
    Channel,
    DataEnd,
    Fault,
    Header,
    Leaf,
    McapMessage,
    McapSink,
    Metadata,
    Schema,
    walk,
)
from drivers.recording_mcap_file import McapFile, McapIndex
from drivers.recording_reader import open_other, read_through
from drivers.recording_storage import Storage
from drivers.ros_codec import decode, is_decodable
from drivers.wording import counted

_GAP_NS = 1_000_000_000
_GAP_FACTOR = 10  # times the usual interval of the topic
_FEWEST_INTERVALS = 10
_ONLY_MCAP = "`bag recover` is for MCAP; `bag convert` writes to a new MCAP file what can be read of everything else"


@dataclass(frozen=True, slots=True)
class RecoveryReport:
    """What was saved, in all and per topic; lost_bytes: what gave no record (in a cut chunk: uncompressed bytes)."""

    messages: int
    topics: Mapping[str, int]
    lost_bytes: int
    problems: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class CheckReport:
    """problems: damage, one line each; ok: there is none. notes: what is worth knowing, as gaps in a topic."""

    ok: bool
    problems: tuple[str, ...]
    notes: tuple[str, ...]


def recover(source: Path, destination: Path) -> RecoveryReport:
    """Copy every record of an MCAP file that can be read to a new one with a new index and summary.

    Reads past damaged chunks; a metadata record "recovered" says what was lost. Raises RecordingError if the source
    is not MCAP or holds no readable message, and if the destination exists: nothing is ever overwritten.
    """
    _refuse_unrecoverable(source)
    storage = open_storage(source)
    try:
        if not isinstance(storage, McapFile):
            raise RecordingError(f"{source}: an SQLite bag; {_ONLY_MCAP} (or try `sqlite3 .recover`)")
        with destination.open("xb") as target:
            report = _copy(source, target, storage)
    except FileExistsError as error:
        raise RecordingError(f"{destination}: exists already; name a new file, none is overwritten") from error
    except OSError as error:
        raise RecordingError(f"{destination}: cannot be written ({error.strerror or error})") from error
    finally:
        storage.close()
    if not report.messages:
        destination.unlink()
        why = "; ".join(report.problems[:1])
        raise RecordingError(f"{source}: no readable message in it, nothing to recover ({why})")
    return report


def _refuse_unrecoverable(source: Path) -> None:
    """Raise RecordingError for what is no file that could be MCAP."""
    if source.is_dir():
        raise RecordingError(f"{source}: a folder: name one MCAP file; {_ONLY_MCAP}")
    other = open_other(source)
    if other is not None:
        other.close()
        raise RecordingError(f"{source}: no MCAP file; {_ONLY_MCAP}")


def check(path: Path, *, intrinsics: Path | None = None) -> CheckReport:
    """Read all of a recording: CRCs, summary, declarations, order and gaps of log times, decoding of the known types.

    Formats without checksums are read to their end. intrinsics: see open_recording. Raises RecordingError for what
    `open_recording` refuses, but for a bag without messages.
    """
    other = open_other(path, intrinsics=intrinsics)
    if other is not None:
        with other:
            read_through(other)
            left_out = tuple(f"{count} {name} are not read by replay" for name, count in other.skipped.items())
            return CheckReport(not other.problems, tuple(other.problems), left_out)
    storages, problems = open_storages(path)
    notes: list[str] = []
    for storage in storages:
        try:
            damage, remarks = storage.verify()
            damage += _undecodable(storage)
            remarks += _gaps(storage)
        finally:
            storage.close()
        problems += [f"{storage.path.name}: {text}" for text in damage]
        notes += [f"{storage.path.name}: {text}" for text in remarks]
    return CheckReport(not problems, tuple(problems), tuple(notes))


class RecordCopy:
    """Copies records into a new file, where channels and schemas get new ids."""

    def __init__(self, sink: McapSink, index: McapIndex) -> None:
        self._sink = sink
        self._schemas = dict(index.schemas)
        self._channels = dict(index.channels)
        self._schema_ids: dict[int, int] = {0: 0}  # 0 says: no schema
        self._channel_ids: dict[int, int] = {}
        self.topics: Counter[str] = Counter()
        self.orphans = 0

    def add(self, record: object) -> None:
        """Copy one record; messages of channels that were lost are counted in `orphans`."""
        if isinstance(record, McapMessage):
            if record.channel_id in self._channels:
                self._sink.add_message(replace(record, channel_id=self._channel_id(record.channel_id)))
                self.topics[self._channels[record.channel_id].topic] += 1
            else:
                self.orphans += 1
        elif isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel):
            self._channels[record.id] = record
        elif isinstance(record, Metadata):
            self._sink.add_metadata(record.name, record.metadata)
        elif isinstance(record, Attachment):
            self._sink.add_attachment(record)

    def _channel_id(self, old: int) -> int:
        if old not in self._channel_ids:
            channel = self._channels[old]
            schema = self._schemas.get(channel.schema_id)
            if schema and schema.id not in self._schema_ids:
                self._schema_ids[schema.id] = self._sink.add_schema(schema.name, schema.encoding, schema.data)
            schema_id = self._schema_ids.get(channel.schema_id, 0)
            encoding, metadata = channel.message_encoding, channel.metadata
            self._channel_ids[old] = self._sink.add_channel(channel.topic, encoding, schema_id, metadata)
        return self._channel_ids[old]


def read_header(source: Path) -> Header:
    """Return the first record of an MCAP file; one of profile ros2 where it is damaged."""
    with source.open("rb") as stream:
        first = next(walk(stream, len(MAGIC), source.stat().st_size), None)
    return first.record if isinstance(first, Leaf) and isinstance(first.record, Header) else Header("ros2", "")


def copy_records(source: Path, copy: RecordCopy) -> list[Fault]:
    """Copy all records of an MCAP file that can be read; return where some could not."""
    faults: list[Fault] = []
    with source.open("rb") as stream:
        for leaf in walk(stream, len(MAGIC), source.stat().st_size):
            if isinstance(leaf, Fault):
                faults.append(leaf)
            elif isinstance(leaf.record, DataEnd):
                break
            else:
                copy.add(leaf.record)
    return faults


def _copy(source: Path, target: BinaryIO, storage: McapFile) -> RecoveryReport:
    header = read_header(source)
    sink = McapSink(target, header.library, header.profile)
    copy = RecordCopy(sink, storage.index)
    faults = copy_records(source, copy)
    problems = [fault.text for fault in faults]
    if copy.orphans:
        problems.append(f"{copy.orphans} messages whose channel was in a lost chunk")
    lost_bytes = sum(fault.lost_bytes for fault in faults)
    if problems:
        sink.add_metadata("recovered", {"lost_bytes": str(lost_bytes), "problems": "; ".join(problems)})
    sink.finish()
    return RecoveryReport(copy.topics.total(), dict(copy.topics), lost_bytes, tuple(problems))


def _undecodable(storage: Storage) -> list[str]:
    """Return one line per topic whose messages are of a known type, but do not decode."""
    known = {topic.name for topic in storage.topics if is_decodable(topic.type_name, topic.name)}
    failed: dict[str, list[str]] = {}
    for message in storage.messages(known):
        if is_decodable(message.type_name, message.topic):
            try:
                decode(message.type_name, message.data, message.topic, message.log_time_ns)
            except RecordingError as error:
                failed.setdefault(message.topic, []).append(str(error))
    return [f"{counted(len(texts), 'message')} not decoded, the first one: {texts[0]}" for texts in failed.values()]


def _gaps(storage: Storage) -> list[str]:
    """Return one line per topic that fell silent for over 1 s and 10 times its usual interval."""
    times: dict[str, array[int]] = {}
    for message in storage.messages({topic.name for topic in storage.topics}):
        times.setdefault(message.topic, array("q")).append(message.log_time_ns)
    lines = []
    for topic, stamps in times.items():
        intervals = np.diff(np.array(stamps))
        if intervals.size < _FEWEST_INTERVALS:
            continue
        usual, longest = float(np.median(intervals)), int(intervals.max())
        if longest > max(_GAP_NS, _GAP_FACTOR * usual):
            at_s = (stamps[int(intervals.argmax())] - storage.start_ns) / 1e9
            every = f"usually one every {usual / 1e6:.0f} ms"
            lines.append(f"{topic}: {longest / 1e9:.1f} s without a message, {at_s:.1f} s after the start ({every})")
    return lines
