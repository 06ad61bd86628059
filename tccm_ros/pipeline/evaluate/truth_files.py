"""Trajectories, relations and references from text files.

Stamps are read as integer nanoseconds from their digits, never through a float.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tccm_ros.errors import LogError, one_line
from tccm_ros.geometry import pose_from_quaternion, pose_from_rpy, spatial

__all__ = [
    "Reference",
    "Relations",
    "Trajectory",
    "read_reference",
    "read_relations",
    "read_stamps",
    "read_truth",
    "read_tum",
]

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

PLANAR_COLUMNS = 5
"""Two stamps, x, y and yaw."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Poses T_map_base float64 (N, 4, 4) at stamps int64 (N,), strictly ascending."""

    stamps_ns: Int64
    poses: Float64


@dataclass(frozen=True, slots=True, eq=False)
class Relations:
    """Relative poses T_from_to float64 (N, 4, 4) between stamps int64 (N,)."""

    from_ns: Int64
    to_ns: Int64
    deltas: Float64


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Poses of some scans of a raw log: index, logged stamp, T_map_base float64 (N, 4, 4)."""

    scan_index: Int64
    stamps_ns: Int64
    poses: Float64


def read_tum(path: Path | str) -> Trajectory:
    """Read ``stamp x y z qx qy qz qw`` lines; rows of one stamp keep the last.

    Raises
    ------
    LogError
        For a file that is missing or not of this form.
    """
    stamps, values = _columns(path, stamps=1, numbers=7)
    norms = np.linalg.norm(values[:, 3:], axis=1)
    if np.any(np.abs(norms - 1.0) > 0.01):
        row = int(np.argmax(np.abs(norms - 1.0)))
        raise LogError(f"{path}: quaternion of pose {row} has length {norms[row]:.3f}, not 1")
    order = np.unique(stamps[::-1, 0], return_index=True)[1]
    keep = len(stamps) - 1 - order
    poses = pose_from_quaternion(values[keep, :3], values[keep, 3:])
    return Trajectory(stamps[keep, 0], poses)


def read_relations(path: Path | str) -> Relations:
    """Read ``stamp stamp x y z roll pitch yaw`` lines, as the SLAM benchmark publishes them.

    Lines of five columns are planar: ``stamp stamp x y yaw``.

    Raises
    ------
    LogError
        For a file that is missing or not of this form.
    """
    if min(len(row) for row in _lines(path)) == PLANAR_COLUMNS:
        stamps, values = _columns(path, stamps=2, numbers=3)
        return Relations(stamps[:, 0], stamps[:, 1], spatial(values))
    stamps, values = _columns(path, stamps=2, numbers=6)
    deltas = np.stack([pose_from_rpy(row) for row in values])
    return Relations(stamps[:, 0], stamps[:, 1], deltas)


def read_reference(path: Path | str) -> Reference:
    """Read ``raw_scan_index stamp x y theta ...`` lines.

    Raises
    ------
    LogError
        For a file that is missing or not of this form.
    """
    stamps, values = _columns(path, stamps=2, numbers=3)
    return Reference(stamps[:, 0] // 1_000_000_000, stamps[:, 1], spatial(values))


def read_stamps(path: Path | str, *, key: str = "raw_scan_index") -> dict[int, int]:
    """Read stamps.csv of an imported log: scan index, or logged ``ipc_time`` (ns) -> bag's stamp.

    Raises
    ------
    LogError
        For a file that is missing or not of this form.
    """
    try:
        with Path(path).open(encoding="ascii", newline="") as file:
            rows = list(csv.DictReader(file))
        parse = _nanoseconds if key == "ipc_time" else int
        return {parse(row[key]): _nanoseconds(row["stamp"]) for row in rows}
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({one_line(error)})") from None
    except (KeyError, TypeError, ValueError, InvalidOperation):
        raise LogError(f"{path}: not a stamps.csv; columns raw_scan_index, stamp") from None


def read_truth(path: Path | str) -> Trajectory | Relations | Reference:
    """Read a truth file of any of the three kinds, told apart by its numbers.

    A quaternion has length 1; a reference begins with whole numbers; the rest are relations.

    Raises
    ------
    LogError
        For a file that is missing or of no such kind.
    """
    _columns(path, stamps=2, numbers=3)
    if Path(path).suffix == ".relations":
        return read_relations(path)
    full = _numbers(path)
    if full.shape[1] == 8 and np.all(np.abs(np.linalg.norm(full[:, 4:], axis=1) - 1.0) < 0.01):
        return read_tum(path)
    whole = bool(np.all(full[:, 0] == np.rint(full[:, 0])) and np.all(full[:, 0] < 1e8))
    if whole and np.all(np.diff(full[:, 0]) > 0):
        return read_reference(path)
    if full.shape[1] in (8, PLANAR_COLUMNS):
        return read_relations(path)
    raise LogError(f"{path}: neither a trajectory (TUM), relations, nor a reference")


def _lines(path: Path | str) -> list[list[str]]:
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: cannot be read ({one_line(error)})") from None
    rows = [line.replace(",", " ").split() for line in text.splitlines()]
    rows = [row for row in rows if row and not row[0].startswith("#")]
    if not rows:
        raise LogError(f"{path}: no rows")
    return rows


def _numbers(path: Path | str) -> Float64:
    rows = _lines(path)
    width = min(len(row) for row in rows)
    return np.array([[float(x) for x in row[:width]] for row in rows])


def _columns(path: Path | str, *, stamps: int, numbers: int) -> tuple[Int64, Float64]:
    """Return the first columns as nanoseconds int64 (N, stamps), the next as float64."""
    times, values = [], []
    for k, row in enumerate(_lines(path)):
        try:
            times.append([_nanoseconds(x) for x in row[:stamps]])
            values.append([float(x) for x in row[stamps : stamps + numbers]])
        except (ValueError, InvalidOperation):
            raise LogError(
                f"{path}: row {k} is not made of numbers; expected a trajectory (TUM), relations "
                "or a reference"
            ) from None
        if len(times[-1]) + len(values[-1]) < stamps + numbers or not np.all(
            np.isfinite(values[-1])
        ):
            raise LogError(f"{path}: row {k} needs {stamps + numbers} finite numbers")
    return np.array(times, np.int64), np.array(values)


def _nanoseconds(text: str) -> int:
    number = Decimal(text)
    if not number.is_finite() or abs(number) > Decimal(9_000_000_000):
        raise ValueError(text)
    return int((number * 1_000_000_000).to_integral_value())
