"""Pack arrays into an HTML page: one block of bytes, compressed, as base64 text."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

Reference = tuple[str, int, int]
"""Type (f4, f8, i2, u2), byte offset and count: how the page finds an array."""

TYPES = {"f4": np.float32, "f8": np.float64, "i2": np.int16, "u2": np.uint16}
ALIGNMENT = 8
"""Bytes: typed arrays of a page begin at multiples of their element size."""

ZIP_LEVEL = 9
"""Deflate level. Chosen: the smallest page."""


class ArrayPack:
    """Collects flat arrays; `text` is what goes into the page."""

    def __init__(self) -> None:
        self._chunks: list[bytes] = []
        self._size = 0

    def add(self, values: NDArray[Any], kind: str) -> Reference:
        """Append an array, flattened, as little-endian numbers of one kind; see `Reference`.

        Whole numbers must fit; they wrap otherwise.
        """
        data = np.ascontiguousarray(np.asarray(values).astype(TYPES[kind])).ravel()
        content = data.astype(data.dtype.newbyteorder("<")).tobytes()
        reference = (kind, self._size, len(data))
        padded = content + bytes(-len(content) % ALIGNMENT)
        self._chunks.append(padded)
        self._size += len(padded)
        return reference

    def text(self) -> str:
        """Return everything, deflated (RFC 1950) and in base64."""
        return base64.b64encode(zlib.compress(b"".join(self._chunks), ZIP_LEVEL)).decode("ascii")


def differences(column: NDArray[Any]) -> NDArray[np.int16]:
    """Return int16 steps from row to row, modulo 2^16, from whole numbers (N,).

    Sorted cells differ little from row to row, and small numbers compress to a fraction.
    """
    values = np.asarray(column).astype(np.int64)
    return np.diff(values, prepend=0).astype(np.int16)
