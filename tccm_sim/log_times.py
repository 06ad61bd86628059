"""Increasing stamps from the times of a log, whose lines are in order but whose clock may jump."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol, TypeVar

import numpy as np

MIN_STEP_NS = 1_000
"""Minimum time between two stamps, ns. Chosen: message stamps have to increase."""

OUTLIER_NS = 10_000_000_000
"""A stamp this far, ns, from the median of five neighbouring stamps is a damaged line. Chosen."""

RESET_NS = 10_000_000_000
"""A step back by more than this, ns, means that the clock was reset. Chosen: logs of several hosts
step back by a second at most."""


class _Timed(Protocol):
    """A line of a log with a time."""

    @property
    def time_ns(self) -> int: ...


Line = TypeVar("Line", bound=_Timed)


def without_outliers(lines: list[Line]) -> list[Line]:
    """Drop lines whose time is far from its neighbours; each would shift hundreds of others."""
    times = np.array([line.time_ns for line in lines], np.int64)
    if len(times) < 5:
        return lines
    around = np.lib.stride_tricks.sliding_window_view(np.pad(times, 2, mode="reflect"), 5)
    near = np.abs(times - np.median(around, axis=1)) < OUTLIER_NS
    monotone = np.ones(len(times), bool)
    monotone[1:-1] = (times[:-2] <= times[1:-1]) & (times[1:-1] <= times[2:])
    return [line for line, keep in zip(lines, near | monotone) if keep]


def without_resets(times_ns: Sequence[int]) -> list[int]:
    """Return times without the backward steps of clock resets.

    Parameters
    ----------
    times_ns
        Times in the true order, ns.
    """
    if not len(times_ns):
        return []
    steps = [now - before for before, now in pairwise(times_ns)]
    usual = int(np.median([step for step in steps if step >= 0] or [0]))
    times = [times_ns[0]]
    for step in steps:
        times.append(times[-1] + (usual if step < -RESET_NS else step))
    return times


def increasing_stamps(times_ns: Sequence[int]) -> list[int]:
    """Return the increasing stamps nearest to some times by least squares.

    Pool-adjacent-violators on integers: exact, and times that already increase are unchanged.

    Parameters
    ----------
    times_ns
        Times in the true order, ns.
    """
    sums: list[int] = []
    counts: list[int] = []
    for k, time in enumerate(times_ns):
        sums.append(time - k * MIN_STEP_NS)
        counts.append(1)
        while len(sums) > 1 and sums[-2] * counts[-1] > sums[-1] * counts[-2]:
            total, count = sums.pop(), counts.pop()
            sums[-1] += total
            counts[-1] += count
    means = [total // count for total, count in zip(sums, counts) for _ in range(count)]
    return [mean + k * MIN_STEP_NS for k, mean in enumerate(means)]
