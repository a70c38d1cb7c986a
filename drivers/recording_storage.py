"""What each storage of a recording (MCAP, SQLite) offers to the reader: topics, and messages in the order of time."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

Metadatas = Mapping[str, Mapping[str, str]]


@dataclass(frozen=True, slots=True)
class StoredTopic:
    """One topic of a file; type_name is empty where the file does not hold it as CDR with a ROS type."""

    name: str
    type_name: str
    count: int


@dataclass(frozen=True, slots=True)
class StoredMessage:
    """One message as stored: the bytes, and when they were received."""

    topic: str
    type_name: str
    log_time_ns: int
    data: bytes


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """One topic of a recording; decoded: its messages are of a kind that a recording can yield."""

    name: str
    type: str
    count: int
    decoded: bool


class Storage(Protocol):
    """One open file of a recording.

    `problems` and `truncated` tell what is known so far: damage inside the file may show only while reading.
    start_ns and end_ns are 0 in a file without messages.
    """

    path: Path
    topics: list[StoredTopic]
    metadata: Metadatas
    start_ns: int
    end_ns: int
    truncated: bool
    problems: list[str]

    def messages(self, topics: Collection[str]) -> Iterator[StoredMessage]:
        """Yield the messages of these topics in the order of their log times, up to the first damage."""
        ...

    def verify(self) -> tuple[list[str], list[str]]:
        """Read everything; return what is wrong with the file itself, and what is worth knowing about it."""
        ...

    def close(self) -> None:
        """Release the file; closing twice is allowed."""
        ...
