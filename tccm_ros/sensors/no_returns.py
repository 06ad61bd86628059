"""Learn the range by which a laser's driver encodes "no return", wherever it is below range_max.

Drivers write a constant where nothing is seen: 30.0 with a range_max of 100, 4.095, 65.533. Equal
ranges over a wide angle are an arc about the laser, which no flat surface is: a wall bows in range.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tccm_ros.arrays import Bool, Float32
from tccm_ros.records import Scan
from tccm_ros.records.building import NO_RETURN_SHELL, NO_RETURN_SHELL_M

STEPS_OF_RESOLUTION = 2.0
"""Minimum bow of a flat surface, in resolutions of the ranges, for which its ranges differ: rounded
ranges deviate by up to one resolution."""

MAX_VALUES = 4
"""Maximum number of learned ranges. Chosen: drivers know few states of a beam without a return."""


class NoReturns:
    """Marks the beams of one laser whose range encodes "no return".

    A range is learned from the first scan in which it fills an arc; from then on every beam with
    this range is marked, also where only a few lie side by side.
    """

    def __init__(self) -> None:
        self._values: set[float] = set()

    def __call__(self, scan: Scan) -> tuple[Scan, str | None]:
        """Return a scan with nan for such ranges, and a remark; None for the scan as it was.

        They are no +inf: up to which range such a beam is free is unknown.
        """
        ranges = scan.ranges
        if len(self._values) < MAX_VALUES:
            value = arc_range(scan)
            if value is not None:
                self._values.add(value)
        found = [value for value in sorted(self._values) if (ranges == np.float32(value)).any()]
        if not found:
            return scan, None
        cleaned = ranges.copy()
        cleaned[np.isin(ranges, np.array(found, np.float32))] = np.nan
        cleaned.flags.writeable = False
        names = " and ".join(f"{value:.6g} m" for value in found)
        return replace(scan, ranges=cleaned), f"ranges of {names} fill arcs: taken as no return"


def arc_range(scan: Scan) -> float | None:
    """Return the range, m, of the longest run of equal ranges if it is an arc; None if it is not.

    A flat surface perpendicular to the middle of a run over an angle a bows by
    ``r (1 / cos(a / 2) - 1)``. A run is an arc where that exceeds the resolution of the ranges: the
    smallest step between the scan's ranges, and what `NO_RETURN_SHELL` allows for. A scan of one
    range alone does not show its resolution.
    """
    ranges = scan.ranges
    is_range = (ranges > max(scan.range_min, 0.0)) & (ranges <= scan.range_max)
    first, count = longest_run(ranges, is_range & np.isfinite(ranges))
    if not count:
        return None
    value = float(ranges[first])
    half = 0.5 * abs(scan.angle_increment) * (count - 1)
    bow = value * (1.0 / math.cos(half) - 1.0) if half < 0.5 * math.pi else math.inf
    if bow <= max(NO_RETURN_SHELL * value, NO_RETURN_SHELL_M):
        return None
    levels = np.unique(ranges[np.isfinite(ranges)])
    if len(levels) < 2:
        return None
    step = float(np.diff(levels).min())
    return value if bow > STEPS_OF_RESOLUTION * step else None


def longest_run(ranges: Float32, chosen: Bool) -> tuple[int, int]:
    """Return first index and length of the longest run of equal chosen ranges; (0, 0) for none."""
    equal = (ranges[1:] == ranges[:-1]) & chosen[1:]
    if not equal.any():
        return 0, 0
    edges = np.flatnonzero(np.diff(np.concatenate(([False], equal, [False])).view(np.int8)))
    starts, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - starts))
    return int(starts[longest]), int(ends[longest] - starts[longest]) + 1
