"""Numbers and arrays as JSON, rounded to 1e-6 and byte-identical for the same values.

Negative zero is written as 0, and numbers that are not finite as null.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from tccm_ros.atomic import write_output

DIGITS = 6
"""Number of decimals of floats. Chosen: a micrometre."""

OPEN_LEVELS = 3
"""Levels of a JSON file with a line per entry; deeper levels are written on one line."""


class Stamp(float):
    """A time in s that keeps its nanoseconds and is written exactly, with 9 decimals.

    Attributes
    ----------
    stamp_ns
        The same time, ns.
    """

    __slots__ = ("stamp_ns",)
    stamp_ns: int

    def __new__(cls, stamp_ns: int) -> Stamp:
        """Return the time of integer nanoseconds."""
        stamp = super().__new__(cls, stamp_ns * 1e-9)
        stamp.stamp_ns = int(stamp_ns)
        return stamp

    def __str__(self) -> str:
        sign = "-" if self.stamp_ns < 0 else ""
        whole, rest = divmod(abs(self.stamp_ns), 1_000_000_000)
        return f"{sign}{whole}.{rest:09d}"


def key_of(name: str) -> str:
    """Return the key of a field in a file: its name without a trailing underscore."""
    return name.removesuffix("_")


def rounded(value: float) -> float | None:
    """Round a number to 1e-6; return None if it is not finite, 0.0 for a negative zero."""
    return round(float(value), DIGITS) + 0.0 if math.isfinite(value) else None


def json_text(value: Any) -> str:
    """Return a value as JSON, with a final newline.

    Parameters
    ----------
    value
        Dataclasses, mappings, sequences, arrays, numbers, text, None and `Stamp`.

    Raises
    ------
    TypeError
        If a value has another type.
    """
    return _json(value, 0) + "\n"


def plain(value: Any) -> Any:
    """Return a value as `json_text` writes it: plain data, rounded."""
    return json.loads(json_text(value))


def write_json(path: Path | str, value: Any) -> None:
    """Write a value as a JSON file; errors as of `output_file`."""
    write_output(path, json_text(value))


def _json(value: Any, level: int) -> str:
    if isinstance(value, np.ndarray) and value.ndim and level >= OPEN_LEVELS:
        return _array_json(value)
    if isinstance(value, np.ndarray | np.generic):
        return _json(value.tolist(), level)
    if isinstance(value, Stamp):
        return str(value)
    if isinstance(value, float):
        near = rounded(value)
        return "null" if near is None else repr(near)
    if value is None or isinstance(value, bool | int | str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, Mapping):
        items = [f"{json.dumps(str(k))}: {_json(v, level + 1)}" for k, v in value.items()]
        return _bracketed("{", items, "}", level)
    if is_dataclass(value):
        kind: Any = type(value)
        items = [f'"{key}": {_json(getattr(value, name), level + 1)}' for name, key in _keys(kind)]
        return _bracketed("{", items, "}", level)
    if isinstance(value, list | tuple):
        return _bracketed("[", [_json(item, level + 1) for item in value], "]", level)
    raise TypeError(f"JSON has no form of {type(value).__name__}")


@cache
def _keys(kind: type) -> list[tuple[str, str]]:
    """Return the names of a dataclass's fields with their keys in a file."""
    return [(field.name, key_of(field.name)) for field in fields(kind)]


def _array_json(values: NDArray[Any]) -> str:
    """Return an array on one line, which is faster than value by value."""
    plain = rounded_list(values) if values.dtype.kind == "f" else values.tolist()
    return json.dumps(plain, ensure_ascii=False)


def rounded_list(values: NDArray[np.floating[Any]]) -> list[Any]:
    """Return an array as nested lists, each value as `rounded` returns it."""
    exact = np.asarray(values, np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = exact * 10.0**DIGITS
        whole = np.rint(scaled)
        # Below 1e6 the product has an error below 1e-4, so rounding to the nearest integer is right
        # except near halves, and the quotient is the double nearest to the decimal.
        is_sure = (np.abs(scaled - whole) < 0.499) & (np.abs(exact) < 1e6)
    result = whole / 10.0**DIGITS + 0.0
    if is_sure.all():
        return cast(list[Any], result.tolist())
    mixed = result.astype(object)
    mixed[~is_sure] = [rounded(v) for v in exact[~is_sure].tolist()]
    return cast(list[Any], mixed.tolist())


def _bracketed(left: str, items: list[str], right: str, level: int) -> str:
    if not items or level >= OPEN_LEVELS:
        return left + ", ".join(items) + right
    pad = " " * (level + 1)
    return left + "\n" + ",\n".join(pad + item for item in items) + "\n" + " " * level + right
