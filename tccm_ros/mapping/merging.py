"""Compiled loops of the integration map: who owns what, and what the map says where.

A piece is a row (bottom, top, cycle, index): what is left visible of cuboid `index` of the part map
`cycle`. Pieces are sorted by (cell, bottom) and do not overlap within a cell.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from tccm_ros.mapping.binning import lowest_bit

__all__ = ["compose_cuboids", "count_composites", "join_pieces", "merge_part"]

_HALF = 2**31
_NONE, _ONE = np.uint64(0), np.uint64(1)
_LAST = 2**62
"""Beyond all cells and heights."""


@njit(nogil=True, cache=True)
def merge_part(
    old_keys: Any,
    old: Any,
    n_old: Any,
    keys: Any,
    bounds: Any,
    cycle: Any,
    oldest: Any,
    out_keys: Any,
    out: Any,
) -> Any:
    """Put the newest part map over the pieces of the older ones; one pass over both.

    Where the newest covers an older piece it owns the overlap: older pieces become shorter (at
    the top, at the bottom), are divided in two, or vanish.

    Parameters
    ----------
    old_keys, old, n_old
        int64 (>= n_old,) cells and int32 (>= n_old, 4) pieces, sorted.
    keys, bounds
        int64 (N,) and int32 (N, 2): the newest part map's cells and intervals, sorted, not
        touching within a cell.
    cycle
        Number of the newest part map; negative if it only takes away (voids).
    oldest
        Pieces of older cycles than this are left out.
    out_keys, out
        Receive the pieces; room for ``n_old + 2 N + 1`` rows.

    Returns
    -------
    int
        Number of pieces written.
    """
    n: Any = 0
    j = 0
    n_new, shown = len(keys), np.int64(cycle >= 0)
    cell, cover = np.int64(_LAST), np.int64(0)
    # The next newer interval: its cell, bottom and top.
    key, low, high = _next(keys, bounds, j)
    for i in range(n_old):
        here = old_keys[i]
        if here != cell:
            while key < here:
                out_keys[n] = key
                out[n, 0], out[n, 1], out[n, 2], out[n, 3] = low, high, cycle, j
                n += shown
                j += 1
                key, low, high = _next(keys, bounds, j)
            cell, cover = here, np.int64(-_LAST)
        bottom, top = max(np.int64(old[i, 0]), cover), np.int64(old[i, 1])
        c, index = old[i, 2], old[i, 3]
        kept = np.int64(c >= oldest)
        # What is below the next newer interval is written, and counted only if it is there: that
        # is faster than to ask first.
        end = min(top, low) if key == here else top
        out_keys[n] = here
        out[n, 0], out[n, 1], out[n, 2], out[n, 3] = bottom, end, c, index
        n += kept & np.int64(end > bottom)
        while key == here and low < top:
            out_keys[n] = key
            out[n, 0], out[n, 1], out[n, 2], out[n, 3] = low, high, cycle, j
            n += shown
            cover = high
            j += 1
            key, low, high = _next(keys, bounds, j)
            bottom = max(bottom, cover)
            end = min(top, low) if key == here else top
            out_keys[n] = here
            out[n, 0], out[n, 1], out[n, 2], out[n, 3] = bottom, end, c, index
            n += kept & np.int64(end > bottom)
    while j < n_new:
        out_keys[n] = key
        out[n, 0], out[n, 1], out[n, 2], out[n, 3] = low, high, cycle, j
        n += shown
        j += 1
        key, low, high = _next(keys, bounds, j)
    return n


@njit(nogil=True, cache=True)
def _next(keys: Any, bounds: Any, j: Any) -> Any:
    """Return cell, bottom and top of interval j; a cell beyond all after the last."""
    if j < len(keys):
        return keys[j], np.int64(bounds[j, 0]), np.int64(bounds[j, 1])
    return np.int64(_LAST), np.int64(_LAST), np.int64(_LAST)


@njit(nogil=True, cache=True)
def count_composites(keys: Any, pieces: Any, n: Any) -> Any:
    """Return the number of composite cuboids: runs of touching pieces of one cell."""
    count = 0
    for i in range(n):
        if i == 0 or keys[i] != keys[i - 1] or pieces[i, 0] != pieces[i - 1, 1]:
            count += 1
    return count


@njit(nogil=True, cache=True)
def join_pieces(keys: Any, pieces: Any, n: Any, cells: Any, spans: Any) -> Any:
    """Write cell and (bottom, top) of each composite cuboid; return how many there are."""
    k = 0
    for i in range(n):
        if i == 0 or keys[i] != keys[i - 1] or pieces[i, 0] != pieces[i - 1, 1]:
            cells[k], spans[k, 0] = keys[i], pieces[i, 0]
            k += 1
        spans[k - 1, 1] = pieces[i, 1]
    return k


@njit(nogil=True, cache=True)
def compose_cuboids(
    keys: Any,
    pieces: Any,
    n: Any,
    slots: Any,
    first_cycle: Any,
    moments: Any,
    lengths: Any,
    cells: Any,
    spans: Any,
    count: Any,
    s: Any,
    S: Any,
    cycles: Any,
    offsets: Any,
) -> Any:
    """Join touching pieces to composite cuboids and add up their weighted moments.

    A piece weighs its length over its original's. Moments are added from the lowest piece to the
    highest, so that equal pieces give equal sums to the last bit.

    Parameters
    ----------
    keys, pieces, n
        The pieces.
    slots, first_cycle
        int64: row in `moments` of the first cuboid of cycle ``first_cycle + k``.
    moments, lengths
        int64 (M, 10) and int32 (M,), of the originals.
    cells, spans
        int32 (2, C): receive ix and iy, bottom and top.
    count, s, S
        float64 (C,), (C, 3), (C, 6): receive counts and moments.
    cycles, offsets
        Receive the ordered cycles of each composite, int32 (n,), and where they begin, int64.

    Returns
    -------
    int
        Number of entries in `cycles`.
    """
    k, used, begin = -1, 0, 0
    # A window of up to 64 cycles is a word of bits: no sorting, and nothing to mispredict.
    narrow, seen = len(slots) <= 64, np.uint64(0)
    a0 = a1 = a2 = a3 = a4 = a5 = a6 = a7 = a8 = a9 = 0.0
    for i in range(n + 1):
        if i == n or i == 0 or keys[i] != keys[i - 1] or pieces[i, 0] != pieces[i - 1, 1]:
            if k >= 0:
                spans[1, k] = pieces[i - 1, 1]
                count[k], s[k, 0], s[k, 1], s[k, 2] = a0, a1, a2, a3
                S[k, 0], S[k, 1], S[k, 2] = a4, a5, a6
                S[k, 3], S[k, 4], S[k, 5] = a7, a8, a9
            while seen != _NONE:
                cycles[used] = first_cycle + lowest_bit(seen)
                seen &= seen - _ONE
                used += 1
            k += 1
            offsets[k] = begin = used
            if i == n:
                break
            ix = (keys[i] + _HALF) >> 32
            cells[0, k], cells[1, k] = ix, keys[i] - (ix << 32)
            spans[0, k] = pieces[i, 0]
            a0 = a1 = a2 = a3 = a4 = a5 = a6 = a7 = a8 = a9 = 0.0
        cycle = pieces[i, 2]
        row = slots[cycle - first_cycle] + pieces[i, 3]
        weight = np.float64(pieces[i, 1] - pieces[i, 0]) / np.float64(lengths[row])
        a0 += weight * moments[row, 0]
        a1 += weight * moments[row, 1]
        a2 += weight * moments[row, 2]
        a3 += weight * moments[row, 3]
        a4 += weight * moments[row, 4]
        a5 += weight * moments[row, 5]
        a6 += weight * moments[row, 6]
        a7 += weight * moments[row, 7]
        a8 += weight * moments[row, 8]
        a9 += weight * moments[row, 9]
        if narrow:
            seen |= _ONE << np.uint64(cycle - first_cycle)
        else:
            used = _insert_cycle(cycles, begin, used, cycle)
    return used


@njit(nogil=True, cache=True)
def _insert_cycle(cycles: Any, begin: Any, end: Any, cycle: Any) -> Any:
    """Put a cycle in order into cycles[begin:end], unless it is there; return the new end."""
    j = end
    while j > begin and cycles[j - 1] > cycle:
        j -= 1
    if j > begin and cycles[j - 1] == cycle:
        return end
    for m in range(end, j, -1):
        cycles[m] = cycles[m - 1]
    cycles[j] = cycle
    return end + 1
