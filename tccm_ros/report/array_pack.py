"""Pack arrays into an HTML page as one compressed, base64-encoded block."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

Reference = tuple[str, int, int]
"""Type (f4, f8, i2, u2), byte offset and count of an array, for the page's script."""

TYPES = {"f4": np.float32, "f8": np.float64, "i2": np.int16, "u2": np.uint16}
ALIGNMENT = 8
"""Alignment, bytes: typed arrays must begin at multiples of their element size."""


class ArrayPack:
    """Collects flat arrays; `text` returns them for the page."""

    def __init__(self) -> None:
        self._chunks: list[bytes] = []
        self._size = 0

    def add(self, values: NDArray[Any], kind: str) -> Reference:
        """Append a flattened array as little-endian numbers of a type; return its `Reference`.

        Integers wrap if they do not fit.
        """
        data = np.ascontiguousarray(np.asarray(values).astype(TYPES[kind])).ravel()
        content = data.astype(data.dtype.newbyteorder("<")).tobytes()
        reference = (kind, self._size, len(data))
        padded = content + bytes(-len(content) % ALIGNMENT)
        self._chunks.append(padded)
        self._size += len(padded)
        return reference

    def text(self) -> str:
        """Return all arrays, deflated (RFC 1950) and base64-encoded."""
        return base64.b64encode(zlib.compress(b"".join(self._chunks))).decode("ascii")


class PlainArrays(ArrayPack):
    """Leaves arrays in the JSON, as flat lists of numbers rounded to millimetres."""

    def add(self, values: NDArray[Any], kind: str) -> Any:
        """Return the numbers themselves."""
        flat = np.asarray(values).astype(TYPES[kind]).ravel()
        return [round(value, 3) for value in flat.tolist()]


def differences(column: NDArray[Any]) -> NDArray[np.int16]:
    """Return the steps between successive integers (N,), int16, modulo 2^16.

    Sorted cells have small steps, which compress well.
    """
    values = np.asarray(column).astype(np.int64)
    return np.diff(values, prepend=0).astype(np.int16)
