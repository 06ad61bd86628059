"""Read mcap files: in log order, with constant memory, with every checksum checked.

Written for this project because damage must be found and named: readers in use check no summary
checksum, allocate what a damaged size field asks for, or run code made from a bag's definitions.
"""

from __future__ import annotations

import struct
import zlib
from bisect import bisect_left
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from tccm_ros.bags.mcap_records import (
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    HEADER_BYTES,
    MAGIC,
    MESSAGE,
    MESSAGE_HEADER_BYTES,
    SCHEMA,
    STATISTICS,
    Cursor,
    Schema,
    chunk_records,
    message_header,
    parse_channel,
    parse_schema,
    split_records,
    u64,
)
from tccm_ros.bags.storage import Channel, RawMessage, StorageDamage, reading

__all__ = ["McapFile"]

FOOTER_BYTES = HEADER_BYTES + 20 + len(MAGIC)
BLOCK_BYTES = 2**20
"""Messages outside of chunks are read in blocks of about this size."""

RECOVER = "; try `tccm recover`"

_FOOTER = struct.Struct("<QQI").unpack_from
_CHUNK_INDEX = struct.Struct("<QQQQ").unpack_from


class Block(NamedTuple):
    """A chunk, or a run of messages outside of chunks: where it is and the times in it."""

    start_ns: int
    end_ns: int
    offset: int
    length: int
    is_chunk: bool


Found = tuple[int, int, int, int, int, bytes]
"""A message of a block: log time, place of the block, start and end in its data, channel, data."""


class McapFile:
    """One mcap file.

    Attributes
    ----------
    channels
        Channel by number.
    start_ns, end_ns
        Log times of the first and the last message; 0 where there is none.

    Raises
    ------
    BagError
        For a file that is missing, empty, no mcap, cut off or damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.channels: dict[int, Channel] = {}
        self.start_ns = self.end_ns = 0
        self._schemas: dict[int, Schema] = {}
        self._blocks: list[Block] = []
        self._counts: Counter[int] | None = None
        with reading(path, RECOVER):
            self._stream: BinaryIO = path.open("rb")
            try:
                self._open()
            except BaseException:
                self._stream.close()
                raise

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def counts(self) -> Counter[int]:
        """Return the number of messages by channel."""
        if self._counts is None:
            with reading(self.path, RECOVER):
                self._scan()
        assert self._counts is not None
        return self._counts

    def messages(self, channels: Collection[int]) -> Iterator[RawMessage]:
        """Yield the messages of some channels in log order; equal times in file order.

        Chunks may overlap; those that do are in memory together.

        Raises
        ------
        BagError
            At the first damaged chunk, after all messages before it.
        """
        pending: list[Found] = []
        blocks = sorted(self._blocks)
        for k, block in enumerate(blocks):
            with reading(self.path, f" (at byte {block.offset}){RECOVER}"):
                pending += self._block_messages(block, channels)
            pending.sort()
            after = blocks[k + 1].start_ns if k + 1 < len(blocks) else None
            ready = len(pending) if after is None else bisect_left(pending, (after,))
            for log_ns, _, start, end, channel, data in pending[:ready]:
                yield RawMessage(log_ns, channel, data[start:end])
            del pending[:ready]

    def _open(self) -> None:
        size = self._size = self._stream.seek(0, 2)
        if size == 0:
            raise StorageDamage("the file is empty")
        self._stream.seek(0)
        if self._stream.read(len(MAGIC)) != MAGIC:
            raise StorageDamage("no mcap file (its first bytes are others)")
        if size < len(MAGIC) + FOOTER_BYTES:
            raise StorageDamage("the file is cut off")
        footer = self._read(size - FOOTER_BYTES, FOOTER_BYTES)
        if footer[-len(MAGIC) :] != MAGIC or footer[0] != FOOTER:
            raise StorageDamage("the file is cut off, its footer is missing")
        summary_start, _, crc = _FOOTER(footer, HEADER_BYTES)
        self._data_end = summary_start or size - FOOTER_BYTES
        if not len(MAGIC) <= self._data_end <= size - FOOTER_BYTES:
            raise StorageDamage(f"the footer points to byte {summary_start} of {size}")
        summary = self._read(self._data_end, size - FOOTER_BYTES - self._data_end)
        if crc and zlib.crc32(summary + footer[: HEADER_BYTES + 16]) != crc:
            raise StorageDamage("the summary fails its checksum")
        self._parse_summary(summary)

    def _parse_summary(self, summary: bytes) -> None:
        total = None
        for kind, start, end in split_records(summary):
            body = summary[start:end]
            if kind in (SCHEMA, CHANNEL):
                self._register(kind, body)
            elif kind == CHUNK_INDEX:
                first, last, offset, length = _CHUNK_INDEX(body)
                self._blocks.append(Block(first, last, offset, length, True))
            elif kind == STATISTICS:
                cursor = Cursor(body)
                total = cursor.number(8)
                chunks = Cursor(cursor.take(18)[14:]).number(4)
                self.start_ns, self.end_ns = cursor.number(8), cursor.number(8)
                self._counts = Counter(dict(cursor.pairs()))
        is_indexed = total is not None and chunks == len(self._blocks)
        if (total and (not is_indexed or not self._blocks or not self.channels)) or total is None:
            self._scan()

    def _register(self, kind: int, body: bytes) -> None:
        if kind == SCHEMA:
            number, schema = parse_schema(body)
            self._schemas[number] = schema
        else:
            number, channel = parse_channel(body, self._schemas)
            self.channels[number] = channel

    def _scan(self) -> None:
        """Find channels, blocks, counts and times of a file without an index."""
        self._blocks = []
        counts: Counter[int] = Counter()
        times: list[int] = []
        for block in self._walk():
            messages = self._block_messages(block, None)
            if messages:
                first, last = min(m[0] for m in messages), max(m[0] for m in messages)
                times += [first, last]
                self._blocks.append(block._replace(start_ns=first, end_ns=last))
            counts.update(m[4] for m in messages)
        self._counts = counts
        self.start_ns, self.end_ns = min(times, default=0), max(times, default=0)

    def _walk(self) -> Iterator[Block]:
        """Yield chunks, and runs of other records, of the data section in file order."""
        at = run = len(MAGIC)
        while at < self._data_end:
            header = self._read(at, HEADER_BYTES)
            kind, end = header[0], at + HEADER_BYTES + u64(header, 1)[0]
            if end > self._data_end:
                raise StorageDamage(f"a record at byte {at} is cut off")
            is_chunk = kind == CHUNK
            if at > run and (is_chunk or end - run > BLOCK_BYTES or kind == DATA_END):
                yield Block(0, 0, run, at - run, False)
                run = at
            if is_chunk:
                yield Block(0, 0, at, end - at, True)
                run = end
            if kind == DATA_END:
                return
            at = end
        if at > run:
            yield Block(0, 0, run, at - run, False)

    def _block_messages(self, block: Block, channels: Collection[int] | None) -> list[Found]:
        """Return the messages of a block on some channels; None takes all and their channels."""
        data = self._read(block.offset, block.length)
        if block.is_chunk:
            if data[:1] != bytes([CHUNK]) or u64(data, 1)[0] != block.length - HEADER_BYTES:
                raise StorageDamage("the index points to something that is no chunk")
            data = chunk_records(memoryview(data)[HEADER_BYTES:])
        found: list[Found] = []
        for kind, start, end in split_records(data):
            if kind == MESSAGE:
                begin = start + MESSAGE_HEADER_BYTES
                if begin > end:
                    raise StorageDamage(f"a message record has {end - start} bytes")
                channel, _, log_ns, _ = message_header(data, start)
                if channels is None or channel in channels:
                    found.append((log_ns, block.offset, begin, end, channel, data))
            elif kind in (SCHEMA, CHANNEL) and channels is None:
                self._register(kind, data[start:end])
        return found

    def _read(self, offset: int, count: int) -> bytes:
        """Return bytes of the file; StorageDamage where it has fewer, before any allocation."""
        if offset + count <= self._size:
            self._stream.seek(offset)
            data = self._stream.read(count)
            if len(data) == count:
                return data
        raise StorageDamage(f"{count} bytes at byte {offset} are wanted, it has {self._size}")
