"""Recover a truncated or damaged bag: copy its readable messages to a new one.

An mcap file is read record by record with the mcap library; after damage, reading continues at the
next chunk with consistent sizes. A sqlite3 file is read from both ends, including its write-ahead
log.
"""

from __future__ import annotations

import mmap
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.parse import quote

from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC
from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos

from tccm_ros.bags.bag_files import storage_paths, unpacked
from tccm_ros.bags.storage import QOS_KEY, SQLITE_MAGIC, reading, topic_rows, unpacked_chunk
from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.bags.writer import BagWriter
from tccm_ros.errors import BagError
from tccm_ros.progress import Bars

RECORD_KINDS = frozenset(Opcode)
"""Valid record kinds of mcap; other values are damage."""

CHUNK_MARK = bytes([Opcode.CHUNK])

HEADER_BYTES = 9

_u64 = struct.Struct("<Q").unpack_from
_u32 = struct.Struct("<I").unpack_from


@dataclass
class Recovered:
    """Counts of a recovery.

    Attributes
    ----------
    messages
        Number of messages in the new bag.
    topics
        Number of topics in the new bag.
    skipped_bytes
        Bytes outside complete records, in all files.
    damaged_chunks
        Number of chunks with consistent sizes but a wrong checksum or content.
    unknown_messages
        Number of messages whose topic's name is lost.
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
        The new bag, as in BagWriter.
    overwrite
        Whether to replace an existing `out`.
    bars
        Progress bars.

    Raises
    ------
    BagError
        If there is no bag, or nothing in it can be read.
    OutputError
        If `out` cannot be written.
    """
    bag = Path(bag)
    found = Recovered()
    types = TypestoreMessages()
    files, bars = storage_paths(bag, listed=False), bars or Bars()
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
        self._schemas = {0: Schema(id=0, name="", encoding="", data=b"")}  # of channels without one
        self._channels: dict[int, Channel] = {}

    def copy(self, path: Path) -> None:
        """Copy the readable messages of an mcap or sqlite3 file; other files are ignored."""
        with reading(path):
            with path.open("rb") as stream:
                head = stream.read(len(SQLITE_MAGIC))
            if head == SQLITE_MAGIC:
                with closing(_connect(path)) as database:
                    for record in _records_of_database(database):
                        self._copy_record(record)
            elif head:
                self._copy_mcap(path)

    def _copy_mcap(self, path: Path) -> None:
        with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as m:
            whole = 0
            for start, end in _whole_records(m):
                self._bars.advance((end - start) * 1e-6)
                stream_of_one = BytesIO(m[start:end])
                try:
                    reader = StreamReader(stream_of_one, skip_magic=True, emit_chunks=True)
                    record = next(reader.records)
                except Exception:  # the library passes on any exception; the record is lost
                    continue
                whole += end - start
                self._copy_record(record)
            self._found.skipped_bytes += max(len(m) - whole - 2 * len(MCAP0_MAGIC), 0)

    def _copy_record(self, record: McapRecord) -> None:
        if isinstance(record, Chunk):
            try:
                records = _records_of_chunk(record)
            except Exception:  # decompressors raise various types; the chunk is lost and counted
                self._found.damaged_chunks += 1
                return
            for inner in records:
                self._copy_record(inner)
        elif isinstance(record, Schema):
            self._schemas.setdefault(record.id, record)
        elif isinstance(record, Channel) and record.schema_id in self._schemas:
            self._channels.setdefault(record.id, record)
        elif isinstance(record, Message):
            self._write(record)

    def _write(self, message: Message) -> None:
        channel = self._channels.get(message.channel_id)
        if channel is None or not 0 <= message.log_time < 2**63:
            self._found.unknown_messages += 1
            return
        schema = self._schemas[channel.schema_id]
        if self._writer.topic_type(channel.topic) is None:
            self._declare(channel, schema)
        if self._writer.topic_type(channel.topic) != schema.name:
            self._found.unknown_messages += 1
            return
        self._writer.write(channel.topic, schema.name, message.log_time, message.data)
        self._found.messages += 1

    def _declare(self, channel: Channel, schema: Schema) -> None:
        text, encoding = schema.data, schema.encoding
        if not text and self._types.knows(schema.name):
            text, encoding = self._types.definition(schema.name).encode(), "ros2msg"
        profiles: list[Any] = []
        with suppress(Exception):  # a damaged profile is replaced by the topic's default
            profiles = list(dump_qos_v9(parse_qos(channel.metadata.get(QOS_KEY, ""))))
        self._writer.add_channel(
            channel.topic,
            schema.name,
            text,
            encoding,
            profiles,
            serialization=channel.message_encoding,
        )
        self._found.topics += 1


def _whole_records(m: mmap.mmap) -> Iterator[tuple[int, int]]:
    """Yield (start, end) of records with consistent sizes, in file order."""
    at = len(MCAP0_MAGIC)
    while 0 <= at < len(m):
        end = _end_of_record(m, at)
        if end is None:
            at = m.find(CHUNK_MARK, at + 1)
        else:
            yield at, end
            at = end


def _end_of_record(m: mmap.mmap, at: int) -> int | None:
    """Return the end of the record at an offset; None if its sizes are inconsistent."""
    try:
        end = at + HEADER_BYTES + _u64(m, at + 1)[0]
        if m[at] == Opcode.CHUNK:  # times, size, checksum; compression; data
            data = at + HEADER_BYTES + 28 + 4 + _u32(m, at + HEADER_BYTES + 28)[0]
            is_whole = end == data + 8 + _u64(m, data)[0]
        else:
            is_whole = m[at] in RECORD_KINDS
    except struct.error:  # the file is truncated here
        return None
    return end if is_whole and end <= len(m) else None


def _records_of_chunk(chunk: Chunk) -> list[McapRecord]:
    """Return the records in a chunk, using no more memory than it may declare.

    Raises
    ------
    Exception
        Of various types, if the chunk is damaged.
    """
    data = unpacked_chunk(chunk.compression, chunk.data, chunk.uncompressed_size)
    return breakup_chunk(replace(chunk, compression="", data=data), validate_crc=True)


def _connect(path: Path) -> sqlite3.Connection:
    """Open read-only; ignore a write-ahead log in a folder that is not writable."""
    name = f"file:{quote(str(path.absolute()))}?mode=ro"
    try:
        database = sqlite3.connect(name, uri=True)
        database.execute("SELECT name FROM sqlite_master LIMIT 1").fetchone()
    except sqlite3.OperationalError:
        database = sqlite3.connect(f"{name}&immutable=1", uri=True)
    database.text_factory = lambda data: data.decode(errors="replace")
    return database


def _records_of_database(database: sqlite3.Connection) -> Iterator[McapRecord]:
    """Yield the rows of a sqlite3 file as mcap records.

    Bags before Galactic have no QoS, those before Iron no definitions.
    """
    definitions: dict[str, tuple[str, str]] = {}
    with suppress(sqlite3.Error):
        rows = "SELECT topic_type, encoded_message_definition, encoding FROM message_definitions"
        definitions = {kind: (text, encoding) for kind, text, encoding in database.execute(rows)}
    for number, name, kind, serialization, offered in topic_rows(database):
        text, encoding = definitions.get(kind, ("", ""))
        yield Schema(id=number, name=kind, encoding=encoding, data=text.encode())
        yield Channel(number, name, serialization, {QOS_KEY: offered or ""}, number)
    for topic, log_ns, data in _rows_from_both_ends(database):
        yield Message(channel_id=topic, log_time=log_ns, publish_time=log_ns, sequence=0, data=data)


def _rows_from_both_ends(database: sqlite3.Connection) -> Iterator[tuple[int, int, bytes]]:
    """Yield topic, log time and data of messages, from the first row on, then backwards."""
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
