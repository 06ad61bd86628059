"""One storage file of a bag, mcap or sqlite3, read by rosbags, with checks for damage.

rosbags checks the chunks of an mcap file against their checksums. It does not look at the checksum
of the summary, skips what the index leaves out, reads what a damaged size field asks for, and
unpacks a chunk whole before it compares its size with the declared one: these are checked here.
Reading all 19,270 messages of bags/flat takes 0.14 s, 0.12 s of it in rosbags; the reader of the
mcap library takes 0.19 s (``python bench/bench_bags.py``).
"""

from __future__ import annotations

import mmap
import os
import struct
import zlib
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import partial
from io import BufferedReader, FileIO
from pathlib import Path, PosixPath
from typing import Any, NamedTuple
from urllib.parse import quote

import lz4.frame
import zstandard
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC
from rosbags.interfaces import Connection
from rosbags.rosbag2.storage_mcap import DECOMPRESSORS, McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from tccm_ros.errors import BagError, one_line

SQLITE_MAGIC = b"SQLite format 3\0"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
ROS1_MAGIC = b"#ROSBAG V"

RECOVER = "; try `tccm recover`"

MAX_BLOCK_BYTES = 2**30
"""Max size of a chunk or message that is unpacked (chosen: a damaged file may declare any size)."""

FOOTER_BYTES = 9 + 20 + len(MCAP0_MAGIC)
"""Header and content of the last record of an mcap file, and the magic bytes behind it."""

BEHIND_SUMMARY_CRC = 4 + len(MCAP0_MAGIC)


class BagMessage(NamedTuple):
    """A serialised message of a bag.

    Attributes
    ----------
    topic, msgtype
        Names.
    log_ns
        Log time.
    data
        CDR, with its header.
    """

    topic: str
    msgtype: str
    log_ns: int
    data: bytes


@contextmanager
def reading(path: Path, advice: str = "") -> Iterator[None]:
    """Turn everything that damage can raise into one BagError that names the file and the cause."""
    try:
        yield
    except BagError:
        raise
    except FileNotFoundError:
        raise BagError(f"{path}: no such file") from None
    except Exception as error:  # what the libraries raise for damaged bytes is documented nowhere
        raise BagError(f"{path}: {one_line(error)}{advice}") from None


def expand(packed: Any, limit: int = MAX_BLOCK_BYTES) -> Iterator[bytes]:
    """Unpack what zstd has compressed, piece by piece.

    Parameters
    ----------
    packed
        Bytes, or a file that is open for reading.
    limit
        Max number of bytes that are unpacked.

    Raises
    ------
    ValueError
        For more than `limit` bytes.
    """
    stream = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
    while piece := stream.read(2**20):
        limit -= len(piece)
        if limit < 0:
            raise ValueError("grows more than a recording can when it is unpacked")
        yield piece


def unpacked_chunk(compression: str, data: bytes, size: int) -> bytes:
    """Return the content of an mcap chunk; no more memory is taken than it declares.

    Parameters
    ----------
    compression
        ``zstd``, ``lz4`` or empty.
    data
        The chunk as it is stored.
    size
        Number of bytes that it declares to be when it is unpacked.

    Raises
    ------
    ValueError
        For more or fewer bytes than declared, or a declaration of more than `MAX_BLOCK_BYTES`.
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


for _name in ("zstd", "lz4"):  # those of rosbags unpack whatever comes
    DECOMPRESSORS[_name] = partial(unpacked_chunk, _name)


class StorageFile:
    """One storage file.

    Parameters
    ----------
    path
        An mcap or a sqlite3 file, whatever its name.
    name
        The file in messages, where `path` is its unpacked copy.

    Attributes
    ----------
    path
        The file in messages.
    connections
        Topics as the file describes them.
    start_ns, end_ns
        Log times of the first and the last message; 0 where there is none.

    Raises
    ------
    BagError
        For a file that is missing, empty, of another kind, cut off or damaged.
    """

    def __init__(self, path: Path, name: Path | None = None) -> None:
        self.path = name or path
        with reading(self.path):
            self._reader = _reader(path)
        with reading(self.path, RECOVER):
            _check_ends(path)
            self._reader.open()
            try:
                if isinstance(self._reader, McapReader):
                    _check_index(self._reader)
            except BaseException:
                self._reader.close()
                raise
        self.connections: list[Connection] = list(self._reader.connections)
        span = self._reader.metadata
        self.start_ns = span.start_time if span.message_count else 0
        self.end_ns = span.end_time - 1 if span.message_count else 0

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    def messages(self, topics: Collection[str] | None) -> Iterator[BagMessage]:
        """Yield the messages of some topics, or of all, in log order; equal times in file order.

        Raises
        ------
        BagError
            At the first damage, after all messages before it.
        """
        wanted = [c for c in self.connections if topics is None or c.topic in topics]
        if not wanted:
            return
        with reading(self.path, RECOVER):
            for connection, log_ns, data in self._reader.messages(wanted):
                if not isinstance(data, bytes):
                    raise ValueError(f"a message is {type(data).__name__}, expected bytes")
                if data[:4] == ZSTD_MAGIC:  # serialised messages begin with 0: it is compressed
                    data = b"".join(expand(data))
                yield BagMessage(connection.topic, connection.msgtype, log_ns, data)


class _BoundedFile(BufferedReader):
    """A file that reads no more than its size: Python allocates before it reads."""

    def __init__(self, path: Path) -> None:
        super().__init__(FileIO(path))
        self._size = os.fstat(self.fileno()).st_size

    def read(self, size: int | None = -1, /) -> bytes:
        left = max(self._size - self.tell(), 0)
        return super().read(left if size is None or size < 0 else min(size, left))


class _BoundedPath(PosixPath):
    """A path whose file rosbags opens as a `_BoundedFile`."""

    def open(self, *_args: Any, **_options: Any) -> Any:
        return _BoundedFile(self)


def _reader(path: Path) -> McapReader | Sqlite3Reader:
    """Return rosbags' reader for what the first bytes of a file say that it is."""
    with path.open("rb") as stream:
        head = stream.read(16)
    if not head:
        raise ValueError("the file is empty")
    if head.startswith(ROS1_MAGIC):
        raise ValueError("a ROS 1 bag; convert it: rosbags-convert --src BAG --dst FOLDER")
    if head == SQLITE_MAGIC:
        return Sqlite3Reader(Path(quote(str(path.absolute()))))  # it makes a URI of it
    if head.startswith(MCAP0_MAGIC):
        return McapReader(_BoundedPath(path))
    raise ValueError("neither mcap nor sqlite3; expected a rosbag2 folder, a .mcap or a .db3")


def _check_ends(path: Path) -> None:
    """Raise ValueError where the end of a file is missing, or a part beside it is unread."""
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
        summary, _, crc = struct.unpack_from("<QQI", data, footer + 9)
        if summary > footer:
            raise ValueError(f"the footer points to byte {summary} of {len(data)}")
        with memoryview(data) as view, view[summary or footer : -BEHIND_SUMMARY_CRC] as checked:
            if crc and zlib.crc32(checked) != crc:
                raise ValueError("the summary fails its checksum")


def _check_index(reader: McapReader) -> None:
    """Raise ValueError where the index of an mcap file leaves something out, or asks too much."""
    counts = {reader.metadata.message_count, sum(c.msgcount for c in reader.connections)}
    if reader.chunks:
        counts.add(sum(sum(chunk.channel_count.values()) for chunk in reader.chunks))
    if len(counts) > 1:
        raise ValueError("its index does not name all messages")
    largest = max((chunk.uncompressed_size for chunk in reader.chunks), default=0)
    if largest > MAX_BLOCK_BYTES:
        raise ValueError(f"a chunk declares {largest} bytes, more than {MAX_BLOCK_BYTES}")
