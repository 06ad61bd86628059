"""Kernels of the integration map: merge part maps to pieces, and pieces to cuboids.

A piece is a row (bottom, top, cycle, index): an interval of cuboid `index` of the part map `cycle`
that newer part maps do not cover. Pieces are sorted by (cell, bottom) and do not overlap within a
cell.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import carray

from tccm_ros.cuboids.intrinsics import lowest_bit, pointer_to
from tccm_ros.kernels import kernel

_HALF = 2**31
_U0, _U1, _U2, _U3, _U4 = (np.uint64(i) for i in range(5))
_ANY = 2**40
"""Length of arrays that are given by their address only."""

_NO_MOMENTS = (0.0,) * 10
"""Count, sums, and sums of products, of no points."""

_LAST = 2**62
"""Larger than any cell key or height."""


@kernel
def merge_part(older: Any, n_older: Any, part: Any, cycle: Any, oldest: Any, out: Any) -> Any:
    """Merge the newest part map with the pieces of older ones in a single pass.

    Overlaps belong to the newest part map: older pieces are shortened (at the top, at the bottom),
    divided in two, or removed.

    Parameters
    ----------
    older, n_older
        int64 (>= n_older,) cells and int32 (>= n_older, 4) pieces, sorted.
    part
        int64 (N,) and int32 (N, 2): the newest part map's cells and intervals, sorted, not
        touching within a cell.
    cycle
        Number of the newest part map; negative to remove only (voids).
    oldest
        Oldest cycle to keep; pieces of older cycles are removed.
    out
        As `older`, written: the pieces; room for ``n_older + 2 N + 1`` rows.

    Returns
    -------
    int
        Number of pieces written.
    """
    old_keys, keys, out_keys = older[0], part[0], out[0]
    # Flat rows of constant length, and unsigned indices, for the compiler.
    rows, new_rows, out_rows = older[1].reshape(-1), part[1].reshape(-1), out[1].reshape(-1)
    n: Any = _U0
    j: Any = _U0
    cell, cover = np.int64(_LAST), np.int64(0)
    # The next newer interval: cell, bottom and top.
    key, low, high = _next(keys, new_rows, j)
    for i in range(np.uint64(n_older)):
        here = old_keys[i]
        if here != cell:
            while key < here:
                n = _write_newer(out_keys, out_rows, n, (key, low, high), cycle, j)
                j += _U1
                key, low, high = _next(keys, new_rows, j)
            cell, cover = here, np.int64(-_LAST)
        row = _U4 * i
        bottom, top = max(np.int64(rows[row]), cover), np.int64(rows[row + _U1])
        c, index = rows[row + _U2], rows[row + _U3]
        end = min(top, low) if key == here else top
        n = _write_older(out_keys, out_rows, n, (here, bottom, end), c, index, oldest)
        while key == here and low < top:
            n = _write_newer(out_keys, out_rows, n, (key, low, high), cycle, j)
            cover = high
            j += _U1
            key, low, high = _next(keys, new_rows, j)
            bottom = max(bottom, cover)
            end = min(top, low) if key == here else top
            n = _write_older(out_keys, out_rows, n, (here, bottom, end), c, index, oldest)
    while j < np.uint64(len(keys)):
        n = _write_newer(out_keys, out_rows, n, (key, low, high), cycle, j)
        j += _U1
        key, low, high = _next(keys, new_rows, j)
    return np.int64(n)


@kernel(inline="always")
def _write_newer(keys: Any, rows: Any, n: Any, span: Any, cycle: Any, index: Any) -> Any:
    """Write interval `index` of the newest part map as piece n, unless it only removes."""
    _write(keys, rows, n, span, cycle, index)
    return n + np.uint64(cycle >= 0)


@kernel(inline="always")
def _write_older(
    keys: Any, rows: Any, n: Any, span: Any, cycle: Any, index: Any, oldest: Any
) -> Any:
    """Write the rest of an older piece as piece n, unless it is empty or too old.

    It is always written, but counted only if wanted, which is faster than a branch.
    """
    _write(keys, rows, n, span, cycle, index)
    return n + np.uint64((cycle >= oldest) & (span[2] > span[1]))


@kernel(inline="always")
def _write(keys: Any, rows: Any, n: Any, span: Any, cycle: Any, index: Any) -> None:
    """Write piece n: its cell, bottom and top, and its cuboid."""
    keys[n], row = span[0], _U4 * n
    rows[row], rows[row + _U1] = span[1], span[2]
    rows[row + _U2], rows[row + _U3] = cycle, index


@kernel(inline="always")
def _next(keys: Any, rows: Any, j: Any) -> Any:
    """Return cell, bottom and top of interval j; `_LAST` after the last."""
    if j < np.uint64(len(keys)):
        row = _U2 * j
        return keys[j], np.int64(rows[row]), np.int64(rows[row + _U1])
    return np.int64(_LAST), np.int64(_LAST), np.int64(_LAST)


@kernel
def count_composites(keys: Any, pieces: Any, n: Any) -> Any:
    """Return the number of composite cuboids: runs of touching pieces of one cell.

    Parameters
    ----------
    keys, pieces, n
        int64 (>= n,) cells and int32 (>= n, 4) pieces, sorted.
    """
    count = 0
    for i in range(n):
        if i == 0 or keys[i] != keys[i - 1] or pieces[i, 0] != pieces[i - 1, 1]:
            count += 1
    return count


@kernel
def write_composites(keys: Any, pieces: Any, n: Any, cells: Any, spans: Any) -> Any:
    """Write cell and interval of each composite cuboid.

    Parameters
    ----------
    keys, pieces, n
        As in `count_composites`.
    cells, spans
        int64 (>= C,) and int32 (>= C, 2), written: cells, and bottoms and tops, ticks.

    Returns
    -------
    int
        Number of composite cuboids, C.
    """
    k = 0
    for i in range(n):
        if i == 0 or keys[i] != keys[i - 1] or pieces[i, 0] != pieces[i - 1, 1]:
            cells[k], spans[k, 0] = keys[i], pieces[i, 0]
            k += 1
        spans[k - 1, 1] = pieces[i, 1]
    return k


@kernel
def compose_cuboids(
    keys: Any, pieces: Any, n: Any, part_cuboids: Any, found: Any, cycles: Any, offsets: Any
) -> Any:
    """Join touching pieces to composite cuboids and add up their weighted moments.

    The weight of a piece is its length over that of its part map's cuboid. Moments are added from
    the lowest piece to the highest, so that equal pieces give equal sums, bit for bit.

    Parameters
    ----------
    keys, pieces, n
        The pieces.
    part_cuboids
        Addresses of the part maps' cuboids (`PartAddresses`), and the cycle of the first row.
    found
        int32 (2, C) twice, written: ix and iy, bottom and top; float64 (C,), (C, 3), (C, 6),
        written: counts and moments.
    cycles, offsets
        Written: ordered cycles of each composite, int32 (n,), and their start positions, int64.

    Returns
    -------
    int
        Number of entries in `cycles`.
    """
    addresses, first_cycle = part_cuboids
    cells, spans, count, s, S = found
    k, used, begin = -1, 0, 0
    # A window of up to 64 cycles fits in a word of bits: no sorting, no mispredicted branches.
    narrow, seen, sums = len(addresses) <= 64, np.uint64(0), _NO_MOMENTS
    for i in range(n + 1):
        if i == n or i == 0 or keys[i] != keys[i - 1] or pieces[i, 0] != pieces[i - 1, 1]:
            if k >= 0:
                spans[1, k] = pieces[i - 1, 1]
                _write_moments(count, s, S, k, sums)
            while seen != _U0:
                cycles[used] = first_cycle + lowest_bit(seen)
                seen &= seen - _U1
                used += 1
            k += 1
            offsets[k] = begin = used
            if i == n:
                break
            ix = (keys[i] + _HALF) >> 32
            cells[0, k], cells[1, k] = ix, keys[i] - (ix << 32)
            spans[0, k] = pieces[i, 0]
            sums = _NO_MOMENTS
        cycle = pieces[i, 2]
        sums = _add_moments(sums, addresses[np.uint64(cycle - first_cycle)], pieces[i])
        if narrow:
            seen |= _U1 << np.uint64(cycle - first_cycle)
        else:
            used = _insert_cycle(cycles, begin, used, cycle)
    return used


@kernel(inline="always")
def _add_moments(sums: Any, addresses: Any, piece: Any) -> Any:
    """Return sums of moments plus those of a piece, weighted by its fraction of the cuboid."""
    moments = carray(pointer_to(addresses[0]), (_ANY,), np.int64)
    bounds = carray(pointer_to(addresses[1]), (_ANY,), np.int32)
    at, index = 2 * np.int64(piece[3]), 10 * np.int64(piece[3])
    length = bounds[np.uint64(at + 1)] - bounds[np.uint64(at)]
    weight = np.float64(piece[1] - piece[0]) / np.float64(length)
    a0, a1, a2, a3, a4, a5, a6, a7, a8, a9 = sums
    return (
        a0 + weight * moments[np.uint64(index + 0)],
        a1 + weight * moments[np.uint64(index + 1)],
        a2 + weight * moments[np.uint64(index + 2)],
        a3 + weight * moments[np.uint64(index + 3)],
        a4 + weight * moments[np.uint64(index + 4)],
        a5 + weight * moments[np.uint64(index + 5)],
        a6 + weight * moments[np.uint64(index + 6)],
        a7 + weight * moments[np.uint64(index + 7)],
        a8 + weight * moments[np.uint64(index + 8)],
        a9 + weight * moments[np.uint64(index + 9)],
    )


@kernel(inline="always")
def _write_moments(count: Any, s: Any, S: Any, k: Any, sums: Any) -> None:
    """Write the sums of the moments of composite k."""
    count[k], s[k, 0], s[k, 1], s[k, 2] = sums[0], sums[1], sums[2], sums[3]
    S[k, 0], S[k, 1], S[k, 2] = sums[4], sums[5], sums[6]
    S[k, 3], S[k, 4], S[k, 5] = sums[7], sums[8], sums[9]


@kernel
def _insert_cycle(cycles: Any, begin: Any, end: Any, cycle: Any) -> Any:
    """Insert a cycle into the sorted cycles[begin:end] unless present; return the new end."""
    j = end
    while j > begin and cycles[j - 1] > cycle:
        j -= 1
    if j > begin and cycles[j - 1] == cycle:
        return end
    for m in range(end, j, -1):
        cycles[m] = cycles[m - 1]
    cycles[j] = cycle
    return end + 1


@kernel
def owners(ix: Any, iy: Any, bottom: Any, keys: Any, bounds: Any) -> Any:
    """Return the map's cuboid that contains each cuboid of one of its part maps, in one pass.

    Parameters
    ----------
    ix, iy, bottom
        int32 (N,), of the map, N > 0, sorted.
    keys, bounds
        int64 (M,) and int32 (M, 2), of the part map, sorted.

    Returns
    -------
    int64 (M,): the highest cuboid of the same cell that does not begin above it.
    """
    owner = np.empty(len(keys), np.int64)
    i, n = 0, len(ix)
    for j in range(len(keys)):
        x = (keys[j] + _HALF) >> 32
        y = keys[j] - (x << 32)
        while i + 1 < n and (
            ix[i] < x
            or (ix[i] == x and iy[i] < y)
            or (ix[i + 1] == x and iy[i + 1] == y and bottom[i + 1] <= bounds[j, 0])
        ):
            i += 1
        owner[j] = i
    return owner
