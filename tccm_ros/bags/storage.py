"""What the storage files of a bag have in common: channels, compression, and their damage."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import lz4.frame
import zstandard

from tccm_ros.errors import BagError, one_line

__all__ = [
    "ZSTD_MAGIC",
    "Channel",
    "RawMessage",
    "StorageDamage",
    "decompress",
    "expand_message",
    "reading",
]

MAX_BLOCK_BYTES = 2**30
"""Largest chunk or message that is unpacked; a damaged file may declare any size."""

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


class StorageDamage(ValueError):
    """Bytes of a storage file that contradict each other; `reading` makes a BagError of it."""


class Channel(NamedTuple):
    """A topic as a storage file describes it; `qos` is rosbag2's YAML text."""

    topic: str
    msgtype: str
    encoding: str
    definition: str
    definition_encoding: str
    qos: str


class RawMessage(NamedTuple):
    """A serialised message; `channel` is the key of its Channel within its file."""

    log_ns: int
    channel: int
    data: bytes


@contextmanager
def reading(path: Path, advice: str = "") -> Iterator[None]:
    """Turn everything that damage can raise into one BagError that names the file and the cause."""
    try:
        yield
    except FileNotFoundError:
        raise BagError(f"{path}: no such file") from None
    except (
        OSError,
        ValueError,
        struct.error,
        OverflowError,
        MemoryError,
        RuntimeError,
        zlib.error,
        zstandard.ZstdError,
    ) as error:
        raise BagError(f"{path}: {one_line(error)}{advice}") from None


def decompress(data: bytes | memoryview, compression: str, size: int) -> bytes:
    """Unpack a chunk that declares `size` bytes.

    Raises
    ------
    StorageDamage
        Where the result is not of that size, or where the compression is unknown; nothing larger
        than the declared size is allocated.
    """
    if size > MAX_BLOCK_BYTES:
        raise StorageDamage(f"a chunk declares {size} bytes, more than {MAX_BLOCK_BYTES}")
    if compression == "":
        result = bytes(data)
    elif compression == "zstd":
        result = _unpack_zstd(data, size)
    elif compression == "lz4":
        result = lz4.frame.LZ4FrameDecompressor().decompress(bytes(data), max_length=size + 1)
    else:
        raise StorageDamage(f"a chunk is compressed by '{compression}', expected zstd or lz4")
    if len(result) != size:
        raise StorageDamage(f"a chunk has {len(result)} bytes, expected {size}")
    return result


def expand_message(data: bytes) -> bytes:
    """Unpack a message that begins with `ZSTD_MAGIC`: the bag has message compression.

    A serialised message begins with 0 and cannot be taken for a compressed one.
    """
    declared = zstandard.frame_content_size(data)
    size = declared if declared >= 0 else MAX_BLOCK_BYTES
    if size > MAX_BLOCK_BYTES:
        raise StorageDamage(f"a message declares {size} bytes, more than {MAX_BLOCK_BYTES}")
    return _unpack_zstd(data, size)


def _unpack_zstd(data: bytes | memoryview, size: int) -> bytes:
    """Unpack at most `size` bytes, piece by piece where the frame does not say how many."""
    declared = zstandard.frame_content_size(data)
    if declared > size:
        raise StorageDamage(f"a chunk has {declared} bytes, expected {size}")
    reader: Any = zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True)
    pieces = []
    left = size + 1
    while left > 0 and (piece := reader.read(min(left, 2**20))):
        pieces.append(piece)
        left -= len(piece)
    return b"".join(pieces)
