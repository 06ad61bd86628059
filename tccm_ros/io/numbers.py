"""Values in files: rounded to 1e-6, no negative zero, infinities as null, the same bytes always."""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Stamp", "array_archive", "json_text", "rounded"]

DIGITS = 6
"""Floats are rounded to this many decimals."""

ZIP_TIME = (1980, 1, 1, 0, 0, 0)
"""Times in an archive would make two runs differ."""

OPEN_LEVELS = 3
"""Levels of a JSON file that have a line for each entry; deeper ones are on one line."""


@dataclass(frozen=True, slots=True)
class Stamp:
    """A time, written in s with 9 decimals, exactly."""

    stamp_ns: int

    def __str__(self) -> str:
        sign = "-" if self.stamp_ns < 0 else ""
        whole, rest = divmod(abs(int(self.stamp_ns)), 1_000_000_000)
        return f"{sign}{whole}.{rest:09d}"


def rounded(value: float) -> float | None:
    """Round a number to 1e-6; None where it is not finite, 0.0 for a negative zero."""
    return round(float(value), DIGITS) + 0.0 if math.isfinite(value) else None


def json_text(value: Any) -> str:
    """Return a value as JSON, with a final newline.

    Parameters
    ----------
    value
        Mappings, sequences, arrays, numbers, text, None and `Stamp`.

    Raises
    ------
    TypeError
        For anything else.
    """
    return _json(value, 0) + "\n"


def _json(value: Any, level: int) -> str:
    if isinstance(value, np.ndarray | np.generic):
        return _json(value.tolist(), level)
    if isinstance(value, Stamp):
        return str(value)
    if isinstance(value, float):
        return json.dumps(rounded(value))
    if value is None or isinstance(value, bool | int | str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, Mapping):
        items = [f"{json.dumps(str(k))}: {_json(v, level + 1)}" for k, v in value.items()]
        return _bracketed("{", items, "}", level)
    if isinstance(value, list | tuple):
        return _bracketed("[", [_json(item, level + 1) for item in value], "]", level)
    raise TypeError(f"JSON has no form of {type(value).__name__}")


def _bracketed(left: str, items: list[str], right: str, level: int) -> str:
    if not items or level >= OPEN_LEVELS:
        return left + ", ".join(items) + right
    pad = " " * (level + 1)
    return left + "\n" + ",\n".join(pad + item for item in items) + "\n" + " " * level + right


def array_archive(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Return arrays as a compressed .npz file: no pickle, the same arrays give the same bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            entry = io.BytesIO()
            np.lib.format.write_array(entry, np.asanyarray(array), allow_pickle=False)
            info = zipfile.ZipInfo(f"{name}.npy", ZIP_TIME)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, entry.getvalue())
    return buffer.getvalue()


def write_bytes(path: Path, content: bytes | str) -> None:
    """Write a file in a folder that is made ready."""
    path.write_bytes(content.encode() if isinstance(content, str) else content)
