"""Union of intervals in each cell: from binned points to the cuboids of a part map.

A point at height z with depth d covers [z - d, z]; a cuboid is a connected component of the union
of its cell's intervals (touching intervals are connected). Moments are integers in ticks, so that
the result is exact and independent of the order of the points.

Points are sorted by cell with known counts, then each cell by height: by insertion where it has few
points, as from a laser, and by a radix sort where it has many, as from depth images. A downward
pass finds the cuboids, an upward pass sums their moments. With a laser, most cuboids have one to
three points, and their ends are unpredictable; the downward pass therefore uses masks instead of
branches. Arrays are flat, so that row lengths are compile-time constants. Points of 22,760 beams
become cuboids with moments in 0.29 ms; numpy's lexsort and reduceat take 3.3 to 5.4 ms, and a
linked list per cell 1.1 ms (`bench/bench_tccm.py` measures it, and each step).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from tccm_ros.kernels import kernel

_DIGIT_BITS = 8
"""Bits of a digit of the radix sort: the ends of 256 runs of points fit in the first-level
cache."""

DIGITS = 1 << _DIGIT_BITS
"""Number of elements of `histogram`."""

FEW = 32
"""Points of a cell that are sorted by insertion. Chosen: with fewer, the counts of a digit take
longer than the points."""

_LOW = np.int64(0xFFFFFFFF)
_U0, _U1, _U2, _U10, _U32 = (np.uint64(k) for k in (0, 1, 2, 10, 32))


class CuboidRule(NamedTuple):
    """Rule that turns the points of a cell into cuboids.

    Attributes
    ----------
    merge
        Kernel from ordered points to cuboids; arguments and result as in `merge_intervals`.
    is_by_height
        Whether it needs the points of a cell by ascending height, or in order of arrival.
    """

    merge: Callable[..., int]
    is_by_height: bool


@kernel
def sort_cells(points: Any, starts: Any, n_cells: Any, scratch: Any) -> None:
    """Sort the points of each cell by ascending height; stable.

    Parameters
    ----------
    points
        int64 (2 n,) from `gather_points`; sorted in place.
    starts, n_cells
        int32, start position of each cell and, last, the number of points.
    scratch
        uint64 (>= n,) twice, and int64 (DIGITS,).
    """
    room = np.int64(0)
    for cell in range(n_cells):
        room = np.int64(max(room, starts[cell + 1] - starts[cell]))
    rows = np.empty(2 * room, np.int64)
    for cell in range(n_cells):
        first, n = np.uint64(starts[cell]), np.uint64(starts[cell + 1] - starts[cell])
        if n <= FEW:
            _insert_each(points, first, n)
            continue
        order = _order_cell(points, first, n, scratch)
        rows[: 2 * n] = points[_U2 * first : _U2 * (first + n)]
        for i in range(n):
            j = order[i] & np.uint64(_LOW)
            points[_U2 * (first + i)] = rows[_U2 * j]
            points[_U2 * (first + i) + _U1] = rows[_U2 * j + _U1]


@kernel
def _insert_each(points: Any, first: Any, n: Any) -> None:
    """Sort the n points from `first` on by ascending height; stable."""
    for i in range(first + _U1, first + n):
        one, other = points[_U2 * i], points[_U2 * i + _U1]
        j: Any = i
        while j > first and points[_U2 * (j - _U1)] >> 32 > one >> 32:
            points[_U2 * j] = points[_U2 * (j - _U1)]
            points[_U2 * j + _U1] = points[_U2 * (j - _U1) + _U1]
            j -= _U1
        points[_U2 * j], points[_U2 * j + _U1] = one, other


@kernel
def _order_cell(points: Any, first: Any, n: Any, scratch: Any) -> Any:
    """Return the points of a cell by ascending height, as uint64 with the index in the low bits."""
    pairs, spare, histogram = scratch
    lowest = highest = points[_U2 * first] >> 32
    for i in range(n):
        z = points[_U2 * (first + i)] >> 32
        lowest, highest = min(lowest, z), max(highest, z)
    for i in range(n):
        height = np.uint64((points[_U2 * (first + i)] >> 32) - lowest)
        pairs[i] = (height << _U32) | i
    shift = _U32
    while (highest - lowest) >> np.int64(shift - _U32):
        histogram[:] = 0
        for i in range(n):
            histogram[(pairs[i] >> shift) & np.uint64(DIGITS - 1)] += 1
        position = np.int64(0)
        for b in range(DIGITS):
            count = histogram[b]
            histogram[b] = position
            position += count
        for i in range(n):
            b = (pairs[i] >> shift) & np.uint64(DIGITS - 1)
            spare[np.uint64(histogram[b])] = pairs[i]
            histogram[b] += 1
        pairs, spare = spare, pairs
        shift += np.uint64(_DIGIT_BITS)
    return pairs


@kernel
def gather_points(records: Any, scan_ends: Any, counts: Any, points: Any) -> None:
    """Sort the records by cell, in order of arrival.

    Parameters
    ----------
    records
        int64 (>= 2 n,), two words per point, see `tiles.Tiles`.
    scan_ends
        int32 (S,), number of records up to the end of each scan.
    counts
        int32, next free position per address; afterwards one past the last.
    points
        int64 (2 n,), written: (z << 32 | place) and (depth << 32 | number of the scan).
    """
    i = np.uint64(0)
    for scan in range(len(scan_ends)):
        end = np.uint64(scan_ends[scan])
        for j in range(i, end):
            word = records[_U2 * j + _U1]
            address = np.uint64(word & _LOW)
            position = np.uint64(counts[address])
            counts[address] += 1
            points[_U2 * position] = records[_U2 * j]
            points[_U2 * position + _U1] = (word & ~_LOW) | scan
        i = end


@kernel
def mark_cells(starts: Any, n_cells: Any, addresses: Any, counts: Any, begins: Any) -> None:
    """Mark the first point of each cell, and the end of the last; reset the counts to zero.

    Parameters
    ----------
    starts, n_cells, addresses
        Results of `binning.list_cells`.
    counts
        int32, per address, reset.
    begins
        int8 (n + 1,), written: -1 where a cell begins and at n, else 0.
    """
    begins[: np.int64(starts[n_cells]) + 1] = 0
    for cell in range(np.uint64(n_cells)):
        begins[np.uint64(starts[cell])] = -1
        counts[np.uint64(addresses[cell])] = 0
    begins[np.uint64(starts[n_cells])] = -1


@kernel
def merge_intervals(
    points: Any, n: Any, begins: Any, cell_keys: Any, n_cells: Any, found: Any
) -> Any:
    """Merge the intervals of each cell, from the last point to the first.

    Cuboids are written from the end of the arrays, so that they are in ascending order.

    Parameters
    ----------
    points, n
        int64 (2 n,) from `sort_cells`, by cell and ascending height.
    begins
        int8 (n + 1,), -1 where a cell begins, and at n; afterwards where a cuboid begins.
    cell_keys, n_cells
        int64 (>= n_cells,), the cells in order.
    found
        int64 (>= n,), int32 (>= 2 n,) and int32 (>= n,), written: cell, bottom and top, and first
        point of each cuboid, in the rows up to n.

    Returns
    -------
    int
        Row of the first cuboid; the rows before it are unused.
    """
    keys, bounds, firsts = found
    k, cell = np.int64(n), np.int64(n_cells)
    lowest = top = np.int64(0)
    for j in range(np.uint64(n)):
        i = np.uint64(n) - _U1 - j
        z = points[_U2 * i] >> 32
        bottom = z - (points[_U2 * i + _U1] >> 32)
        # Masks: -1 for true, 0 for false. A point is the top of a new cuboid if the point above is
        # in another cell, or if the interval above ends above this point.
        left = np.int64(begins[i + _U1])
        is_new = left | ((z - lowest) >> 63)
        begins[i + _U1] = is_new
        k += is_new
        cell += left
        top ^= (top ^ z) & is_new
        lower = bottom - lowest
        lowest += lower & ((lower >> 63) | is_new)
        u = np.uint64(k)
        keys[u] = cell_keys[np.uint64(cell)]
        bounds[_U2 * u], bounds[_U2 * u + _U1] = lowest, top
        firsts[u] = i
    begins[np.uint64(0)] = -1
    return k


UNION = CuboidRule(merge_intervals, is_by_height=True)
"""The union of the points' intervals, independent of their order."""


@kernel
def sum_cuboids(points: Any, n: Any, begins: Any, stamps: Any, sums: Any, seen: Any) -> None:
    """Sum the moments of each cuboid; find the first and the last scan that measured it.

    Parameters
    ----------
    points, n
        int64 (2 n,) from `gather_points`; the points of a cuboid are contiguous.
    begins
        int8 (>= n,), -1 where a cuboid begins.
    stamps
        int64 (S,), stamps of the scans.
    sums
        int64 (10 C,), written: count, sums x y z, sums of xx xy xz yy yz zz.
    seen
        int64 (2 C,), written: the stamps of the first and the last scan.
    """
    m = s = first = _U0
    while first < np.uint64(n):
        end = first + _U1
        while end < np.uint64(n) and begins[end] == 0:
            end += _U1
        sx = sy = sz = xx = xy = xz = yy = yz = zz = np.int64(0)
        low, high = _LOW, np.int64(0)
        for i in range(first, end):
            word, scan = points[_U2 * i], points[_U2 * i + _U1] & _LOW
            x, y, z = (word >> 16) & 0xFFFF, word & 0xFFFF, word >> 32
            sx, sy, sz = sx + x, sy + y, sz + z
            xx, xy, xz = xx + x * x, xy + x * y, xz + x * z
            yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
            low, high = min(low, scan), max(high, scan)
        sums[m] = np.int64(end - first)
        sums[m + np.uint64(1)], sums[m + np.uint64(2)], sums[m + np.uint64(3)] = sx, sy, sz
        sums[m + np.uint64(4)], sums[m + np.uint64(5)], sums[m + np.uint64(6)] = xx, xy, xz
        sums[m + np.uint64(7)], sums[m + np.uint64(8)], sums[m + np.uint64(9)] = yy, yz, zz
        seen[s], seen[s + _U1] = stamps[np.uint64(low)], stamps[np.uint64(high)]
        m, s, first = m + _U10, s + _U2, end
