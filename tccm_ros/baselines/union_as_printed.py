"""Cuboids by Eq. (1) as printed in the paper, point by point: `map.mode: paper`.

A rule of `PartMapBuilder` that replaces the union of intervals. As printed, the equation
over-extends a cuboid that has grown, and the result depends on the order of the points.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tccm_ros.cuboids.union import CuboidRule
from tccm_ros.kernels import kernel


@kernel
def merge_as_printed(
    points: Any, n: Any, begins: Any, cell_keys: Any, n_cells: Any, found: Any
) -> Any:
    """Grow the cuboids of each cell by Eq. (1) as printed, point by point in their order.

    A point between a cuboid's top u and d0 below its bottom extends it by u - z, even if it was
    inside. A point above the top, within the cuboid's own depth d of it, raises the top. Cuboids
    that then overlap are merged (section III.A).

    Parameters
    ----------
    points
        int64 (2 n,), as in `union.merge_intervals`, but with a cell's points in their order of
        arrival. They are reordered so that the points of a cuboid are adjacent.
    n, begins, cell_keys, n_cells, found
        As in `union.merge_intervals`.

    Returns
    -------
    int
        Row of the first cuboid; the rows before it are not used.
    """
    keys, bounds, firsts = found
    grown = np.empty((n, 2), np.int64)
    k, last = np.int64(n), np.int64(n)
    for cell in range(n_cells - 1, -1, -1):
        first = last - 1
        while begins[first] == 0:
            first -= 1
        n_grown = 0
        for i in range(first, last):
            n_grown = _grow(grown, n_grown, points[2 * i] >> 32, points[2 * i + 1] >> 32)
        n_grown = _merge_overlaps(grown, n_grown)
        begins[first:last] = 0
        end = last
        for j in range(n_grown):  # from the top down, into the end of the remaining rows
            bottom, top = grown[j, 0], grown[j, 1]
            end = _take_inside(points, first, end, bottom, top)
            k -= 1
            keys[k] = cell_keys[cell]
            bounds[2 * k], bounds[2 * k + 1] = bottom, top
            firsts[k], begins[end] = end, -1
        last = first
    return k


AS_PRINTED = CuboidRule(merge_as_printed, is_by_height=False)
"""Eq. (1) as printed, in the order of arrival of the points."""


@kernel
def _grow(grown: Any, n: Any, z: Any, d0: Any) -> Any:
    """Add a point to the first of n cuboids (bottom, top) that Eq. (1) lets it extend.

    If there is none, begin a new cuboid. Return the number of cuboids.
    """
    for j in range(n):
        bottom, top = grown[j, 0], grown[j, 1]
        if bottom - d0 <= z <= top:
            grown[j, 0] = bottom - (top - z)
            return n
        if top < z <= top + (top - bottom):
            grown[j, 1] = z
            return n
    grown[n, 0], grown[n, 1] = z - d0, z
    return n + 1


@kernel
def _merge_overlaps(intervals: Any, n: Any) -> Any:
    """Sort n intervals (bottom, top) by falling top, merge touching ones; return their number."""
    for i in range(1, n):
        bottom, top, j = intervals[i, 0], intervals[i, 1], i
        while j > 0 and intervals[j - 1, 1] < top:
            intervals[j, 0], intervals[j, 1] = intervals[j - 1, 0], intervals[j - 1, 1]
            j -= 1
        intervals[j, 0], intervals[j, 1] = bottom, top
    m = 0
    for i in range(1, n):
        if intervals[i, 1] >= intervals[m, 0]:
            intervals[m, 0] = min(intervals[m, 0], intervals[i, 0])
        else:
            m += 1
            intervals[m, 0], intervals[m, 1] = intervals[i, 0], intervals[i, 1]
    return m + 1


@kernel
def _take_inside(points: Any, first: Any, end: Any, bottom: Any, top: Any) -> Any:
    """Move the points within [bottom, top] to the end of [first, end); return their first row."""
    begin = end
    for i in range(end - 1, first - 1, -1):
        if bottom <= points[2 * i] >> 32 <= top:
            begin -= 1
            for c in range(2):
                a, b = 2 * begin + c, 2 * i + c
                points[a], points[b] = points[b], points[a]
    return begin
