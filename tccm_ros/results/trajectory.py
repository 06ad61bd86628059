"""Trajectories in TUM format, and text files with rows of stamps and numbers.

Stamps are parsed from their digits to integer nanoseconds, without floats.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.errors import LogError, one_line
from tccm_ros.geometry import pose_from_quaternion, quaternion
from tccm_ros.results.numbers import Stamp, rounded

MAX_STAMP_S = Decimal(9_000_000_000)
"""Maximum stamp, s, a little below the limit of int64 nanoseconds."""

MAX_NORM_ERROR = 0.01
"""Maximum deviation of a quaternion's norm from 1. Chosen: files with two decimals pass."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Poses of the base in map: the rows of trajectory.tum.

    Attributes
    ----------
    stamps_ns
        int64 (N,), strictly ascending.
    T_map_base
        float64 (N, 4, 4).
    """

    stamps_ns: Int64
    T_map_base: Float64

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @property
    def stamps(self) -> Float64:
        """Stamps in s, float64 (N,)."""
        return np.asarray(self.stamps_ns * 1e-9, np.float64)

    @property
    def positions(self) -> Float64:
        """Positions of the base in map, float64 (N, 3), m."""
        return self.T_map_base[:, :3, 3]

    @property
    def length(self) -> float:
        """Path length over ground, m."""
        steps = np.diff(self.positions[:, :2], axis=0)
        return float(np.hypot(steps[:, 0], steps[:, 1]).sum())

    def nearest(self, stamps: Float64) -> Int64:
        """Return the index int64 (M,) of the pose nearest to each stamp, s; N must not be 0."""
        known = self.stamps
        right = np.clip(np.searchsorted(known, stamps), 1, max(len(known) - 1, 1))
        right = np.minimum(right, len(known) - 1)
        left = np.maximum(right - 1, 0)
        earlier = np.abs(known[left] - stamps) <= np.abs(known[right] - stamps)
        return np.where(earlier, left, right)

    def tum(self) -> str:
        """Return trajectory.tum: ``stamp x y z qx qy qz qw``, one line per pose."""
        if not len(self):
            return ""
        rows = np.concatenate([self.positions, quaternion(self.T_map_base)], axis=1)
        return "".join(
            f"{Stamp(int(stamp))} " + " ".join(f"{rounded(v):.6f}" for v in row) + "\n"
            for stamp, row in zip(self.stamps_ns, rows)
        )


def read_tum(path: Path | str, *, first: int = 0, per_second: int = 1) -> Trajectory:
    """Read ``stamp x y z qx qy qz qw`` lines; the last row of equal stamps is kept.

    Parameters
    ----------
    path
        The file.
    first
        Number of columns before the stamp, which are skipped.
    per_second
        Unit of the stamps, as in `number_columns`.

    Raises
    ------
    LogError
        If the file is missing or has another format.
    """
    stamps, values = number_columns(path, stamps=1, numbers=7, first=first, per_second=per_second)
    if not len(stamps):
        return Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    norms = np.linalg.norm(values[:, 3:], axis=1)
    if np.any(np.abs(norms - 1.0) > MAX_NORM_ERROR):
        row = int(np.argmax(np.abs(norms - 1.0)))
        raise LogError(f"{path}: quaternion of pose {row} has length {norms[row]:.3f}, not 1")
    order = np.unique(stamps[::-1, 0], return_index=True)[1]
    keep = len(stamps) - 1 - order
    poses = pose_from_quaternion(values[keep, :3], values[keep, 3:])
    return Trajectory(stamps[keep, 0], poses)


def text_rows(path: Path | str) -> list[list[str]]:
    """Return the words of each line except comments, separated by blanks or commas.

    Raises
    ------
    LogError
        If the file is missing or not text.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: cannot be read ({one_line(error)})") from None
    rows = [line.replace(",", " ").split() for line in text.splitlines()]
    return [row for row in rows if row and not row[0].startswith("#")]


def number_columns(
    path: Path | str, *, stamps: int, numbers: int, first: int = 0, per_second: int = 1
) -> tuple[Int64, Float64]:
    """Read the columns of a text file: stamps first, then numbers.

    Parameters
    ----------
    path
        The file.
    stamps
        Number of stamp columns.
    numbers
        Number of columns with numbers after the stamps.
    first
        Number of columns before the stamps, which are skipped.
    per_second
        Unit of the stamps: 1 for s, 1000 for ms.

    Returns
    -------
    stamps
        int64 (N, stamps), ns.
    numbers
        float64 (N, numbers).

    Raises
    ------
    LogError
        If the file is missing, or a row cannot be parsed.
    """
    times, values = [], []
    for k, row in enumerate(text_rows(path)):
        row = row[first:]
        try:
            times.append([nanoseconds(x, per_second) for x in row[:stamps]])
            values.append([float(x) for x in row[stamps : stamps + numbers]])
        except LogError as error:
            raise LogError(f"{path}: row {k}: {error}") from None
        except (ValueError, InvalidOperation):
            raise LogError(
                f"{path}: row {k} is not made of numbers; expected a trajectory (TUM), relations "
                "or a reference"
            ) from None
        is_whole = len(times[-1]) + len(values[-1]) == stamps + numbers
        if not is_whole or not all(map(math.isfinite, values[-1])):
            raise LogError(f"{path}: row {k} needs {stamps + numbers} finite numbers")
    return np.array(times, np.int64).reshape(-1, stamps), np.array(values).reshape(-1, numbers)


def nanoseconds(text: str, per_second: int = 1) -> int:
    """Return a time in s, or another unit, as integer nanoseconds, exactly.

    Raises
    ------
    ValueError, InvalidOperation
        If the text is not a finite number.
    LogError
        If it is too large for a stamp.
    """
    number = Decimal(text) / per_second
    if not number.is_finite():
        raise ValueError(text)
    if abs(number) > MAX_STAMP_S:
        raise LogError(f"stamp {text[:40]} is no time in s")
    return int((number * 1_000_000_000).to_integral_value())
