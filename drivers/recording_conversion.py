"""Turn any recording that can be read into one MCAP file of ours.

What is stored as ROS messages is copied byte for byte, of whatever type; other formats are written as the messages that
they hold. Nothing that can be read is left out without a word.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from drivers.errors import RecordingError
from drivers.realsense_bag import RealsenseBag
from drivers.recording_mcap import McapMessage, McapSink
from drivers.recording_mcap_file import McapFile
from drivers.recording_reader import BagRecording, Recording
from drivers.recording_recovery import RecordCopy, copy_records, read_header
from drivers.recording_sqlite import SqliteFile, SqliteTopic
from drivers.recording_writer import MessageChannels, create_file, library
from drivers.ros_codec import default_topic
from drivers.ros_store import is_known, schema_text, type_hash


@dataclass(frozen=True, slots=True)
class ConversionReport:
    """topics: messages written by topic. left_out: those that are not read, by type. problems: damage of the source."""

    topics: Mapping[str, int]
    left_out: Mapping[str, int]
    problems: tuple[str, ...]

    @property
    def messages(self) -> int:
        """How many messages were written."""
        return sum(self.topics.values())


def convert(recording: Recording, destination: Path) -> ConversionReport:
    """Write all of an open recording to a new MCAP file.

    Raises RecordingError if the file exists, cannot be written, or nothing can be read; then no file is left behind.
    """
    try:
        target = create_file(destination)
    except FileExistsError as error:
        raise RecordingError(f"{destination}: exists already; name a new file, none is overwritten") from error
    except OSError as error:
        raise RecordingError(f"{destination}: cannot be created ({error.strerror or error})") from error
    done = False
    try:
        with target:
            if isinstance(recording, BagRecording):
                report = _copy_bag(recording, target)
            elif isinstance(recording, RealsenseBag):
                report = _write_realsense(recording, target)
            else:
                report = _write_messages(recording, target)
        if not report.topics:
            why = f" ({report.problems[0]})" if report.problems else ""
            raise RecordingError(f"{recording.path}: no message in it can be read{why}")
        done = True
    except OSError as error:
        raise RecordingError(f"{error.filename or destination}: {error.strerror or error}; nothing was kept") from error
    finally:
        if not done:
            destination.unlink(missing_ok=True)
    return report


def _write_messages(recording: Recording, target: BinaryIO) -> ConversionReport:
    sink = McapSink(target, library())
    report = _write_to(recording, sink)
    sink.finish()
    return report


def _write_to(recording: Recording, sink: McapSink) -> ConversionReport:
    sink.add_metadata("mapfuse.source", {"file": recording.path.name})
    for name, values in recording.metadata.items():
        sink.add_metadata(name, values)
    channels = MessageChannels(sink, exact_scans=True, start_ns=max(recording.start_ns, 0))
    written: Counter[str] = Counter()
    unwritten: Counter[str] = Counter()
    for message in recording.messages():
        topic = default_topic(message)
        try:
            channels.write(topic, message)
        except RecordingError as error:
            unwritten[f"{topic}: {error}"] += 1
        else:
            written[topic] += 1
    lost = [f"{text} ({count} times)" for text, count in unwritten.items()]
    return ConversionReport(dict(written), recording.skipped, (*recording.problems, *lost))


def _write_realsense(recording: RealsenseBag, target: BinaryIO) -> ConversionReport:
    """Write the depth images as ours and everything else as it is, on its own topics.

    Log times of the file count from its start: they are moved to the wall clock by the first image's stamp.
    """
    sink = McapSink(target, library())
    start_ns = min((image.stamp_ns for image in recording), default=0)
    depth = _write_to(recording, sink)
    schemas: dict[str, int] = {}
    channels: dict[tuple[str, str], int] = {}
    written: Counter[str] = Counter()
    for stored in recording.others():
        name = stored.type_name
        if name not in schemas:
            schemas[name] = sink.add_schema(name, "ros2msg", recording.schema_text(name).encode())
        if (stored.topic, name) not in channels:
            channels[stored.topic, name] = sink.add_channel(stored.topic, "cdr", schemas[name], {})
        written[stored.topic] += 1
        time_ns = start_ns + stored.log_time_ns - recording.start_ns
        channel = channels[stored.topic, name]
        sink.add_message(McapMessage(channel, written[stored.topic], time_ns, time_ns, stored.data))
    sink.finish()
    problems = tuple(dict.fromkeys((*depth.problems, *recording.problems)))
    return ConversionReport({**depth.topics, **written}, dict(recording.untranslated), problems)


def _copy_bag(recording: BagRecording, target: BinaryIO) -> ConversionReport:
    first = recording.storages[0]
    header = read_header(first.path) if isinstance(first, McapFile) else None
    sink = McapSink(target, library(), "ros2" if header is None else header.profile)
    written: Counter[str] = Counter()
    lost: list[str] = []
    for storage in recording.storages:
        if isinstance(storage, McapFile):
            copy = RecordCopy(sink, storage.index)
            faults = [f"{storage.path.name}: {fault.text}" for fault in copy_records(storage.path, copy)]
            lost += [text for text in faults if text not in recording.problems]
            if copy.orphans:
                lost.append(f"{storage.path.name}: {copy.orphans} messages whose channel was in a lost chunk")
            written += copy.topics
        elif isinstance(storage, SqliteFile):
            written += _copy_rows(storage, sink)
    sink.finish()
    return ConversionReport(dict(written), {}, (*recording.problems, *lost))


def _copy_rows(storage: SqliteFile, sink: McapSink) -> Counter[str]:
    channels = {topic.name: _declare(topic, sink) for topic in storage.declarations()}
    written: Counter[str] = Counter()
    for stored in storage.messages(set(channels)):
        written[stored.topic] += 1
        sink.add_message(
            McapMessage(
                channel_id=channels[stored.topic],
                sequence=written[stored.topic],
                log_time_ns=stored.log_time_ns,
                publish_time_ns=stored.log_time_ns,
                data=stored.data,
            )
        )
    return written


def _declare(topic: SqliteTopic, sink: McapSink) -> int:
    """Declare a topic with the definition of its type: the file's own, else that of a standard ROS 2, else none."""
    metadata = {"offered_qos_profiles": topic.qos}
    definition = topic.definition
    if is_known(topic.type_name) and not definition:
        definition = schema_text(topic.type_name)
        metadata["topic_type_hash"] = type_hash(topic.type_name)
    schema = sink.add_schema(topic.type_name, "ros2msg" if definition else "", definition.encode())
    return sink.add_channel(topic.name, topic.encoding, schema, metadata)
