"""Ground truth of a trajectory from text files: poses, relations or a reference."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from decimal import InvalidOperation
from pathlib import Path

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.errors import LogError, one_line
from tccm_ros.geometry import pose_from_rpy, spatial
from tccm_ros.results.trajectory import (
    MAX_NORM_ERROR,
    Trajectory,
    nanoseconds,
    number_columns,
    read_tum,
    text_rows,
)

TUM_COLUMNS = 8
"""Stamp, position and quaternion."""

PLANAR_COLUMNS = 5
"""Two stamps, x, y and yaw."""

STAMP_UNITS = {"s": 1, "ms": 1_000, "us": 1_000_000, "ns": 1_000_000_000}
"""Units of stamps, and how many of them are a second; files are expected in s."""


@dataclass(frozen=True, slots=True, eq=False)
class Relations:
    """Relative poses between stamps.

    Attributes
    ----------
    from_ns, to_ns
        int64 (N,).
    deltas
        T_from_to, float64 (N, 4, 4).
    """

    from_ns: Int64
    to_ns: Int64
    deltas: Float64


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Poses of some scans of a raw log.

    Attributes
    ----------
    scan_index
        int64 (N,), index among all scans of the log.
    stamps_ns
        int64 (N,), stamps as logged, ns.
    poses
        T_map_base, float64 (N, 4, 4).
    """

    scan_index: Int64
    stamps_ns: Int64
    poses: Float64


def read_relations(path: Path | str, *, per_second: int = 1) -> Relations:
    """Read ``stamp stamp x y z roll pitch yaw`` lines, the format of the SLAM benchmark.

    Lines of five columns are planar: ``stamp stamp x y yaw``.

    Raises
    ------
    LogError
        If the file is missing or has another format.
    """
    if min(len(row) for row in _rows(path)) == PLANAR_COLUMNS:
        stamps, values = number_columns(path, stamps=2, numbers=3, per_second=per_second)
        return Relations(stamps[:, 0], stamps[:, 1], spatial(values))
    stamps, values = number_columns(path, stamps=2, numbers=6, per_second=per_second)
    deltas = np.stack([pose_from_rpy(row) for row in values])
    return Relations(stamps[:, 0], stamps[:, 1], deltas)


def read_reference(path: Path | str, *, per_second: int = 1) -> Reference:
    """Read ``raw_scan_index stamp x y theta ...`` lines.

    Raises
    ------
    LogError
        If the file is missing or has another format.
    """
    stamps, values = number_columns(path, stamps=2, numbers=3, per_second=per_second)
    index = stamps[:, 0] * per_second // 1_000_000_000
    return Reference(index, stamps[:, 1], spatial(values))


def read_stamps(path: Path | str, *, key: str = "raw_scan_index") -> dict[int, int]:
    """Read stamps.csv of an imported log: bag stamp by scan index or by logged ``ipc_time``, ns.

    Raises
    ------
    LogError
        If the file is missing or has another format.
    """
    try:
        with Path(path).open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.DictReader(file))
        parse = nanoseconds if key == "ipc_time" else int
        return {parse(row[key]): nanoseconds(row["stamp"]) for row in rows}
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({one_line(error)})") from None
    except (KeyError, TypeError, ValueError, InvalidOperation):
        raise LogError(f"{path}: not a stamps.csv; columns raw_scan_index, stamp") from None


def read_truth(path: Path | str, *, per_second: int = 1) -> Trajectory | Relations | Reference:
    """Read a truth file of any kind, recognised by its numbers.

    If most quaternions have length 1, it is a trajectory, whose rows may begin with an index. A
    reference begins with integers. Other files are relations.

    Parameters
    ----------
    path
        The file.
    per_second
        Unit of the stamps, a value of `STAMP_UNITS`.

    Raises
    ------
    LogError
        If the file is missing or of no such kind.
    """
    number_columns(path, stamps=2, numbers=3, per_second=max(STAMP_UNITS.values()))
    if Path(path).suffix == ".relations":
        return read_relations(path, per_second=per_second)
    full = _numbers(path)
    index = full[:, 0]
    is_indexed = bool(np.all(index == np.rint(index)) and np.all(index < 1e8))
    is_indexed &= bool(np.all(np.diff(index) > 0))
    for first in (0, 1) if is_indexed else (0,):
        norms = np.linalg.norm(full[:, first + 4 :], axis=1)
        is_unit = np.abs(norms - 1.0) < MAX_NORM_ERROR
        if full.shape[1] == first + TUM_COLUMNS and is_unit.mean() > 0.5:
            return read_tum(path, first=first, per_second=per_second)
    if is_indexed:
        return read_reference(path, per_second=per_second)
    if full.shape[1] in (8, PLANAR_COLUMNS):
        return read_relations(path, per_second=per_second)
    raise LogError(f"{path}: neither a trajectory (TUM), relations, nor a reference")


def _rows(path: Path | str) -> list[list[str]]:
    rows = text_rows(path)
    if not rows:
        raise LogError(f"{path}: no rows")
    return rows


def _numbers(path: Path | str) -> Float64:
    rows = _rows(path)
    width = min(len(row) for row in rows)
    return np.array([[float(x) for x in row[:width]] for row in rows])
