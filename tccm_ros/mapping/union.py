"""The union of intervals in each cell: from binned points to the cuboids of a part map.

A point at height z with depth d covers [z - d, z]; a cuboid is a connected component of the union
of its cell's intervals (touching counts as connected). Moments are whole ticks, so that the result
is exact and does not depend on the order of the points.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

__all__ = ["MAX_BINS", "gather_points", "unite_cells", "unite_cells_as_printed"]

MAX_BINS = 4096
"""Height bins of a tall cell that are worth clearing; beyond, its points are sorted."""

_LOW = np.int64(0xFFFFFFFF)

_FEW = 12
"""Up to this many points insertion is faster than bins, whatever their order."""


@njit(nogil=True, cache=True)
def gather_points(records: Any, n_scans: Any, scan_ends: Any, counts: Any, points: Any) -> None:
    """Order the records by cell, keeping their order within a cell.

    Parameters
    ----------
    records
        int64 (N, 2): (z << 32 | place) and (depth << 32 | address), see `binning.bin_scan`.
    n_scans, scan_ends
        Number of scans, and int32 (>= n_scans,), the number of records after each.
    counts
        int32, per address: the next free position; left as the position after the last.
    points
        int64 (N, 2), receives (z << 32 | place) and (depth << 32 | number of the scan).
    """
    i = 0
    for scan in range(n_scans):
        end = np.int64(scan_ends[scan])
        while i < end:
            u = np.uint64(i)
            word = records[u, 1]
            address = np.uint64(word & _LOW)
            position = np.uint64(counts[address])
            counts[address] += 1
            points[position, 0] = records[u, 0]
            points[position, 1] = (word & ~_LOW) | scan
            i += 1


@njit(nogil=True, cache=True, inline="always")
def _sum_points(points: Any, first: Any, last: Any, sums: Any, scans: Any, k: Any) -> None:
    """Write the ten moments of the points [first, last), and their first and last scan."""
    sx = sy = sz = xx = xy = xz = yy = yz = zz = np.int64(0)
    low = high = points[np.uint64(first), 1] & _LOW
    for i in range(np.uint64(first), np.uint64(last)):
        word, scan = points[i, 0], points[i, 1] & _LOW
        x, y, z = (word >> 16) & 0xFFFF, word & 0xFFFF, word >> 32
        sx += x
        sy += y
        sz += z
        xx += x * x
        xy += x * y
        xz += x * z
        yy += y * y
        yz += y * z
        zz += z * z
        low, high = min(low, scan), max(high, scan)
    sums[k, 0] = last - first
    sums[k, 1], sums[k, 2], sums[k, 3] = sx, sy, sz
    sums[k, 4], sums[k, 5], sums[k, 6] = xx, xy, xz
    sums[k, 7], sums[k, 8], sums[k, 9] = yy, yz, zz
    scans[k, 0], scans[k, 1] = low, high


@njit(nogil=True, cache=True)
def _sort_falling(points: Any, first: Any, last: Any) -> None:
    """Sort the points [first, last) by falling z, by shell sort (insertion when few)."""
    gap = 1
    while gap < (last - first) // 9:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(first + gap, last):
            a, b, j = points[i, 0], points[i, 1], i
            while j >= first + gap and points[j - gap, 0] < a:
                points[j, 0], points[j, 1] = points[j - gap, 0], points[j - gap, 1]
                j -= gap
            points[j, 0], points[j, 1] = a, b
        gap //= 3


@njit(nogil=True, cache=True)
def _bin_falling(
    points: Any, first: Any, last: Any, top: Any, shift: Any, n_bins: Any, bins: Any, spare: Any
) -> None:
    """Order the points [first, last) by bins of 2^shift below `top`; write the bins' ends."""
    bins[:n_bins] = 0
    for i in range(first, last):
        u, j = np.uint64(i), np.uint64(i - first)
        bins[np.uint64((top - (points[u, 0] >> 32)) >> shift)] += 1
        spare[j, 0], spare[j, 1] = points[u, 0], points[u, 1]
    position = first
    for k in range(np.uint64(n_bins)):
        count = bins[k]
        bins[k] = position
        position += count
    for i in range(np.uint64(last - first)):
        b = np.uint64((top - (spare[i, 0] >> 32)) >> shift)
        j = np.uint64(bins[b])
        points[j, 0], points[j, 1] = spare[i, 0], spare[i, 1]
        bins[b] += 1


@njit(nogil=True, cache=True)
def unite_cells(
    points: Any,
    n_cells: Any,
    starts: Any,
    addresses: Any,
    counts: Any,
    min_depth: Any,
    bins: Any,
    spare: Any,
    bounds: Any,
    moments: Any,
    scans: Any,
) -> Any:
    """Unite the intervals of each cell.

    Cells and, within a cell, cuboids are written from last to first, so that what is found from
    the top downwards comes out in rising order at the end of the arrays.

    Parameters
    ----------
    points
        int64 (N, 2) of `gather_points`; reordered within cells.
    n_cells, starts
        Number of cells and int32 (n_cells + 1,), where each begins.
    addresses, counts
        int32 (n_cells,), addresses of the cells, whose counts are set back to zero.
    min_depth
        The least depth of any point, ticks, at least 1.
    bins, spare
        Scratch, int64 (MAX_BINS,) and (N, 2).
    bounds
        int32 (N, 4), receives cell number, bottom, top and first point of each cuboid.
    moments
        int64 (N, 10), receives count, sums x y z, sums of xx xy xz yy yz zz.
    scans
        int32 (N, 2), receives the first and the last scan of each cuboid.

    Returns
    -------
    int
        Row of the first cuboid; the rows before it are not used.
    """
    shift = 0
    while 2 << shift <= min_depth:
        shift += 1
    k = len(bounds)
    for cell in range(n_cells - 1, -1, -1):
        first, last = np.int64(starts[cell]), np.int64(starts[cell + 1])
        counts[addresses[cell]] = 0
        top = low = points[first, 0] >> 32
        bottom = reach = top - (points[first, 1] >> 32)
        for i in range(np.uint64(first + 1), np.uint64(last)):
            z = points[i, 0] >> 32
            b = z - (points[i, 1] >> 32)
            # How far down the highest point reaches (the deepest of them where tops are equal).
            reach = b if z > top else (min(reach, b) if z == top else reach)
            top, low, bottom = max(top, z), min(low, z), min(bottom, b)
        if low >= reach:  # It reaches the lowest: all are connected.
            k -= 1
            bounds[k, 0], bounds[k, 1], bounds[k, 2], bounds[k, 3] = cell, bottom, top, first
            _sum_points(points, first, last, moments, scans, k)
        else:
            k = _unite_levels(
                points, first, last, cell, top, low, shift, bins, spare,
                bounds, moments, scans, k,
            )  # fmt: skip
    return k


@njit(nogil=True, cache=True)
def _unite_levels(
    points: Any,
    first: Any,
    last: Any,
    cell: Any,
    top: Any,
    low: Any,
    shift: Any,
    bins: Any,
    spare: Any,
    bounds: Any,
    moments: Any,
    scans: Any,
    k: Any,
) -> Any:
    """Unite the intervals of one cell with several levels, from the top downwards.

    Points of one bin, no wider than the least depth, are connected to each other; so a bin joins
    the cuboid above if its highest point reaches it.
    """
    n_bins = ((top - low) >> shift) + 1
    binned = last - first > _FEW and n_bins <= MAX_BINS
    if binned:
        _bin_falling(points, first, last, top, shift, n_bins, bins, spare)
    else:
        _sort_falling(points, first, last)
    start = i = first
    high = bottom = np.int64(0)
    while i < last:
        z = points[i, 0] >> 32
        d = z - (points[i, 1] >> 32)
        j = i + 1
        if binned:
            b = (top - z) >> shift
            while j < last and (top - (points[j, 0] >> 32)) >> shift == b:
                other = points[j, 0] >> 32
                z, d = max(z, other), min(d, other - (points[j, 1] >> 32))
                j += 1
        if i == first:
            high, bottom = z, d
        elif z >= bottom:
            bottom = min(bottom, d)
        else:
            k -= 1
            bounds[k, 0], bounds[k, 1], bounds[k, 2], bounds[k, 3] = cell, bottom, high, start
            _sum_points(points, start, i, moments, scans, k)
            start, high, bottom = i, z, d
        i = j
    k -= 1
    bounds[k, 0], bounds[k, 1], bounds[k, 2], bounds[k, 3] = cell, bottom, high, start
    _sum_points(points, start, last, moments, scans, k)
    return k


@njit(nogil=True, cache=True)
def unite_cells_as_printed(
    points: Any,
    n_cells: Any,
    starts: Any,
    addresses: Any,
    counts: Any,
    min_depth: Any,
    bins: Any,
    spare: Any,
    bounds: Any,
    moments: Any,
    scans: Any,
) -> Any:
    """Grow the cuboids of each cell by Eq. (1) as printed, point by point in their order.

    A point at or below a cuboid's top u and not further below its bottom than d0 extends it by
    u - z, even where it was inside; a point above the top, within the cuboid's own depth d of it,
    raises it. Cuboids that then overlap are bound (section III.A). The arguments are those of
    `unite_cells`; here `spare` holds bottom, top and number of each cuboid of a cell.
    """
    k = len(bounds)
    for cell in range(n_cells - 1, -1, -1):
        first, last = np.int64(starts[cell]), np.int64(starts[cell + 1])
        counts[addresses[cell]] = 0
        n = 0
        for i in range(first, last):
            z, d0, j = points[i, 0] >> 32, points[i, 1] >> 32, 0
            while j < n:
                bottom, top = spare[j, 0], spare[j, 1]
                if bottom - d0 <= z <= top:
                    spare[j, 0] = bottom - (top - z)
                    break
                if top < z <= top + (top - bottom):
                    spare[j, 1] = z
                    break
                j += 1
            if j == n:
                spare[n, 0], spare[n, 1] = z - d0, z
                n += 1
        n = _bind_overlaps(spare, n)
        begin = first
        for j in range(n):
            end = _take_inside(points, begin, last, spare[j, 0], spare[j, 1])
            k -= 1
            bounds[k, 0], bounds[k, 1], bounds[k, 2] = cell, spare[j, 0], spare[j, 1]
            bounds[k, 3] = begin
            _sum_points(points, begin, end, moments, scans, k)
            begin = end
    return k


@njit(nogil=True, cache=True)
def _bind_overlaps(intervals: Any, n: Any) -> Any:
    """Sort n intervals (bottom, top) by falling top and unite those that touch; return how many."""
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


@njit(nogil=True, cache=True)
def _take_inside(points: Any, begin: Any, last: Any, bottom: Any, top: Any) -> Any:
    """Move the points within [bottom, top] to the front of [begin, last); return their end."""
    end = begin
    for i in range(begin, last):
        if bottom <= points[i, 0] >> 32 <= top:
            for c in range(2):
                points[end, c], points[i, c] = points[i, c], points[end, c]
            end += 1
    return end


@njit(nogil=True, cache=True)
def finish_cuboids(
    cells: Any,
    bounds: Any,
    moments: Any,
    scans: Any,
    stamps: Any,
    keys: Any,
    spans: Any,
    sums: Any,
    seen: Any,
    firsts: Any,
) -> None:
    """Copy the found cuboids to arrays of their own size; cells become keys, scans their stamps."""
    skipped = len(bounds) - len(keys)
    for i in range(len(keys)):
        k = i + skipped
        cell = bounds[k, 0]
        keys[i] = (np.int64(cells[cell, 0]) << 32) + np.int64(cells[cell, 1])
        spans[i, 0], spans[i, 1], firsts[i] = bounds[k, 1], bounds[k, 2], bounds[k, 3]
        for c in range(10):
            sums[i, c] = moments[k, c]
        seen[i, 0], seen[i, 1] = stamps[scans[k, 0]], stamps[scans[k, 1]]
