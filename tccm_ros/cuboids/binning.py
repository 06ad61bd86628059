"""From beams to binned points, scan by scan: place each beam, find its cell, count it there.

Beams go through in blocks: all that is arithmetic first (`placing`), then what depends on memory,
beam by beam.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from tccm_ros.cuboids.beam_endpoints import (
    BEYOND,
    mark_inside,
    mark_kept,
    place_beams,
    quantise,
    region_from,
    widen,
)
from tccm_ros.cuboids.beam_poses import in_beams, line_step, poses_of
from tccm_ros.cuboids.bin_layout import (
    BLOCK,
    CELL_OF,
    CELL_TICKS,
    CELLS_PER_TILE,
    DEPTH,
    DEPTH_OF,
    DEPTH_PER_RANGE,
    GROW_SLOTS,
    GROW_TILES,
    HAS_NORMAL,
    HEIGHT,
    N_POINTS,
    N_SLOTS,
    NEXT_BEAM,
    NO_REGION,
    NORMAL,
    PLACE,
    REGION_IN,
    TICKS,
    TILE,
    TILE_OF,
    TILE_X0,
    TILE_Y0,
    TILES_X,
    TILES_Y,
    USED,
)
from tccm_ros.cuboids.bits import lowest_bit

__all__ = ["bin_points", "bin_scan", "list_cells"]

_U0, _U1, _U2, _U3 = np.uint64(0), np.uint64(1), np.uint64(2), np.uint64(3)


@njit(nogil=True, cache=True)
def _count(
    low: Any, high: Any, work: Any, records: Any, directory: Any, counts: Any, bits: Any,
    meta: Any,
) -> Any:  # fmt: skip
    """Append the used beams [low, high) of a block to the records and count them in their cells.

    Returns `high`, or the beam for whose tile there is no room.
    """
    n, slots = np.uint64(meta[N_POINTS]), meta[N_SLOTS]
    at = high
    for j in range(np.uint64(low), np.uint64(high)):
        if work[USED + j] == 0:
            continue
        tile = np.uint64(work[TILE_OF + j])
        slot = np.int64(directory[tile])
        if slot < 0:
            if (slots + 1) * CELLS_PER_TILE > len(counts):
                at = np.int64(j)
                break
            slot = slots
            directory[tile] = slot
            slots += 1
        cell = np.int64(work[CELL_OF + j])
        address = slot * CELLS_PER_TILE + cell
        counts[np.uint64(address)] += 1
        bits[np.uint64(address >> 6)] |= _U1 << np.uint64(cell & 63)
        place = np.int64(np.uint32(work[PLACE + j]))
        records[_U2 * n] = (np.int64(work[HEIGHT + j]) << 32) | place
        records[_U2 * n + _U1] = (np.int64(work[DEPTH_OF + j]) << 32) | address
        n += _U1
    meta[N_POINTS], meta[N_SLOTS] = n, slots
    return at


@njit(nogil=True, cache=True)
def bin_points(
    points: Any,
    limits: Any,
    first: Any,
    work: Any,
    records: Any,
    directory: Any,
    counts: Any,
    bits: Any,
    meta: Any,
) -> Any:
    """Bin points, float64 (3 N,), m: x y z of each in the map's frame, from point `first` on.

    Those that are not finite are left out; all have the least depth. Everything else is as in
    `bin_scan`.
    """
    ticks, depth, n = limits[TICKS], limits[DEPTH], len(points) // 3
    per_tick, cell = 1.0 / limits[CELL_TICKS], np.int64(limits[CELL_TICKS])
    for begin in range(first, n, BLOCK):
        count = min(n - begin, BLOCK)
        grid = per_tick, cell, meta[TILE_X0], meta[TILE_Y0], meta[TILES_Y]
        x0 = y0 = bottom = BEYOND
        x1 = y1 = top = -BEYOND
        for j in range(np.uint64(count)):
            i = _U3 * (np.uint64(begin) + j)
            x, y, z = points[i], points[i + _U1], points[i + _U2]
            used, tx, ty, h = quantise(work, j, True, x * ticks, y * ticks, z * ticks, depth, grid)
            x0, x1 = min(x0, tx if used else BEYOND), max(x1, tx if used else -BEYOND)
            y0, y1 = min(y0, ty if used else BEYOND), max(y1, ty if used else -BEYOND)
            bottom, top = min(bottom, h if used else BEYOND), max(top, h if used else -BEYOND)
        meta[NEXT_BEAM] = begin
        if not widen(meta, x0, x1, y0, y1, bottom, top):
            return GROW_TILES
        done = _count(0, count, work, records, directory, counts, bits, meta)
        if done < count:
            meta[NEXT_BEAM] = begin + done
            return GROW_SLOTS
    return meta[N_POINTS]


@njit(nogil=True, cache=True)
def bin_scan(
    ranges: Any,
    keep: Any,
    directions: Any,
    knots: Any,
    stamp: Any,
    period: Any,
    T_odom_base: Any,
    T_base_laser: Any,
    limits: Any,
    first: Any,
    last: Any,
    step: Any,
    work: Any,
    records: Any,
    directory: Any,
    counts: Any,
    bits: Any,
    meta: Any,
) -> Any:
    """Place the beams of a scan, drop those outside the region, and bin the rest.

    Parameters
    ----------
    ranges, keep, directions
        float32 (N,) m, bool (N,), and float32 (2, N) as in `place_beams`.
    knots, stamp, period
        int64 (K,) stamps of the poses and int64 stamp of the first beam, ns; time between beams,
        ns; the knots fall where it is negative.
    T_odom_base, T_base_laser
        float64 (K, 4, 4), poses at the knots.
    limits
        float64 (N_LIMITS,): settings, region, and the state of the adaptive gap: the angle between
        this scan's plane and the one before is the step between scan lines.
    first, last
        The beams [first, last) are taken.
    step
        Angle between neighbouring beams, rad.
    work
        int32 (WORK_SIZE,), scratch.
    records, directory, counts, bits, meta
        State: int64 (2 M,), two words for each point, (z << 32 | x << 16 | y) within the cell and
        (depth << 32 | address); int32 tile -> slot or -1; int32 points per address; uint64 bitmap
        of addresses; int64 (N_META,).

    Returns
    -------
    int
        Number of records, or what must grow before the call is repeated from ``meta[NEXT_BEAM]``.
    """
    times, T = poses_of(in_beams(knots, stamp, period), T_odom_base, T_base_laser)
    growth = limits[DEPTH_PER_RANGE] * limits[TICKS] * line_step(T, limits, step)
    n, start = len(times), first
    has_region, seen = limits[REGION_IN] != NO_REGION, np.empty((7, 3), np.float32)
    for k in range(max(n - 1, 1)):
        end, f0, df, j = last, 0.0, 0.0, k
        if n > 1:
            j = k + 1
            df = 1.0 / (times[j] - times[k])
            f0 = -times[k] * df
            if j < n - 1:
                end = min(max(np.int64(np.ceil(times[j])), start), last)
        if has_region and start < end:
            region_from(T_odom_base, T[k], T[j], f0, df, limits, seen)
        for begin in range(start, end, BLOCK):
            low, high = np.int64(0), min(end - begin, np.int64(BLOCK))
            if has_region:
                # Most of a scan lies outside: only from the first to the last beam inside is
                # placed.
                low, high = mark_inside(ranges, keep, directions, seen, begin, high, work)
            else:
                mark_kept(keep, begin, high, work)
            if low >= high:
                continue
            covered = place_beams(
                ranges, directions, T[k], T[j], f0, df, growth, limits, begin, low, high, work, meta
            )
            meta[NEXT_BEAM] = begin
            if not covered:
                return GROW_TILES
            done = _count(low, high, work, records, directory, counts, bits, meta)
            if done < high:
                meta[NEXT_BEAM] = begin + done
                return GROW_SLOTS
        start = end
    for i in range(3):
        limits[NORMAL + i] = T[len(T) // 2, i, 2]
    limits[HAS_NORMAL] = 1.0
    return meta[N_POINTS]


@njit(nogil=True, cache=True)
def list_cells(
    directory: Any, counts: Any, bits: Any, meta: Any, keys: Any, starts: Any, addresses: Any
) -> Any:
    """List the counted cells in order of (ix, iy) and turn their counts into start positions.

    Parameters
    ----------
    directory, counts, bits, meta
        State of the binning. `counts` become the cells' first positions; `bits` are cleared.
    keys
        int64 (N,), receives the cells, see `part.cell_keys`.
    starts
        int32 (N + 1,), receives the first position of each cell and, last, the number of points.
    addresses
        int32 (N,), receives the cells' addresses.

    Returns
    -------
    int
        Number of cells.
    """
    n_x, n_y = meta[TILES_X], meta[TILES_Y]
    slots, columns = np.empty(n_y, np.int64), np.empty(n_y, np.int64)
    n = _U0
    position = np.int64(0)
    for tx in range(n_x):
        in_row = 0
        for ty in range(n_y):
            slot = directory[np.uint64(tx * n_y + ty)]
            if slot >= 0:
                slots[in_row], columns[in_row] = slot, ty
                in_row += 1
        if in_row == 0:
            continue
        for lx in range(TILE):
            ix = (meta[TILE_X0] + tx) * TILE + lx
            for j in range(in_row):
                row = slots[j] * TILE + lx
                word = bits[np.uint64(row)]
                bits[np.uint64(row)] = _U0
                key = (ix << 32) + (meta[TILE_Y0] + columns[j]) * TILE
                while word != _U0:
                    bit = lowest_bit(word)
                    word &= word - _U1
                    address = row * TILE + bit
                    keys[n] = key + bit
                    starts[n], addresses[n] = position, address
                    count = counts[np.uint64(address)]
                    counts[np.uint64(address)] = position
                    position += count
                    n += _U1
    starts[n] = position
    return np.int64(n)
