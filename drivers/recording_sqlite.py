"""One SQLite file of a ROS 2 bag (.db3) as the storage of a recording.

Tables (rosbag2's storage_sqlite3): topics(id, name, type, serialization_format, ...) and
messages(id, topic_id, timestamp, data).
"""

from __future__ import annotations

import heapq
import sqlite3
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from drivers.errors import RecordingError
from drivers.recording_storage import Metadatas, StoredMessage, StoredTopic

MAGIC = b"SQLite format 3\0"
_SORT_WINDOW = 1000  # messages; rosbag2 writes in the order of arrival, give or take its cache


@dataclass(frozen=True, slots=True)
class SqliteTopic:
    """What a file says of a topic; qos and definition (of the type) are empty where it does not tell."""

    name: str
    type_name: str
    encoding: str
    qos: str
    definition: str


class SqliteFile:
    """One open .db3 file; see Storage. Raises RecordingError when it is no ROS 2 bag or nothing in it can be read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.metadata: Metadatas = {}
        self.problems: list[str] = []
        self.truncated = _is_cut(path)
        self._database = self._connect()
        try:
            self._read_tables()
        except sqlite3.DatabaseError as error:
            self.close()
            raise RecordingError(f"{path}: a damaged SQLite file ({error}); nothing in it can be read") from error
        except BaseException:
            self.close()
            raise

    def messages(self, topics: Collection[str]) -> Iterator[StoredMessage]:
        """Yield the messages of these topics in the order of their log times, up to the first damage."""
        wanted = {id_: topic for id_, topic in self._topics.items() if topic[0] in topics}
        rows = self._rows_as_written() if self.truncated else self._rows("ORDER BY timestamp, id")
        for topic_id, time_ns, _, data in rows:
            if topic_id in wanted:
                yield StoredMessage(*wanted[topic_id], time_ns, bytes(data))

    def declarations(self) -> list[SqliteTopic]:
        """Return what the file says of its topics, as a copy of it must say too."""
        rows = self._database.execute("SELECT * FROM topics ORDER BY id")
        names = [column[0] for column in rows.description]
        topics = [dict(zip(names, row, strict=True)) for row in rows]
        definitions = self._definitions()
        return [
            SqliteTopic(
                name=str(topic["name"]),
                type_name=str(topic["type"]),
                encoding=str(topic["serialization_format"]),
                qos=str(topic.get("offered_qos_profiles") or ""),
                definition=definitions.get(str(topic["type"]), ""),
            )
            for topic in topics
        ]

    def _definitions(self) -> dict[str, str]:
        """Return the text of each message type; files before ROS 2 Iron hold none."""
        query = "SELECT topic_type, encoded_message_definition FROM message_definitions WHERE encoding = 'ros2msg'"
        try:
            return {str(type_name): str(text) for type_name, text in self._database.execute(query)}
        except sqlite3.DatabaseError:
            return {}

    def verify(self) -> tuple[list[str], list[str]]:
        """Read everything; return what is wrong with the file itself, and what is worth knowing about it."""
        try:
            answers = [str(answer) for (answer,) in self._database.execute("PRAGMA integrity_check(5)")]
        except sqlite3.DatabaseError as error:
            answers = [str(error)]
        problems = [*self.problems, *(answer for answer in answers if answer != "ok")]
        return list(dict.fromkeys(problems)), []

    def close(self) -> None:
        """Release the file; closing twice is allowed."""
        self._database.close()

    def _connect(self) -> sqlite3.Connection:
        """Open without writing a byte: bags lie on read-only disks, and a journal of ours beside them is litter.

        Only messages that the writer left in its write-ahead log need the ordinary, locking way of opening.
        """
        uri = f"file:{quote(str(self.path.absolute()))}?mode=ro"
        log = self.path.with_name(self.path.name + "-wal")
        if log.is_file() and log.stat().st_size:
            database = sqlite3.connect(uri, uri=True)
            try:
                database.execute("SELECT count(*) FROM sqlite_master")
            except sqlite3.DatabaseError as error:
                database.close()
                self.problems.append(
                    f"its write-ahead log {log.name} cannot be read ({error}): the last messages are lost"
                )
                self.truncated = True
            else:
                return database
        return sqlite3.connect(f"{uri}&immutable=1", uri=True)

    def _read_tables(self) -> None:
        if self.truncated:
            self.problems.append("shorter than its own header says: cut; read as far as it goes")
            self._database.execute("PRAGMA writable_schema = ON")  # else SQLite refuses a file with missing pages
        tables = {name for (name,) in self._database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not {"topics", "messages"} <= tables:
            raise RecordingError(f"{self.path}: an SQLite file without the tables of a ROS 2 bag (topics, messages)")
        self._topics = {
            id_: (name, type_name if encoding == "cdr" else "")
            for id_, name, type_name, encoding in self._database.execute(
                "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
            )
        }
        counts: Counter[int] = Counter()
        times: list[int] = []
        for topic_id, count, first_ns, last_ns in self._count():
            counts[topic_id] += count
            times += [first_ns, last_ns]
        self.start_ns, self.end_ns = (min(times), max(times)) if times else (0, 0)
        self.topics = [StoredTopic(*topic, counts[id_]) for id_, topic in self._topics.items()]

    def _count(self) -> Iterator[tuple[int, int, int, int]]:
        """Yield (topic id, messages, first time, last time), several times per topic if rows must be counted singly."""
        if not self.truncated:
            try:
                rows = self._database.execute(
                    "SELECT topic_id, COUNT(*), MIN(timestamp), MAX(timestamp) FROM messages GROUP BY topic_id"
                ).fetchall()
                if not all(isinstance(value, int) for row in rows for value in row):
                    raise sqlite3.DatabaseError("a time that is no integer")
            except sqlite3.DatabaseError as error:
                self._note(error)
            else:
                yield from rows
                return
        for topic_id, time_ns, _, _ in self._rows("ORDER BY id"):
            yield topic_id, 1, time_ns, time_ns

    def _rows(self, order: str) -> Iterator[tuple[int, int, int, bytes]]:
        """Yield (topic id, time, row id, data) up to the first damage; a cut page reads as empty rows."""
        query = f"SELECT topic_id, timestamp, id, data FROM messages {order}"  # noqa: S608 - our own two literals
        try:
            for topic_id, time_ns, id_, data in self._database.execute(query):
                if not (isinstance(time_ns, int) and isinstance(data, bytes)):
                    raise sqlite3.DatabaseError(f"row {id_} of messages holds no message")
                yield topic_id, time_ns, id_, data
        except sqlite3.DatabaseError as error:
            self._note(error)

    def _rows_as_written(self) -> Iterator[tuple[int, int, int, bytes]]:
        """Yield the rows of a damaged file, whose index by time may be lost: in row order, sorted within a window."""
        window: list[tuple[int, int, int, bytes]] = []
        for topic_id, time_ns, id_, data in self._rows("ORDER BY id"):
            heapq.heappush(window, (time_ns, id_, topic_id, data))
            if len(window) > _SORT_WINDOW:
                time_ns, id_, topic_id, data = heapq.heappop(window)  # noqa: PLW2901 - the oldest instead of the newest
                yield topic_id, time_ns, id_, data
        for time_ns, id_, topic_id, data in sorted(window):
            yield topic_id, time_ns, id_, data

    def _note(self, error: sqlite3.DatabaseError) -> None:
        self.truncated = True
        text = f"damaged ({error}); read as far as it goes"
        if text not in self.problems:
            self.problems.append(text)


def _is_cut(path: Path) -> bool:
    """Tell whether the file is shorter than the page count in its header (https://sqlite.org/fileformat.html, 1.3)."""
    with path.open("rb") as stream:
        header = stream.read(100)
    page_bytes = int.from_bytes(header[16:18], "big")
    pages = int.from_bytes(header[28:32], "big")
    return path.stat().st_size < (65536 if page_bytes == 1 else page_bytes) * pages
