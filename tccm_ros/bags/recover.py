"""Copy what can be read of a truncated or damaged bag into a new one.

An mcap file is walked record by record; where the walk meets damage it goes on at the next chunk
that is whole by its sizes and its checksum. A sqlite3 file is read from both ends.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from tccm_ros.bags import sqlite_file
from tccm_ros.bags.bag_files import SUFFIXES, is_compressed, unpack_file
from tccm_ros.bags.mcap_records import (
    CHANNEL,
    CHUNK,
    HEADER_BYTES,
    MAGIC,
    MESSAGE,
    MESSAGE_HEADER_BYTES,
    SCHEMA,
    Schema,
    chunk_records,
    message_header,
    parse_channel,
    parse_schema,
    split_records,
    u64,
)
from tccm_ros.bags.offered_qos import parse_profiles
from tccm_ros.bags.sqlite_file import SqliteFile
from tccm_ros.bags.storage import Channel, RawMessage, reading
from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.bags.writer import BagWriter
from tccm_ros.errors import BagError
from tccm_ros.progress import Bars, Silent

__all__ = ["Recovered", "recover"]

KNOWN_KINDS = range(1, 16)
"""Record kinds of mcap; others are taken for damage."""

_CHUNK = struct.Struct("<QQQI").unpack_from


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
    files, bars = _files(bag), bars or Silent()
    bars.start("recover", sum(file.stat().st_size for file in files) * 1e-6, "MB")
    with BagWriter(out, overwrite=overwrite, typestore=types) as writer:
        for file in files:
            copier = _Copier(writer, types, found, bars)
            with TemporaryDirectory() as folder:
                copier.copy(_unpacked(file, Path(folder)))
        if found.messages == 0:
            raise BagError(f"{bag}: nothing in it can be recovered")
    return found


def _files(bag: Path) -> list[Path]:
    if not bag.exists():
        raise BagError(f"{bag}: no such bag")
    if not bag.is_dir():
        return [bag]
    files = sorted(path for path in bag.iterdir() if path.name.endswith(SUFFIXES))
    if not files:
        raise BagError(f"{bag}: no bag in this folder; expected a file ending in .mcap or .db3")
    return files


def _unpacked(file: Path, folder: Path) -> Path:
    """Return a file as it is, or what can be unpacked of a compressed one."""
    if not is_compressed(file):
        return file
    with suppress(BagError):
        return unpack_file(file, folder)
    return folder / file.name.removesuffix(".zstd")


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
        self._channels: dict[int, Channel] = {}

    def copy(self, path: Path) -> None:
        """Copy what can be read of a file; of neither kind nothing can."""
        with reading(path):
            with path.open("rb") as stream:
                head = stream.read(16)
            if head == sqlite_file.MAGIC:
                self._copy_sqlite(path)
            elif head:
                self._copy_mcap(path)

    def _copy_sqlite(self, path: Path) -> None:
        file = SqliteFile(path)
        self._channels = file.channels
        for message in file.salvage():
            self._write(message)
        file.close()

    def _copy_mcap(self, path: Path) -> None:
        with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as m:
            whole = 0
            for start, end in _whole_records(m):
                whole += end - start
                self._bars.advance((end - start) * 1e-6)
                kind, body = m[start], m[start + HEADER_BYTES : end]
                if kind == CHUNK:
                    self._copy_chunk(body)
                else:
                    self._copy_record(kind, body)
            self._found.skipped_bytes += max(len(m) - whole - 2 * len(MAGIC), 0)

    def _copy_chunk(self, body: bytes) -> None:
        try:
            records = chunk_records(body)
            pieces = list(split_records(records))
        except Exception:  # whatever the decompressors raise, the chunk is lost and counted
            self._found.damaged_chunks += 1
            return
        for kind, start, end in pieces:
            self._copy_record(kind, records[start:end])

    def _copy_record(self, kind: int, body: bytes) -> None:
        try:
            if kind == SCHEMA:
                number, schema = parse_schema(body)
                self._schemas.setdefault(number, schema)
            elif kind == CHANNEL:
                number, channel = parse_channel(body, self._schemas)
                self._channels.setdefault(number, channel)
            elif kind == MESSAGE:
                number, _, log_ns, _ = message_header(body)
                self._write(RawMessage(log_ns, number, body[MESSAGE_HEADER_BYTES:]))
        except (ValueError, struct.error):
            self._found.skipped_bytes += len(body)

    def _write(self, message: RawMessage) -> None:
        channel = self._channels.get(message.channel)
        if channel is None or not 0 <= message.log_ns < 2**63:
            self._found.unknown_messages += 1
            return
        if self._writer.topic_type(channel.topic) is None:
            self._declare(channel)
        if self._writer.topic_type(channel.topic) != channel.msgtype:
            self._found.unknown_messages += 1
            return
        self._writer.write(channel.topic, channel.msgtype, message.log_ns, message.data)
        self._found.messages += 1

    def _declare(self, channel: Channel) -> None:
        text, encoding = channel.definition, channel.definition_encoding
        if not text and self._types.knows(channel.msgtype):
            text, encoding = self._types.definition(channel.msgtype), "ros2msg"
        profiles = parse_profiles(channel.qos)
        self._writer.add_channel(channel.topic, channel.msgtype, text, encoding, profiles)
        self._found.topics += 1


def _whole_records(m: mmap.mmap) -> Iterator[tuple[int, int]]:
    """Yield (start, end) of records that are whole by their sizes, in file order."""
    at, size = len(MAGIC), len(m)
    if m[:at] != MAGIC:
        at = _next_chunk(m, 0)
    while at + HEADER_BYTES <= size:
        end = at + HEADER_BYTES + u64(m, at + 1)[0]
        fits = end <= size and m[at] in KNOWN_KINDS
        if fits and (m[at] != CHUNK or _is_chunk(m, at)):
            yield at, end
            at = end
        elif m[at : at + len(MAGIC)] == MAGIC:
            at += len(MAGIC)
        else:
            at = _next_chunk(m, at + 1)


def _next_chunk(m: mmap.mmap, at: int) -> int:
    """Return where the next chunk begins that is whole by its sizes; the file's end if none."""
    marker = bytes([CHUNK])
    at = m.find(marker, at)
    while at >= 0:
        if _is_chunk(m, at):
            return at
        at = m.find(marker, at + 1)
    return len(m)


def _is_chunk(m: mmap.mmap, at: int) -> bool:
    """Return whether all sizes of a chunk record at this place agree with each other."""
    body = at + HEADER_BYTES
    if body + 40 > len(m):
        return False
    length = u64(m, at + 1)[0]
    if length < 40 or body + length > len(m):
        return False
    name_length = int.from_bytes(m[body + 28 : body + 32], "little")
    if name_length > 4 or m[body + 32 : body + 32 + name_length] not in (b"", b"lz4", b"zstd"):
        return False
    packed = int.from_bytes(m[body + 32 + name_length : body + 40 + name_length], "little")
    unpacked = _CHUNK(m, body)[2]
    return packed == length - 40 - name_length and (name_length > 0 or unpacked == packed)
