"""Free space by column: intervals of height along beams, and point queries."""

from __future__ import annotations

from collections import deque
from copy import copy
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.config import Config
from tccm_ros.geometry import inverse, transform
from tccm_ros.records import ViewIntervals

KEY_STEP = 1 << 21
"""Factor of x in keys of columns and voxels: indices are -2^20..2^20 on both axes."""

NEVER = -1
"""Stamp of unobserved space."""


def column_keys(points: Float64, cell_size: float) -> Int64:
    """Return the column key of each point (N, >= 2), int64 (N,)."""
    cells = np.floor(points[:, :2] / cell_size).astype(np.int64)
    return cells[:, 0] * KEY_STEP + cells[:, 1]


@dataclass(frozen=True, slots=True, eq=False)
class FreeColumns:
    """Free intervals by column; column keys are sorted and may repeat.

    Attributes
    ----------
    cell_size
        Edge of a column, m.
    keys
        int64 (M,), key of the column.
    low, high
        float64 (M,), limits of the free interval, m.
    """

    cell_size: float
    keys: Int64
    low: Float64
    high: Float64

    @classmethod
    def of(cls, view: ViewIntervals | None, cell_size: float) -> FreeColumns:
        """Return the free intervals of a view sorted by column; none without a view."""
        rows = np.zeros((0, 4)) if view is None else view.intervals.astype(np.float64)
        keys = column_keys(rows, cell_size)
        order = np.lexsort((rows[:, 2], keys))
        return cls(cell_size, keys[order], rows[order, 2], rows[order, 3])

    def looked_into(self, points: Float64) -> Bool:
        """Return a mask (N,) of the points (N, 3), m, in columns with any free interval."""
        if not len(self.keys):
            return np.zeros(len(points), np.bool_)
        keys = column_keys(points, self.cell_size)
        at = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        return np.asarray(self.keys[at] == keys)

    def contains(self, points: Float64, margin: Float64 | float = 0.0) -> Bool:
        """Return whether points (N, 3) are in a free interval, margin (N,) m from its ends."""
        keys = column_keys(points, self.cell_size)
        first = np.searchsorted(self.keys, keys, "left")
        last = np.searchsorted(self.keys, keys, "right")
        inside = np.zeros(len(points), bool)
        for step in range(int((last - first).max(initial=0))):
            row = np.minimum(first + step, len(self.keys) - 1)
            hit = (points[:, 2] >= self.low[row] + margin) & (
                points[:, 2] <= self.high[row] - margin
            )
            inside |= hit & (first + step < last)
        return inside


class _CycleView(NamedTuple):
    """The free intervals of one tilt cycle, in the base frame at its stamp."""

    cycle: int
    stamp_ns: int
    T_base_odom: Float64
    free: FreeColumns


class FreeSpace:
    """The free intervals of the tilt cycles in the window.

    Parameters
    ----------
    config
        `map.window_cycles` and `views.cell_size`.
    """

    def __init__(self, config: Config) -> None:
        self._window = config.map.window_cycles
        self._cell_size = config.views.cell_size
        self._views: deque[_CycleView] = deque()

    def add(self, cycle: int, T_odom_base: Float64, view: ViewIntervals) -> None:
        """Add the free intervals of a tilt cycle, and delete those of cycles before the window.

        Parameters
        ----------
        cycle
            Number of the cycle.
        T_odom_base
            float64 (4, 4), pose of the base at the view's stamp.
        view
            The free intervals, in the base frame.
        """
        free = FreeColumns.of(view, self._cell_size)
        self._views.append(_CycleView(cycle, view.stamp_ns, inverse(T_odom_base), free))
        while self._views[0].cycle <= cycle - self._window:
            self._views.popleft()

    def clear(self) -> None:
        """Clear all free intervals."""
        self._views.clear()

    def copy(self) -> FreeSpace:
        """Return a snapshot that later tilt cycles do not change."""
        copied = copy(self)
        copied._views = self._views.copy()
        return copied

    def cycle_at(self, stamp_ns: int) -> int:
        """Return the number of the cycle whose view has a stamp, -1 for none."""
        return next((v.cycle for v in self._views if v.stamp_ns == stamp_ns), -1)

    def last_seen(self, points: Float64) -> Int64:
        """Return when points (N, 3), m, in odom, were last observed as free, int64 (N,), ns.

        `NEVER` where no beam of the window's tilt cycles passed.
        """
        seen = np.full(len(points), NEVER, np.int64)
        for view in self._views:
            seen[view.free.contains(transform(view.T_base_odom, points))] = view.stamp_ns
        return seen
