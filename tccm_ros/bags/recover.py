"""Copy what can be read of a truncated or damaged bag into a new one.

An mcap file is walked record by record, as the mcap library reads them; where the walk meets
damage it goes on at the next chunk that is whole by its sizes. A sqlite3 file is read from both
ends, with what its write-ahead log holds.
"""

from __future__ import annotations

import mmap
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import zstandard
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC
from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos

from tccm_ros.bags.bag_files import storage_paths, unpacked
from tccm_ros.bags.storage import MAX_BLOCK_BYTES, SQLITE_MAGIC, reading
from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.bags.writer import BagWriter
from tccm_ros.errors import BagError
from tccm_ros.progress import Bars, Silent

__all__ = ["Recovered", "recover"]

RECORD_KINDS = frozenset(Opcode)
"""Other kinds of records are taken for damage."""

HEADER_BYTES = 9
CHUNK_BYTES = 40
"""Sizes of a record's header, and of a chunk without the name of its compression and its data."""

_u64 = struct.Struct("<Q").unpack_from
_u32 = struct.Struct("<I").unpack_from


class _Topic(NamedTuple):
    """A topic as a storage file describes it; `qos` is rosbag2's YAML text."""

    name: str
    msgtype: str
    definition: str
    definition_encoding: str
    qos: str


@dataclass
class Recovered:
    """What `recover` found.

    Attributes
    ----------
    messages
        Messages in the new bag.
    topics
        Topics in the new bag.
    skipped_bytes
        Bytes that belong to no whole record, of all files.
    damaged_chunks
        Chunks whose sizes are right but whose checksum or content is wrong.
    unknown_messages
        Messages of a topic whose name is lost.
    """

    messages: int = 0
    topics: int = 0
    skipped_bytes: int = 0
    damaged_chunks: int = 0
    unknown_messages: int = 0

    def __str__(self) -> str:
        return (
            f"{self.messages} messages on {self.topics} topics; lost: {self.skipped_bytes} bytes, "
            f"{self.damaged_chunks} damaged chunks, {self.unknown_messages} messages without topic"
        )


def recover(
    bag: Path | str, out: Path | str, *, overwrite: bool = False, bars: Bars | None = None
) -> Recovered:
    """Copy every whole chunk and message of a bag into a new bag.

    Parameters
    ----------
    bag
        A rosbag2 folder or a storage file; metadata.yaml is not read.
    out
        The new bag, as for BagWriter.
    overwrite
        Whether what is at `out` is replaced.
    bars
        Where progress is shown.

    Raises
    ------
    BagError
        Where there is no bag, or nothing in it can be read.
    OutputError
        Where `out` cannot be written.
    """
    bag = Path(bag)
    found = Recovered()
    types = TypestoreMessages()
    files, bars = storage_paths(bag, listed=False), bars or Silent()
    bars.start("recover", sum(file.stat().st_size for file in files) * 1e-6, "MB")
    with BagWriter(out, overwrite=overwrite, typestore=types) as writer:
        for file in files:
            with unpacked(file, partly=True) as path:
                _Copier(writer, types, found, bars).copy(path)
        if found.messages == 0:
            raise BagError(f"{bag}: nothing in it can be recovered")
    return found


class _Copier:
    """Copies the messages of one storage file."""

    def __init__(
        self, writer: BagWriter, types: TypestoreMessages, found: Recovered, bars: Bars
    ) -> None:
        self._bars = bars
        self._writer = writer
        self._types = types
        self._found = found
        self._schemas: dict[int, Schema] = {}
        self._topics: dict[int, _Topic] = {}

    def copy(self, path: Path) -> None:
        """Copy what can be read of a file; of neither kind nothing can."""
        with reading(path):
            with path.open("rb") as stream:
                head = stream.read(len(SQLITE_MAGIC))
            if head == SQLITE_MAGIC:
                self._copy_sqlite(path)
            elif head:
                self._copy_mcap(path)

    def _copy_sqlite(self, path: Path) -> None:
        with closing(_connect(path)) as database:
            self._topics = _topics_of_database(database)
            for number, log_ns, data in _rows_from_both_ends(database):
                self._write(number, log_ns, data)

    def _copy_mcap(self, path: Path) -> None:
        with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as m:
            whole = 0
            for start, end in _whole_records(m):
                self._bars.advance((end - start) * 1e-6)
                record_bytes = BytesIO(m[start:end])
                try:
                    reader = StreamReader(record_bytes, skip_magic=True, emit_chunks=True)
                    record = next(reader.records)
                except Exception:  # the library raises what its parts raise; the record is lost
                    continue
                whole += end - start
                self._copy_record(record)
            self._found.skipped_bytes += max(len(m) - whole - 2 * len(MCAP0_MAGIC), 0)

    def _copy_record(self, record: McapRecord) -> None:
        if isinstance(record, Chunk):
            try:
                records = _records_of_chunk(record)
            except Exception:  # whatever the decompressors raise, the chunk is lost and counted
                self._found.damaged_chunks += 1
                return
            for inner in records:
                self._copy_record(inner)
        elif isinstance(record, Schema):
            self._schemas.setdefault(record.id, record)
        elif isinstance(record, Channel):
            schema = self._schemas.get(record.schema_id) or Schema(0, b"", "", "")
            qos = record.metadata.get("offered_qos_profiles", "")
            text = schema.data.decode(errors="replace")
            topic = _Topic(record.topic, schema.name, text, schema.encoding, qos)
            self._topics.setdefault(record.id, topic)
        elif isinstance(record, Message):
            self._write(record.channel_id, record.log_time, record.data)

    def _write(self, number: int, log_ns: int, data: bytes) -> None:
        topic = self._topics.get(number)
        if topic is None or not 0 <= log_ns < 2**63:
            self._found.unknown_messages += 1
            return
        if self._writer.topic_type(topic.name) is None:
            self._declare(topic)
        if self._writer.topic_type(topic.name) != topic.msgtype:
            self._found.unknown_messages += 1
            return
        self._writer.write(topic.name, topic.msgtype, log_ns, data)
        self._found.messages += 1

    def _declare(self, topic: _Topic) -> None:
        text, encoding = topic.definition, topic.definition_encoding
        if not text and self._types.knows(topic.msgtype):
            text, encoding = self._types.definition(topic.msgtype), "ros2msg"
        profiles: list[Any] = []
        with suppress(Exception):  # of a damaged text the topic's default is taken
            profiles = list(dump_qos_v9(parse_qos(topic.qos)))
        self._writer.add_channel(topic.name, topic.msgtype, text, encoding, profiles)
        self._found.topics += 1


def _whole_records(m: mmap.mmap) -> Iterator[tuple[int, int]]:
    """Yield (start, end) of records that are whole by their sizes, in file order."""
    at, size = len(MCAP0_MAGIC), len(m)
    if m[:at] != MCAP0_MAGIC:
        at = _next_chunk(m, 0)
    while at + HEADER_BYTES <= size:
        end = at + HEADER_BYTES + _u64(m, at + 1)[0]
        fits = end <= size and m[at] in RECORD_KINDS
        if fits and (m[at] != Opcode.CHUNK or _is_chunk(m, at)):
            yield at, end
            at = end
        elif m[at : at + len(MCAP0_MAGIC)] == MCAP0_MAGIC:
            at += len(MCAP0_MAGIC)
        else:
            at = _next_chunk(m, at + 1)


def _next_chunk(m: mmap.mmap, at: int) -> int:
    """Return where the next chunk begins that is whole by its sizes; the file's end if none."""
    marker = bytes([Opcode.CHUNK])
    at = m.find(marker, at)
    while at >= 0:
        if _is_chunk(m, at):
            return at
        at = m.find(marker, at + 1)
    return len(m)


def _is_chunk(m: mmap.mmap, at: int) -> bool:
    """Return whether all sizes of a chunk record at this place agree with each other."""
    body = at + HEADER_BYTES
    if body + CHUNK_BYTES > len(m):
        return False
    length, name_length = _u64(m, at + 1)[0], _u32(m, body + 28)[0]
    if body + length > len(m) or name_length > 4 or body + CHUNK_BYTES + name_length > len(m):
        return False
    return bool(_u64(m, body + 32 + name_length)[0] == length - CHUNK_BYTES - name_length)


def _records_of_chunk(chunk: Chunk) -> list[McapRecord]:
    """Return what is in a chunk; no more memory is taken than it may declare.

    Raises
    ------
    Exception
        Of many kinds, for a chunk that is damaged.
    """
    if chunk.uncompressed_size > MAX_BLOCK_BYTES:
        raise ValueError("a chunk that declares more than any recording has")
    sizes = (-1, chunk.uncompressed_size)
    if chunk.compression == "zstd" and zstandard.frame_content_size(chunk.data) not in sizes:
        raise ValueError("a chunk whose sizes contradict each other")
    return breakup_chunk(chunk, validate_crc=True)


def _connect(path: Path) -> sqlite3.Connection:
    """Open read-only; a write-ahead log in a folder that cannot be written is left aside."""
    name = f"file:{quote(str(path.absolute()))}?mode=ro"
    try:
        database = sqlite3.connect(name, uri=True)
        database.execute("SELECT name FROM sqlite_master LIMIT 1").fetchone()
    except sqlite3.OperationalError:
        database = sqlite3.connect(f"{name}&immutable=1", uri=True)
    database.text_factory = lambda data: data.decode(errors="replace")
    return database


def _topics_of_database(database: sqlite3.Connection) -> dict[int, _Topic]:
    """Return the topics by number; bags before Galactic have no QoS, before Iron no definitions."""
    columns = {row[1] for row in database.execute("PRAGMA table_info(topics)")}
    qos = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
    definitions: dict[str, tuple[str, str]] = {}
    with suppress(sqlite3.Error):
        definitions = {
            str(msgtype): (str(text), str(encoding))
            for msgtype, text, encoding in database.execute(
                "SELECT topic_type, encoded_message_definition, encoding FROM message_definitions"
            )
        }
    return {
        int(number): _Topic(
            str(name), str(msgtype), *definitions.get(str(msgtype), ("", "")), str(offered or "")
        )
        for number, name, msgtype, offered in database.execute(
            f"SELECT id, name, type, {qos} FROM topics ORDER BY id"
        )
    }


def _rows_from_both_ends(database: sqlite3.Connection) -> Iterator[tuple[int, int, bytes]]:
    """Yield topic, log time and data of messages: from the first row on, then from the last."""
    seen = -1
    for order in ("ASC", "DESC"):
        with suppress(sqlite3.Error):
            for number, topic, log_ns, data in database.execute(
                "SELECT id, topic_id, timestamp, data FROM messages "
                f"WHERE id > {seen} ORDER BY id {order}"
            ):
                if order == "ASC":
                    seen = int(number)
                if isinstance(log_ns, int) and isinstance(data, bytes):
                    yield topic, log_ns, data
            return
