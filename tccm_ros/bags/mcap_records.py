"""The records of mcap files: taken apart with every size checked."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import NamedTuple

from tccm_ros.bags.storage import Channel, StorageDamage, decompress

__all__ = [
    "CHANNEL",
    "CHUNK",
    "CHUNK_INDEX",
    "DATA_END",
    "FOOTER",
    "HEADER_BYTES",
    "MAGIC",
    "MESSAGE",
    "MESSAGE_HEADER_BYTES",
    "SCHEMA",
    "STATISTICS",
    "Cursor",
    "Schema",
    "chunk_records",
    "message_header",
    "parse_channel",
    "parse_schema",
    "split_records",
    "u64",
]

MAGIC = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, CHUNK_INDEX, STATISTICS, DATA_END = (
    2, 3, 4, 5, 6, 8, 11, 15,
)  # fmt: skip
HEADER_BYTES = 9
MESSAGE_HEADER_BYTES = 22

u64 = struct.Struct("<Q").unpack_from
"""Take one number: (value,) of bytes and an offset."""

message_header = struct.Struct("<HIQQ").unpack_from
"""Take the front of a message record: channel, sequence, log time, publish time."""

_CHUNK = struct.Struct("<QQQI").unpack_from


class Schema(NamedTuple):
    """A message type: name, encoding of the definition, and the definition."""

    name: str
    encoding: str
    text: str


class Cursor:
    """Takes fields off the front of a record; StorageDamage where it ends too early."""

    def __init__(self, data: bytes | memoryview) -> None:
        self._data = memoryview(data)
        self._at = 0

    def take(self, count: int) -> memoryview:
        """Return the next bytes."""
        piece = self._data[self._at : self._at + count]
        if len(piece) != count:
            raise StorageDamage(f"a record ends {count - len(piece)} bytes too early")
        self._at += count
        return piece

    def number(self, size: int) -> int:
        """Return the next unsigned integer of `size` bytes."""
        return int.from_bytes(self.take(size), "little")

    def text(self) -> str:
        """Return the next string."""
        return bytes(self.take(self.number(4))).decode(errors="replace")

    def pairs(self) -> list[tuple[int, int]]:
        """Return the next map of channel to number."""
        data = self.take(self.number(4))
        return list(struct.iter_unpack("<HQ", data))

    def texts(self) -> dict[str, str]:
        """Return the next map of string to string."""
        inner = Cursor(self.take(self.number(4)))
        result = {}
        while inner._at < len(inner._data):
            key = inner.text()
            result[key] = inner.text()
        return result


def parse_schema(body: bytes | memoryview) -> tuple[int, Schema]:
    """Return number and content of a schema record."""
    cursor = Cursor(body)
    return cursor.number(2), Schema(cursor.text(), cursor.text(), cursor.text())


def parse_channel(body: bytes | memoryview, schemas: dict[int, Schema]) -> tuple[int, Channel]:
    """Return number and content of a channel record."""
    cursor = Cursor(body)
    number = cursor.number(2)
    schema = schemas.get(cursor.number(2), Schema("", "", ""))
    topic, encoding = cursor.text(), cursor.text()
    qos = cursor.texts().get("offered_qos_profiles", "")
    return number, Channel(topic, schema.name, encoding, schema.text, schema.encoding, qos)


def split_records(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield (kind, start, end) of the body of each record of a chunk or summary."""
    at, size = 0, len(data)
    while at < size:
        if at + HEADER_BYTES > size:
            raise StorageDamage("a record header is cut off")
        end = at + HEADER_BYTES + u64(data, at + 1)[0]
        if end > size:
            raise StorageDamage(f"a record ends {end - size} bytes after its block")
        yield data[at], at + HEADER_BYTES, end
        at = end


def chunk_records(body: bytes | memoryview) -> bytes:
    """Return the records of a chunk, unpacked and compared with their checksum."""
    cursor = Cursor(body)
    _, _, size, crc = _CHUNK(cursor.take(28))
    compression = cursor.text()
    records = decompress(cursor.take(cursor.number(8)), compression, size)
    if crc and zlib.crc32(records) != crc:
        raise StorageDamage("a chunk fails its checksum")
    return records
