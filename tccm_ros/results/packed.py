"""Named arrays as one compressed block: like bytes lie together, what occurs twice is kept once.

Numbers of a map are sorted or small: of a column of integers most bytes are zeros, or what the byte
before was. So integers are laid out by columns and the bytes of a column by their places. Floating
numbers are as they lie in memory: there the same rows occur in several arrays, and the compression,
whose window is as long as the block, finds them.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from math import prod
from typing import Any

import numpy as np
import zstandard
from numpy.typing import NDArray

__all__ = ["pack_arrays", "unpack_arrays"]

LEVEL = 3
"""Effort: higher ones take twice as long for 2 %."""

WINDOW_LOG = 27
"""Repetitions are found over 2 to the power of this many bytes, the most that readers allow."""

LENGTH = struct.Struct("<Q")
"""Before the table of the arrays, its bytes."""

MOST_TIMES = 1000
"""No block of arrays becomes this many times as large,"""

LEAST_LIMIT = 64 << 20
"""unless it is smaller than this, bytes, all the same."""


def pack_arrays(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Return arrays of numbers as a block; the same arrays give the same bytes.

    Raises
    ------
    TypeError
        For arrays of anything else.
    """
    table, parts = [], []
    for name, array in arrays.items():
        if array.dtype.kind not in "biuf":
            raise TypeError(f"'{name}' has no numbers but {array.dtype}")
        array = array.astype(array.dtype.newbyteorder("<"), copy=False)
        table.append([name, array.dtype.str, list(array.shape)])
        parts.append(_by_places(array) if _is_sorted_out(array.dtype) else array.tobytes())
    text = json.dumps(table, separators=(",", ":")).encode()
    effort = zstandard.ZstdCompressionParameters.from_level(
        LEVEL, window_log=WINDOW_LOG, enable_ldm=True, write_content_size=True
    )
    content = b"".join([LENGTH.pack(len(text)), text, *parts])
    return zstandard.ZstdCompressor(compression_params=effort).compress(content)


def unpack_arrays(block: bytes) -> dict[str, NDArray[Any]]:
    """Return the arrays of `pack_arrays`.

    Raises
    ------
    ValueError
        Where the block is none of that.
    """
    try:
        declared = zstandard.frame_content_size(block)
        if not 0 <= declared <= max(MOST_TIMES * len(block), LEAST_LIMIT):
            raise ValueError(f"a block of {len(block)} bytes declares {declared}")
        content = zstandard.ZstdDecompressor().decompress(block)
        (length,) = LENGTH.unpack_from(content)
        table = json.loads(content[LENGTH.size : LENGTH.size + length])
        return _arrays(table, content, LENGTH.size + length)
    except (zstandard.ZstdError, struct.error, TypeError, OverflowError, MemoryError) as error:
        raise ValueError(f"a block of arrays is damaged: {error}") from None


def _arrays(table: list[Any], content: bytes, start: int) -> dict[str, NDArray[Any]]:
    arrays = {}
    for name, kind, shape in table:
        dtype = np.dtype(kind)
        if dtype.kind not in "biuf" or min(shape, default=0) < 0:
            raise ValueError(f"'{name}' is declared as {kind} of {shape}")
        count = prod(shape)
        if start + count * dtype.itemsize > len(content):
            raise ValueError(f"'{name}' is cut off")
        if _is_sorted_out(dtype):
            arrays[name] = _from_places(content, start, dtype, shape)
        else:  # a copy, or one array would keep the whole block alive
            arrays[name] = np.frombuffer(content, dtype, count, start).reshape(shape).copy()
        start += count * dtype.itemsize
    if start != len(content):
        raise ValueError(f"{len(content) - start} bytes belong to no array")
    return arrays


def _is_sorted_out(dtype: np.dtype[Any]) -> bool:
    return dtype.kind in "iu" and dtype.itemsize > 1


def _by_places(array: NDArray[Any]) -> bytes:
    """Return the bytes of integers: of all columns the first bytes, then the second ones, ..."""
    if array.size == 0:
        return b""
    columns = np.ascontiguousarray(array.reshape(len(array), -1).T if array.ndim > 1 else array)
    return columns.view(np.uint8).reshape(-1, array.itemsize).T.tobytes()


def _from_places(
    content: bytes, start: int, dtype: np.dtype[Any], shape: list[int]
) -> NDArray[Any]:
    """Return the integers of `_by_places`."""
    count = prod(shape)
    places = np.frombuffer(content, np.uint8, count * dtype.itemsize, start)
    columns: NDArray[Any] = np.ascontiguousarray(places.reshape(dtype.itemsize, count).T)
    columns = columns.view(dtype).ravel()
    if len(shape) > 1 and count:
        columns = columns.reshape(-1, shape[0]).T
    return np.array(columns, order="C").reshape(shape)
