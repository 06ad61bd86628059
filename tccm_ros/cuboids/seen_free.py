"""What the cycles of the window saw through, to be asked point by point."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.cuboids.part import cell_keys
from tccm_ros.geometry import inverse, transform
from tccm_ros.records import ViewIntervals

__all__ = ["NEVER", "SeenFree"]

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

NEVER = -1
"""Stamp of what was never seen."""


class SeenFree:
    """What the cycles of the window saw through.

    Parameters
    ----------
    config
        `map.window_cycles` and `views.cell_size`.
    """

    def __init__(self, config: Config) -> None:
        self._window = config.map.window_cycles
        self._cell = config.views.cell_size
        self._views: deque[tuple[int, Float64, Int64, NDArray[np.float32]]] = deque()
        self._stamps: deque[int] = deque()

    def add(self, cycle: int, T_odom_base: Float64, view: ViewIntervals) -> None:
        """Take what a cycle saw through, and forget what leaves the window."""
        rows = view.intervals
        columns = np.floor(rows[:, :2].astype(np.float64) / self._cell + 1e-6).astype(np.int64)
        keys = cell_keys(columns[:, 0], columns[:, 1])
        order = np.lexsort((rows[:, 2], keys))
        self._views.append((cycle, inverse(T_odom_base), keys[order], rows[order]))
        self._stamps.append(view.stamp_ns)
        while self._views[0][0] <= cycle - self._window:
            self._views.popleft()
            self._stamps.popleft()

    def clear(self) -> None:
        """Forget everything."""
        self._views.clear()
        self._stamps.clear()

    def last_seen(self, points: Float64) -> Int64:
        """Return when points (N, 3) were last seen to be free, int64 (N,), ns, or NEVER."""
        seen = np.full(len(points), NEVER, np.int64)
        for (_, T_base_odom, keys, rows), stamp_ns in zip(self._views, self._stamps, strict=True):
            local = transform(T_base_odom, points)
            column = np.floor(local[:, :2] / self._cell).astype(np.int64)
            wanted = cell_keys(column[:, 0], column[:, 1])
            at, end = (np.searchsorted(keys, wanted, side) for side in ("left", "right"))
            while (at < end).any():
                row = rows[np.minimum(at, max(len(rows) - 1, 0))]
                inside = (at < end) & (row[:, 2] <= local[:, 2]) & (local[:, 2] <= row[:, 3])
                seen[inside] = stamp_ns
                at = at + 1
        return seen
