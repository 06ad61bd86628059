"""A storage file of a bag, mcap or sqlite3, read by rosbags with additional checks for damage.

rosbags checks the chunks of an mcap file against their checksums. It does not check the checksum of
the summary, skips messages missing from the index, reads as many bytes as a damaged size field
says, and unpacks a whole chunk before it compares its size with the declared one. This module
checks all of these. rosbags also refuses files with other profiles or schema encodings, even if the
affected topics are not needed; this module lists every topic, whatever its type, schema and
encoding. Reading all 19,270 messages of bags/flat takes 0.14 s, 0.12 s of it in rosbags; the reader
of the mcap library takes 0.19 s (``python bench/bench_bags.py``).
"""

from __future__ import annotations

import mmap
import os
import sqlite3
import struct
import zlib
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from io import BufferedReader, FileIO
from pathlib import Path, PosixPath
from typing import Any, BinaryIO, NamedTuple
from urllib.parse import quote

import lz4.frame
import zstandard
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat, Qos
from rosbags.rosbag2 import storage_mcap
from rosbags.rosbag2.metadata import parse_qos
from rosbags.rosbag2.storage_mcap import DECOMPRESSORS, McapReader

from tccm_ros.errors import BagError, one_line

SQLITE_MAGIC = b"SQLite format 3\0"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
ROS1_MAGIC = b"#ROSBAG V"

RECOVER = "; try `tccm recover`"

MAX_BLOCK_BYTES = 2**30
"""Maximum size of an unpacked chunk or message. Chosen: a damaged file may declare any size."""

QOS_KEY = "offered_qos_profiles"

RECORD_HEADER = struct.Struct("<BQ")
"""Kind and size of an mcap record."""

FOOTER_BYTES = RECORD_HEADER.size + 20 + len(MCAP0_MAGIC)
"""Size of the last record of an mcap file, with its header and the magic bytes after it."""

BEHIND_SUMMARY_CRC = 4 + len(MCAP0_MAGIC)


class BagMessage(NamedTuple):
    """A serialised message of a bag.

    Attributes
    ----------
    topic, msgtype
        Names.
    log_ns
        Log time, ns.
    data
        CDR with its encapsulation header.
    """

    topic: str
    msgtype: str
    log_ns: int
    data: bytes


@dataclass(frozen=True, slots=True)
class StoredTopic:
    """A topic of one type in a storage file; a topic with two types gives two of these.

    Attributes
    ----------
    id
        Id within the file.
    topic, msgtype
        Names; the type as ``package/msg/Type``.
    encoding
        Encoding of the messages: ``cdr`` for ROS 2.
    count
        Number of messages.
    qos
        Quality of service of the publishers.
    """

    id: int
    topic: str
    msgtype: str
    encoding: str
    count: int
    qos: tuple[Qos, ...]


@contextmanager
def reading(path: Path, advice: str = "") -> Iterator[None]:
    """Convert any exception caused by damage to a BagError with the file and the cause."""
    try:
        yield
    except BagError:
        raise
    except FileNotFoundError:
        raise BagError(f"{path}: no such file") from None
    except Exception as error:  # the libraries raise undocumented exceptions for damaged bytes
        raise BagError(f"{path}: {one_line(error)}{advice}") from None


def expand(packed: Any, limit: int = MAX_BLOCK_BYTES) -> Iterator[bytes]:
    """Yield the decompressed pieces of zstd data.

    Parameters
    ----------
    packed
        Bytes, or a file open for reading.
    limit
        Maximum decompressed size, bytes.

    Raises
    ------
    ValueError
        If the data exceed `limit`.
    """
    stream = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
    while piece := stream.read(2**20):
        limit -= len(piece)
        if limit < 0:
            raise ValueError("grows more than a recording can when it is unpacked")
        yield piece


def unpacked_chunk(compression: str, data: bytes, size: int) -> bytes:
    """Return the content of an mcap chunk, using no more memory than it declares.

    Parameters
    ----------
    compression
        ``zstd``, ``lz4`` or empty.
    data
        The stored bytes.
    size
        Declared decompressed size, bytes.

    Raises
    ------
    ValueError
        If the size differs from the declared one, or is declared larger than `MAX_BLOCK_BYTES`.
    """
    if size > MAX_BLOCK_BYTES:
        raise ValueError(f"a chunk declares {size} bytes, more than {MAX_BLOCK_BYTES}")
    if compression == "zstd":
        stream = zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True)
        data = stream.read(size + 1)
    elif compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    if len(data) != size:
        found = "more" if len(data) > size else len(data)
        raise ValueError(f"a chunk declares {size} bytes and has {found}")
    return data


for _name in ("zstd", "lz4"):  # rosbags' own decompressors have no size limit
    DECOMPRESSORS[_name] = partial(unpacked_chunk, _name)


def _text(stream: BinaryIO) -> str:
    """Return a string of an mcap record; a schema may contain bytes that are not text."""
    return storage_mcap.read_bytes(stream).decode(errors="replace")


KEPT_PROFILES = 256
"""Number of texts of QoS profiles that are parsed once: topics share few, of 2 ms each (chosen)."""


def _or_default(function: Callable[[Any], Any], default: Any) -> Callable[[Any], Any]:
    """Return a function that returns a default value if the given one raises."""

    def tolerant(value: Any) -> Any:
        with suppress(Exception):  # the libraries raise various exceptions for damaged bytes
            return function(value)
        return default

    return tolerant


_offered_qos = _or_default(lru_cache(KEPT_PROFILES)(parse_qos), [])

vars(storage_mcap).update(  # the originals raise for schemas and profiles of other kinds
    read_string=_text,
    get_qos=_or_default(lru_cache(KEPT_PROFILES)(storage_mcap.get_qos), []),
    get_msgdef=_or_default(
        storage_mcap.get_msgdef, MessageDefinition(MessageDefinitionFormat.NONE, "")
    ),
)


class StorageFile:
    """One storage file.

    Parameters
    ----------
    path
        An mcap or a sqlite3 file with any name.
    name
        Name of the file in error messages, if `path` is a decompressed copy.

    Attributes
    ----------
    path
        Name of the file in error messages.
    topics
        Topics as the file describes them.
    start_ns, end_ns
        Log times of the first and the last message, ns; 0 if there is none.

    Raises
    ------
    BagError
        If the file is missing, empty, of another kind, truncated or damaged.
    """

    def __init__(self, path: Path, name: Path | None = None) -> None:
        self.path = name or path
        with reading(self.path):
            self._reader = _reader(path)
        with reading(self.path, RECOVER):
            _check_ends(path)
            self._reader.open()
            try:
                if isinstance(self._reader, _McapFile):
                    _check_index(self._reader, self.path)
                self.topics = self._reader.topics()
            except BaseException:
                self._reader.close()
                raise
        span = self._reader.metadata
        self.start_ns = span.start_time if span.message_count else 0
        self.end_ns = span.end_time - 1 if span.message_count else 0

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    def messages(self, topics: Collection[StoredTopic]) -> Iterator[BagMessage]:
        """Yield the messages of some topics in log order, with equal times in file order.

        Raises
        ------
        BagError
            At the first damage, after all messages before it.
        """
        if not topics:
            return
        with reading(self.path, RECOVER):
            found: Iterator[tuple[StoredTopic, int, Any]] = self._reader.messages(topics)  # type: ignore[arg-type,assignment]
            for topic, log_ns, data in found:
                if not isinstance(data, bytes):
                    raise ValueError(f"a message is {type(data).__name__}, expected bytes")
                if data[:4] == ZSTD_MAGIC:  # compressed; an uncompressed message begins with 0
                    data = b"".join(expand(data))
                yield BagMessage(topic.topic, topic.msgtype, log_ns, data)


def ros_name(msgtype: str) -> str:
    """Return the name of a type as ROS 2 writes it: ``package/Type`` is ``package/msg/Type``."""
    package, _, name = msgtype.partition("/")
    return f"{package}/msg/{name}" if name and "/" not in name else msgtype


class _BoundedFile(BufferedReader):
    """A file that never reads more than its size, because Python allocates before it reads."""

    def __init__(self, path: Path) -> None:
        super().__init__(FileIO(path))
        self._size = os.fstat(self.fileno()).st_size

    def read(self, size: int | None = -1, /) -> bytes:
        left = max(self._size - self.tell(), 0)
        return super().read(left if size is None or size < 0 else min(size, left))


class _BoundedPath(PosixPath):
    """A path that rosbags opens as a `_BoundedFile`."""

    def open(self, *_args: Any, **_options: Any) -> Any:
        return _BoundedFile(self)


class _McapFile(McapReader):
    """rosbags' reader for files of any profile."""

    def _open(self) -> None:
        """Read the summary, or all records if the file has no statistics."""
        assert self.bio
        self.bio.seek(len(MCAP0_MAGIC))
        kind, size = RECORD_HEADER.unpack(self.bio.read(RECORD_HEADER.size))
        if kind != Opcode.HEADER:
            raise ValueError("the file does not begin with a header")
        self.data_start = self.bio.tell() + size
        footer = self.bio.seek(-FOOTER_BYTES, os.SEEK_END)
        (summary,) = struct.unpack_from("<Q", self.bio.read(), RECORD_HEADER.size)
        self.data_end = summary or footer
        if summary:
            self.read_index()
        counts = len(self.schemas), len(self.channels)
        if self.statistics is None or self.statistics[1:3] != counts:
            self.connections.clear()
            self.meta_scan()
        found = self.statistics
        assert found is not None
        self.metadata = self.metadata._replace(
            start_time=found.start_time,
            end_time=found.end_time + 1,
            message_count=found.message_count,
        )

    def topics(self) -> list[StoredTopic]:
        """Return the channels as topics."""
        assert self.statistics is not None
        counts = self.statistics.channel_message_counts
        return [
            StoredTopic(
                c.id,
                c.topic,
                ros_name(c.schema),
                c.message_encoding,
                counts.get(c.id, 0),
                tuple(storage_mcap.get_qos(c.metadata)),
            )
            for c in self.channels.values()
        ]


class _Span(NamedTuple):
    """Log times of a file, ns, the last one exclusive, and its number of messages."""

    start_time: int
    end_time: int
    message_count: int


class _Database:
    """A sqlite3 file of any version of rosbag2; those before Galactic have no QoS."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.metadata = _Span(0, 0, 0)

    def open(self) -> None:
        """Open the file without locks or a journal."""
        name = f"file:{quote(str(self._path.absolute()))}?immutable=1"
        self._file = sqlite3.connect(name, uri=True)
        self._file.text_factory = lambda data: data.decode(errors="replace")
        rows = "SELECT MIN(timestamp), MAX(timestamp), COUNT(*) FROM messages"
        start, end, count = self._file.execute(rows).fetchone()
        self.metadata = _Span(start or 0, (end or 0) + 1, count)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def topics(self) -> list[StoredTopic]:
        """Return the rows of the topics table."""
        rows = "SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id"
        counts = dict(self._file.execute(rows))
        return [
            StoredTopic(
                k, name, ros_name(kind), encoding, counts.get(k, 0), tuple(_offered_qos(offered))
            )
            for k, name, kind, encoding, offered in topic_rows(self._file)
        ]

    def messages(self, topics: Collection[StoredTopic]) -> Iterator[tuple[StoredTopic, int, bytes]]:
        """Yield topic, log time and data of messages in log order."""
        wanted = {topic.id: topic for topic in topics}
        ids = ",".join(map(str, wanted))
        rows = (
            f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({ids}) "
            "ORDER BY timestamp"
        )
        for number, log_ns, data in self._file.execute(rows):
            yield wanted[number], log_ns, data


def topic_rows(database: sqlite3.Connection) -> Iterator[tuple[int, str, str, str, str]]:
    """Yield id, name, type, encoding and QoS profiles of topics; before Galactic without QoS."""
    columns = {row[1] for row in database.execute("PRAGMA table_info(topics)")}
    qos = QOS_KEY if QOS_KEY in columns else "''"
    yield from database.execute(
        f"SELECT id, name, type, serialization_format, {qos} FROM topics ORDER BY id"
    )


def _reader(path: Path) -> _McapFile | _Database:
    """Return the reader for a file, by its first bytes."""
    with path.open("rb") as stream:
        head = stream.read(16)
    if not head:
        raise ValueError("the file is empty")
    if head.startswith(ROS1_MAGIC):
        raise ValueError("a ROS 1 bag; convert it: rosbags-convert --src BAG --dst FOLDER")
    if head == SQLITE_MAGIC:
        return _Database(path)
    if head.startswith(MCAP0_MAGIC):
        return _McapFile(_BoundedPath(path))
    raise ValueError("neither mcap nor sqlite3; expected a rosbag2 folder, a .mcap or a .db3")


def _check_ends(path: Path) -> None:
    """Raise ValueError if a file is truncated, or if its write-ahead log has unread messages."""
    log = path.with_name(f"{path.name}-wal")
    if log.exists() and log.stat().st_size:
        raise ValueError(f"{log.name} holds messages that were not yet moved into it")
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        if data[: len(MCAP0_MAGIC)] != MCAP0_MAGIC:
            return
        footer = len(data) - FOOTER_BYTES
        if footer < len(MCAP0_MAGIC):
            raise ValueError("the file is cut off")
        if data[-len(MCAP0_MAGIC) :] != MCAP0_MAGIC or data[footer] != Opcode.FOOTER:
            raise ValueError("the file is cut off, its footer is missing")
        summary, _, crc = struct.unpack_from("<QQI", data, footer + RECORD_HEADER.size)
        if summary > footer:
            raise ValueError(f"the footer points to byte {summary} of {len(data)}")
        with memoryview(data) as view, view[summary or footer : -BEHIND_SUMMARY_CRC] as checked:
            if crc and zlib.crc32(checked) != crc:
                raise ValueError("the summary fails its checksum")


def _check_index(reader: _McapFile, path: Path) -> None:
    """Raise ValueError if the index of an mcap file is incomplete or declares too large a chunk.

    An unknown compression cannot be recovered from, and raises a BagError instead.
    """
    counts = {reader.metadata.message_count, sum(topic.count for topic in reader.topics())}
    if reader.chunks:
        counts.add(sum(sum(chunk.channel_count.values()) for chunk in reader.chunks))
    if len(counts) > 1:
        raise ValueError("its index does not name all messages")
    for chunk in reader.chunks:
        if chunk.uncompressed_size > MAX_BLOCK_BYTES:
            size = chunk.uncompressed_size
            raise ValueError(f"a chunk declares {size} bytes, more than {MAX_BLOCK_BYTES}")
        if chunk.compression not in DECOMPRESSORS:
            name = chunk.compression[:40]
            raise BagError(f"{path}: its chunks are compressed as '{name}', expected zstd or lz4")
