"""Cycles without a tilting laser: closed after a period, or when the base has moved."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.cuboids.tilt_cycle import CycleEnd, Span
from tccm_ros.records import START_OF_TIME

MAX_DISTANCE = 0.2
"""Maximum translation of the base within a cycle, m; limits the drift of odometry in a part map."""

MAX_ROTATION = float(np.deg2rad(10.0))
"""Maximum rotation of the base within a cycle, rad; limits the drift of odometry in a part map."""


class TimedCycles:
    """Divides time into cycles at the records themselves, in stamp order.

    Parameters
    ----------
    config
        Parameter `cycle.period`.
    numbers
        Iterator of cycle numbers.

    Attributes
    ----------
    closed
        Closed spans in order of time; the reader removes them.
    """

    is_moving = True
    """Every measurement belongs to a cycle."""

    def __init__(self, config: Config, numbers: Iterator[int]) -> None:
        self._limits = config.cycle
        self._numbers = numbers
        self.closed: deque[Span] = deque()
        self._start_ns: int | None = None
        self._T_odom_base: Float64 = np.eye(4)

    def clear(self) -> None:
        """Discard the open cycle, after a jump of the clock; cycle numbers continue."""
        self.closed.clear()
        self._start_ns = None

    def advance_to(self, start_ns: int, T_odom_base: Float64) -> None:
        """Note the next record: its time, and the pose of the base (4, 4)."""
        if self._start_ns is not None:
            period_ns = self._period_ns()
            if start_ns >= self._start_ns + period_ns:
                self._close(self._start_ns + period_ns, CycleEnd.TIME)
            elif _has_moved(self._T_odom_base, T_odom_base):
                self._close(start_ns, CycleEnd.MOTION)
        if self._start_ns is None:
            self._start_ns, self._T_odom_base = start_ns, T_odom_base

    def is_certain(self, record: Any) -> bool:
        """Return True: a record belongs to the cycle of its first measurement."""
        return True

    def advance(self, now_ns: int) -> None:
        """Close the open cycle if no further record can belong to it."""
        if self._start_ns is not None and now_ns > self._start_ns + self._period_ns():
            self._close(self._start_ns + self._period_ns(), CycleEnd.TIME)

    def finish(self) -> None:
        """Close the open cycle at the end of the input."""
        if self._start_ns is not None:
            self._close(self._start_ns + self._period_ns(), CycleEnd.END)

    def _period_ns(self) -> int:
        return round(self._limits.period * 1e9)

    def _close(self, end_ns: int, reason: CycleEnd) -> None:
        start_ns = START_OF_TIME if self._start_ns is None else self._start_ns
        self.closed.append(Span(start_ns, end_ns, next(self._numbers), reason))
        self._start_ns = None


def _has_moved(a: Float64, b: Float64) -> bool:
    """Return whether the motion between two poses (4, 4) exceeds that of a cycle."""
    cosine = 0.5 * (np.trace(a[:3, :3].T @ b[:3, :3]) - 1.0)
    rotation = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return float(np.linalg.norm(b[:3, 3] - a[:3, 3])) > MAX_DISTANCE or rotation > MAX_ROTATION
