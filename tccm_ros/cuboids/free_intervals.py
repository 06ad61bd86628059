"""Free intervals of height per column from the beams of a tilt cycle, by ray traversal.

Each beam is traced through the columns that it crosses. A column has one bit per height bin for
passing beams and one for hits; a bin is free if beams passed and none hit. Gaps between scan lines
are closed if they are at most `GAP_STEPS` times the line distance and contain no hit.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tccm_ros.arrays import Bool, Float32, Float64
from tccm_ros.kernels import kernel

BIN = 0.02
"""Height of a bin, m. Chosen: the cell size of the map."""

BINS = 256
"""Number of bins of a column. Chosen: 5.12 m."""

WORDS = BINS // 64
"""Number of words of a column: one bit per bin, so that a beam sets all its bins at once."""

ALL = np.uint64(0xFFFF_FFFF_FFFF_FFFF)

MIN_HEIGHT = -1.5
"""Lower end of a column, m above the base. Chosen: includes floors below a platform."""

HIT_MARGIN = 2
"""Bins around a hit that are not free: the surface may be slightly higher or lower. Chosen."""

GAP_STEPS = 2.0
"""Maximum gap to close, in scan line distances. Chosen: one missing line."""

MAX_GAP_BINS = 10
"""Maximum number of bins of a gap to close. Chosen: 20 cm."""


@kernel
def _bin(z: Any) -> Any:
    return np.int64(np.floor((z - MIN_HEIGHT) * (1.0 / BIN)))


@kernel
def _mark(words: Any, column: Any, a: Any, b: Any) -> None:
    """Set the bits of a column from bin a to bin b, in either order."""
    low, high = max(min(a, b), 0), min(max(a, b), BINS - 1)
    if low > high:
        return
    first, last = low >> 6, high >> 6
    above = ALL << np.uint64(low & 63)
    below = ALL >> np.uint64(63 - (high & 63))
    if first == last:
        words[column, first] |= above & below
        return
    words[column, first] |= above
    for k in range(first + 1, last):
        words[column, k] = ALL
    words[column, last] |= below


@kernel
def _is_set(words: Any, column: Any, b: Any) -> Any:
    return (words[column, b >> 6] >> np.uint64(b & 63)) & np.uint64(1) != 0


@kernel
def trace_beams(
    origins: Any, ends: Any, hits: Any, cell: Any, half: Any, seen: Any, hit: Any
) -> None:
    """Trace beams through the columns of a square around the base.

    Parameters
    ----------
    origins, ends
        float64 (N, 3), m, in the base frame.
    hits
        bool (N,): whether the beam has a hit.
    cell, half
        Edge of a column, m, and number of columns from the base to the edge of the square.
    seen, hit
        uint64 ((2 half)^2, BINS / 64), one bit per bin: set where beams passed or hit.
    """
    width = 2 * half
    for i in range(len(origins)):
        ox, oy, oz = origins[i, 0] / cell + half, origins[i, 1] / cell + half, origins[i, 2]
        ex, ey, ez = ends[i, 0] / cell + half, ends[i, 1] / cell + half, ends[i, 2]
        dx, dy, dz = ex - ox, ey - oy, ez - oz
        ix, iy = np.int64(np.floor(ox)), np.int64(np.floor(oy))
        jx, jy = np.int64(np.floor(ex)), np.int64(np.floor(ey))
        step_x, step_y = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
        # Crossings are computed from the origin, so that rounding errors do not accumulate.
        per_x, per_y = (1.0 / dx if dx != 0.0 else 0.0), (1.0 / dy if dy != 0.0 else 0.0)
        tx = ((ix + (dx > 0.0)) - ox) * per_x if dx != 0.0 else np.inf
        ty = ((iy + (dy > 0.0)) - oy) * per_y if dy != 0.0 else np.inf
        t = 0.0
        bin_now = _bin(oz)
        has_entered = False
        # At most one crossing per column border between the ends, whatever the rounding.
        for _ in range(abs(jx - ix) + abs(jy - iy)):
            t = min(tx, ty)
            bin_before, bin_now = bin_now, _bin(oz + t * dz)
            if 0 <= ix < width and 0 <= iy < width:
                _mark(seen, ix * width + iy, bin_before, bin_now)
                has_entered = True
            elif has_entered:  # a square is left once
                break
            if tx <= ty:
                ix += step_x
                tx = ((ix + (dx > 0.0)) - ox) * per_x
            else:
                iy += step_y
                ty = ((iy + (dy > 0.0)) - oy) * per_y
        if 0 <= jx < width and 0 <= jy < width:
            end = _bin(ez)
            if hits[i]:
                _mark(hit, jx * width + jy, end - HIT_MARGIN, end + HIT_MARGIN)
            else:
                _mark(seen, jx * width + jy, bin_now, end)


@kernel
def list_intervals(seen: Any, hit: Any, cell: Any, half: Any, angle_step: Any, rows: Any) -> Any:
    """Write the free intervals of all columns, and return their number.

    Parameters
    ----------
    seen, hit, cell, half
        As in `trace_beams`.
    angle_step
        Angle between scan lines, rad.
    rows
        float32 (M, 4), written: x, y of the column's centre, z_low, z_high.

    Returns
    -------
    int
        Number of intervals, even if `rows` is too short for all of them.
    """
    n, width = 0, 2 * half
    for column in range(width * width):
        if not seen[column].any():
            continue
        x, y = (column // width - half + 0.5) * cell, (column % width - half + 0.5) * cell
        gap = np.int64(min(GAP_STEPS * angle_step * np.hypot(x, y) / BIN, 1.0 * MAX_GAP_BINS))
        start, last = -1, -1
        for b in range(BINS + 1):
            blocked = b == BINS or _is_set(hit, column, b)
            free = not blocked and _is_set(seen, column, b)
            if start >= 0 and not free and (blocked or b - last > gap):
                if n < rows.shape[0]:
                    rows[n, 0], rows[n, 1] = x, y
                    rows[n, 2], rows[n, 3] = MIN_HEIGHT + start * BIN, MIN_HEIGHT + (last + 1) * BIN
                n += 1
                start = -1
            if free:
                start, last = (b if start < 0 else start), b
    return n


class FreeIntervalTracer:
    """Traces the beams of one tilt cycle and computes the free intervals.

    Parameters
    ----------
    cell_size
        Edge of a column, m.
    max_range
        Half edge of the square of columns around the base, m.
    """

    def __init__(self, cell_size: float, max_range: float) -> None:
        self._cell = cell_size
        self._half = max(round(max_range / cell_size), 1)
        shape = ((2 * self._half) ** 2, WORDS)
        self._seen, self._hit = np.zeros(shape, np.uint64), np.zeros(shape, np.uint64)

    def add(self, origins: Float64, ends: Float64, hits: Bool) -> None:
        """Trace beams through the columns.

        Parameters
        ----------
        origins, ends
            float64 (N, 3), m, in the base frame.
        hits
            bool (N,), whether each beam ends on a surface.
        """
        trace_beams(origins, ends, hits, self._cell, self._half, self._seen, self._hit)

    def intervals(self, angle_step: float) -> Float32:
        """Return the free intervals float32 (N, 4) of `records.ViewIntervals`, and reset.

        Parameters
        ----------
        angle_step
            Angle between scan lines, rad, for closing the gaps between them.
        """
        rows = np.zeros((len(self._seen), 4), np.float32)
        while True:
            n = list_intervals(self._seen, self._hit, self._cell, self._half, angle_step, rows)
            if n <= len(rows):
                break
            rows = np.zeros((n, 4), np.float32)
        self._seen[:] = 0
        self._hit[:] = 0
        return rows[:n].copy()
