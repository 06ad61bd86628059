"""Read sqlite3 storage files of rosbag2 (.db3), read-only and in log order."""

from __future__ import annotations

import sqlite3
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

from tccm_ros.bags.storage import Channel, RawMessage, StorageDamage, reading

__all__ = ["MAGIC", "SqliteFile"]

MAGIC = b"SQLite format 3\0"
ADVICE = "; try `tccm recover`"


class SqliteFile:
    """One sqlite3 file; attributes and methods as in McapFile.

    Raises
    ------
    BagError
        For a file that is missing, empty, no rosbag2 database, or damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.channels: dict[int, Channel] = {}
        self.start_ns = self.end_ns = 0
        self._counts: Counter[int] | None = None
        with reading(path, ADVICE), _database_errors():
            with path.open("rb") as stream:
                if stream.read(len(MAGIC)) != MAGIC:
                    raise StorageDamage("no sqlite3 file (its first bytes are others)")
            self._connection = _connect(path)
            try:
                self._open()
            except BaseException:
                self._connection.close()
                raise

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def counts(self) -> Counter[int]:
        """Return the number of messages by channel."""
        if self._counts is None:
            with reading(self.path, ADVICE), _database_errors():
                rows = self._connection.execute(
                    "SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id"
                )
                self._counts = Counter({int(topic): int(count) for topic, count in rows})
        return self._counts

    def messages(self, channels: Collection[int]) -> Iterator[RawMessage]:
        """Yield the messages of some channels in log order; equal times in the order of ids.

        Raises
        ------
        BagError
            At the first damaged page, after all messages before it.
        """
        wanted = ", ".join(str(int(channel)) for channel in sorted(channels))
        with reading(self.path, ADVICE), _database_errors():
            rows = self._connection.execute(
                "SELECT timestamp, topic_id, data FROM messages "
                f"WHERE topic_id IN ({wanted}) ORDER BY timestamp, id"
            )
        while True:
            with reading(self.path, ADVICE), _database_errors():
                row = rows.fetchone()
                message = None if row is None else _message(row)
            if message is None:
                return
            yield message

    def salvage(self) -> Iterator[RawMessage]:
        """Yield what can be read of a damaged file: from its first row on, then from its last."""
        seen = -1
        for order in ("ASC", "DESC"):
            try:
                rows = self._connection.execute(
                    "SELECT timestamp, topic_id, data, id FROM messages "
                    f"WHERE id > {seen} ORDER BY id {order}"
                )
                for row in rows:
                    if order == "ASC":
                        seen = int(row[3])
                    yield _message(row[:3])
                return
            except (sqlite3.Error, ValueError, TypeError, OverflowError):
                continue

    def _open(self) -> None:
        kinds = dict(self._connection.execute("SELECT name, type FROM sqlite_master").fetchall())
        if kinds.get("topics") != "table" or kinds.get("messages") != "table":
            raise StorageDamage("a database without the tables topics and messages")
        columns = {row[1] for row in self._connection.execute("PRAGMA table_info(topics)")}
        qos = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
        definitions = self._definitions(kinds)
        for number, topic, msgtype, encoding, offered in self._connection.execute(
            f"SELECT id, name, type, serialization_format, {qos} FROM topics ORDER BY id"
        ):
            text, text_encoding = definitions.get(str(msgtype), ("", ""))
            self.channels[int(number)] = Channel(
                str(topic), str(msgtype), str(encoding), text, text_encoding, str(offered or "")
            )
        low, high = self._connection.execute(
            "SELECT (SELECT MIN(timestamp) FROM messages), (SELECT MAX(timestamp) FROM messages)"
        ).fetchone()
        self.start_ns, self.end_ns = int(low or 0), int(high or 0)

    def _definitions(self, kinds: dict[str, str]) -> dict[str, tuple[str, str]]:
        """Return definition and its encoding by type; bags before Iron have none."""
        if kinds.get("message_definitions") != "table":
            return {}
        rows = self._connection.execute(
            "SELECT topic_type, encoded_message_definition, encoding FROM message_definitions"
        )
        return {str(name): (str(text), str(encoding)) for name, text, encoding in rows}


def _message(row: tuple[Any, ...]) -> RawMessage:
    log_ns, channel, data = row
    if not isinstance(data, bytes):
        raise StorageDamage(f"a message is {type(data).__name__}, expected bytes")
    return RawMessage(int(log_ns), int(channel), data)


def _connect(path: Path) -> sqlite3.Connection:
    """Open read-only; a write-ahead log in a folder that cannot be written is left aside."""
    name = f"file:{quote(str(path.absolute()))}?mode=ro"
    try:
        connection = sqlite3.connect(name, uri=True)
        connection.execute("SELECT name FROM sqlite_master LIMIT 1").fetchone()
    except sqlite3.OperationalError:
        connection = sqlite3.connect(f"{name}&immutable=1", uri=True)
    connection.execute("PRAGMA query_only = ON")
    connection.execute("PRAGMA trusted_schema = OFF")
    connection.text_factory = lambda data: data.decode(errors="replace")
    return connection


@contextmanager
def _database_errors() -> Iterator[None]:
    """Let `reading` see sqlite3's errors, and columns of another type, as damage."""
    try:
        yield
    except (sqlite3.Error, TypeError) as error:
        raise StorageDamage(str(error)) from None
