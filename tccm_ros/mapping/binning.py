"""From beams to binned points, scan by scan: place each beam, find its cell, count it there.

Cells are counted in tiles of 64 x 64, made where points fall, so that the memory follows what was
seen and not the box around it. A cell's address is ``slot * 4096 + x * 64 + y``; a bitmap of the
counted cells lets them be listed in order without sorting.

Indices are cast to unsigned in the inner loops: the compiler then leaves out the test for negative
ones, a third of the time.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from tccm_ros.scan_kernels import refine_poses

__all__ = [
    "CELLS_PER_TILE",
    "TILE",
    "bin_points",
    "bin_scan",
    "list_cells",
    "lowest_bit",
    "place_beams",
]

TILE = 64
"""Cells along a tile's edge: one row is one word of the bitmap."""

CELLS_PER_TILE = TILE * TILE

DONE, GROW_TILES, GROW_SLOTS = 0, 1, 2
"""What `bin_scan` asks for before it goes on."""

# Elements of `meta`, int64: what the kernels count, and where the directory of tiles lies.
N_POINTS, N_SLOTS, TILE_X0, TILE_Y0, TILES_X, TILES_Y, NEXT_BEAM = range(7)
BOX_X0, BOX_X1, BOX_Y0, BOX_Y1 = range(7, 11)
N_META = 11

# Elements of `limits`, float64: settings, the region, and the normal of the scan before's plane.
TICKS, CELL_TICKS, DEPTH, DEPTH_PER_RANGE, MAX_DEPTH, REGION_IN = range(6)
REGION = 6
NORMAL, HAS_NORMAL = 12, 15
N_LIMITS = 16

NO_REGION, REGION_IN_ODOM, REGION_IN_BASE = 0, 1, 2

BLEND_ANGLE = 0.01
"""Poses of a scan that turn by more than this, rad, are refined before matrices are blended: the
chord would shorten a beam by the 80,000th part (angle^2 / 8)."""

# Adding 2^30 before truncation makes int32() a floor that processors have for vectors, exact
# within 107 km of the origin.
_SHIFT = 2.0**30
_UNSHIFT = np.int64(2**30)

_DE_BRUIJN = 0x03F79D71B4CB0A89
_BIT_OF = np.zeros(64, np.int64)
for _bit in range(64):
    _BIT_OF[((_DE_BRUIJN << _bit) & 0xFFFFFFFFFFFFFFFF) >> 58] = _bit
_MAGIC = np.uint64(_DE_BRUIJN)
_ONE, _TOP_SIX = np.uint64(1), np.uint64(58)


@njit(nogil=True, cache=True)
def lowest_bit(word: Any) -> Any:
    """Return the index of the lowest set bit of a uint64 that is not zero."""
    isolated = word & (~word + _ONE)
    return _BIT_OF[np.int64((isolated * _MAGIC) >> _TOP_SIX)]


@njit(nogil=True, cache=True)
def place_beams(
    ranges: Any,
    directions: Any,
    T0: Any,
    T1: Any,
    f0: Any,
    df: Any,
    first: Any,
    last: Any,
    work: Any,
) -> None:
    """Place the beams [first, last) of a scan between two poses of its laser.

    Beam i is at the fraction ``f0 + df * i`` of the way from T0 to T1, float64 (3, 4); the matrices
    are blended. `directions` are float32 (3, N): cosines and sines of the bearings, and i itself.
    The hits go to the first rows of `work`, float32, m, along the axes of odom but from the laser:
    there float32 is good for a micrometre. Branch-free, so that it compiles to vector code; what
    an invalid range gives is not used by the caller.
    """
    g0, dg = np.float32(f0), np.float32(df)
    a00, a01 = np.float32(T0[0, 0]), np.float32(T0[0, 1])
    a10, a11 = np.float32(T0[1, 0]), np.float32(T0[1, 1])
    a20, a21 = np.float32(T0[2, 0]), np.float32(T0[2, 1])
    b00, b01 = np.float32(T1[0, 0] - T0[0, 0]), np.float32(T1[0, 1] - T0[0, 1])
    b10, b11 = np.float32(T1[1, 0] - T0[1, 0]), np.float32(T1[1, 1] - T0[1, 1])
    b20, b21 = np.float32(T1[2, 0] - T0[2, 0]), np.float32(T1[2, 1] - T0[2, 1])
    cosines, sines, number = directions[0], directions[1], directions[2]
    x, y, z = work[0], work[1], work[2]
    for i in range(first, last):
        f = g0 + dg * number[i]
        u, v = ranges[i] * cosines[i], ranges[i] * sines[i]
        x[i] = (a00 + f * b00) * u + (a01 + f * b01) * v
        y[i] = (a10 + f * b10) * u + (a11 + f * b11) * v
        z[i] = (a20 + f * b20) * u + (a21 + f * b21) * v


@njit(nogil=True, cache=True)
def _distance_outside(
    ranges: Any, directions: Any, seen: Any, first: Any, last: Any, work: Any
) -> None:
    """Write how far hits lie outside the region, m, to row 3 of `work`; negative inside.

    `seen` float32 (7, 3) is the region as beam 0 sees it (`_region_from`), along its axes: the
    laser's x and y axis, how both change per beam, the laser's place from the region's centre, how
    it moves per beam, and half the region's size.
    """
    a0, a1, a2 = seen[0, 0], seen[0, 1], seen[0, 2]
    b0, b1, b2 = seen[1, 0], seen[1, 1], seen[1, 2]
    c0, c1, c2 = seen[2, 0], seen[2, 1], seen[2, 2]
    d0, d1, d2 = seen[3, 0], seen[3, 1], seen[3, 2]
    p0, p1, p2 = seen[4, 0], seen[4, 1], seen[4, 2]
    q0, q1, q2 = seen[5, 0], seen[5, 1], seen[5, 2]
    h0, h1, h2 = seen[6, 0], seen[6, 1], seen[6, 2]
    cosines, sines, number, outside = directions[0], directions[1], directions[2], work[3]
    for i in range(first, last):
        k = number[i]
        u, v = ranges[i] * cosines[i], ranges[i] * sines[i]
        x = abs((a0 + k * c0) * u + (b0 + k * d0) * v + (p0 + k * q0)) - h0
        y = abs((a1 + k * c1) * u + (b1 + k * d1) * v + (p1 + k * q1)) - h1
        z = abs((a2 + k * c2) * u + (b2 + k * d2) * v + (p2 + k * q2)) - h2
        outside[i] = max(max(x, y), z)


@njit(nogil=True, cache=True)
def _region_from(
    T_odom_base: Any, T0: Any, T1: Any, f0: Any, df: Any, limits: Any, seen: Any
) -> None:
    """Write how the beams between two poses T0, T1 (3, 4) see the region: `_distance_outside`."""
    m = len(T_odom_base) // 2
    in_base = limits[REGION_IN] == REGION_IN_BASE
    for i in range(3):
        low, high = limits[REGION + 2 * i], limits[REGION + 2 * i + 1]
        seen[6, i] = 0.5 * (high - low)
        for c, column in enumerate((0, 1, 3)):
            row = (0, 1, 4)[c]
            at = move = 0.0
            for j in range(3):
                r = T_odom_base[m, j, i] if in_base else np.float64(i == j)
                begin = T0[j, column]
                if column == 3 and in_base:
                    begin -= T_odom_base[m, j, 3]
                turn = T1[j, column] - T0[j, column]
                at += r * (begin + f0 * turn)
                move += r * df * turn
            if column == 3:
                at -= 0.5 * (low + high)
            seen[row, i] = at
            seen[(2, 3, 5)[c], i] = move


@njit(nogil=True, cache=True)
def _compose(n: Any, T_odom_base: Any, T_base_laser: Any) -> Any:
    """Return the first n T_odom_laser (n, 3, 4), and whether they turn by over `BLEND_ANGLE`."""
    T = np.empty((n, 3, 4))
    coarse = False
    for k in range(n):
        difference = 0.0
        for i in range(3):
            a, b, c = T_odom_base[k, i, 0], T_odom_base[k, i, 1], T_odom_base[k, i, 2]
            for j in range(4):
                T[k, i, j] = a * T_base_laser[k, 0, j] + b * T_base_laser[k, 1, j]
                T[k, i, j] += c * T_base_laser[k, 2, j]
                if k > 0 and j < 3:
                    difference += (T[k, i, j] - T[k - 1, i, j]) ** 2
            T[k, i, 3] += T_odom_base[k, i, 3]
        coarse = coarse or difference > 2.0 * BLEND_ANGLE**2
    return T, coarse


@njit(nogil=True, cache=True)
def _bounding_cells(
    points: Any, outside: Any, origin: Any, limits: Any, first: Any, last: Any, meta: Any
) -> None:
    """Write the box of cells around the points [first, last) to `meta`, a metre to spare."""
    x0 = y0 = np.inf
    x1 = y1 = -np.inf
    for i in range(first, last):
        if outside[i] <= 0.0 and abs(points[0, i] + points[1, i]) < np.inf:
            x, y = points[0, i] + origin[0], points[1, i] + origin[1]
            x0, x1, y0, y1 = min(x0, x), max(x1, x), min(y0, y), max(y1, y)
    scale = limits[TICKS] / limits[CELL_TICKS]
    meta[BOX_X0], meta[BOX_X1] = np.floor((x0 - 1.0) * scale), np.floor((x1 + 1.0) * scale)
    meta[BOX_Y0], meta[BOX_Y1] = np.floor((y0 - 1.0) * scale), np.floor((y1 + 1.0) * scale)


@njit(nogil=True, cache=True)
def bin_points(
    points: Any,
    outside: Any,
    keep: Any,
    origin: Any,
    drift: Any,
    ranges: Any,
    depth_per_range: Any,
    limits: Any,
    first: Any,
    last: Any,
    records: Any,
    directory: Any,
    tiles: Any,
    counts: Any,
    bits: Any,
    meta: Any,
) -> Any:
    """Append points to the records and count them in their cells.

    Parameters
    ----------
    points
        float (>= 3, N), m, along the axes of the map but from an origin.
    outside, keep
        float (N,): points with a positive value (or nan) are left out; bool (N,).
    origin, drift
        float64 (3,), m: the origin at point 0, and how it moves from point to point.
    ranges, depth_per_range
        float (N,), m, and depth per range in ticks per m; the depth stays within `limits`.
    limits, records, directory, tiles, counts, bits, meta, and what is returned
        As in `bin_scan`.
    first, last
        The points [first, last) are taken.
    """
    ticks, cell, max_depth = limits[TICKS], np.int64(limits[CELL_TICKS]), limits[MAX_DEPTH]
    inverse, depth = 1.0 / limits[CELL_TICKS], limits[DEPTH]
    tile_x0, tile_y0 = meta[TILE_X0], meta[TILE_Y0]
    n_x, n_y, n = meta[TILES_X], meta[TILES_Y], meta[N_POINTS]
    ox, oy, oz = origin[0], origin[1], origin[2]
    dx, dy, dz = drift[0], drift[1], drift[2]
    wanted, i = DONE, first
    while i < last:
        u = np.uint64(i)
        if not (keep[u] and outside[u] <= 0.0):
            i += 1
            continue
        x = np.int64((points[0, u] + (ox + dx * i)) * ticks + (_SHIFT + 0.5)) - _UNSHIFT
        y = np.int64((points[1, u] + (oy + dy * i)) * ticks + (_SHIFT + 0.5)) - _UNSHIFT
        z = np.int64((points[2, u] + (oz + dz * i)) * ticks + (_SHIFT + 0.5)) - _UNSHIFT
        # Half a tick keeps the product off whole numbers: this is the exact floor division.
        ix = np.int64((x + 0.5) * inverse + _SHIFT) - _UNSHIFT
        iy = np.int64((y + 0.5) * inverse + _SHIFT) - _UNSHIFT
        tx, ty = (ix >> 6) - tile_x0, (iy >> 6) - tile_y0
        if tx < 0 or ty < 0 or tx >= n_x or ty >= n_y:
            wanted = GROW_TILES
            break
        slot = np.int64(directory[np.uint64(tx * n_y + ty)])
        if slot < 0:
            slot = meta[N_SLOTS]
            if (slot + 1) * CELLS_PER_TILE > len(counts):
                wanted = GROW_SLOTS
                break
            directory[np.uint64(tx * n_y + ty)] = slot
            tiles[slot] = tx * n_y + ty
            meta[N_SLOTS] = slot + 1
        row = np.uint64(slot * TILE + (ix & 63))
        cell_number = slot * CELLS_PER_TILE + (ix & 63) * TILE + (iy & 63)
        address = np.uint64(cell_number)
        seen = counts[address]
        counts[address] = seen + 1
        if seen == 0:
            bits[row] |= _ONE << np.uint64(iy & 63)
        wanted_depth = depth_per_range * ranges[u]
        if depth > wanted_depth:
            wanted_depth = depth
        if wanted_depth > max_depth:
            wanted_depth = max_depth
        d = np.int64(wanted_depth)
        m = np.uint64(n)
        records[m, 0] = (z << 32) | ((x - ix * cell) << 16) | (y - iy * cell)
        records[m, 1] = (d << 32) | cell_number
        n += 1
        i += 1
    meta[N_POINTS], meta[NEXT_BEAM] = n, i
    if wanted == GROW_TILES:
        _bounding_cells(points, outside, origin, limits, i, last, meta)
    return wanted


@njit(nogil=True, cache=True)
def _poses_of(times: Any, T_odom_base: Any, T_base_laser: Any) -> Any:
    """Return times and T_odom_laser (K, 3, 4), refined where they turn far."""
    T, coarse = _compose(len(times), T_odom_base, T_base_laser)
    if not coarse:
        return times, T
    square = np.zeros((len(T), 4, 4))
    square[:, :3] = T
    return refine_poses(times, square)


@njit(nogil=True, cache=True)
def _line_step(T: Any, limits: Any, step: Any) -> Any:
    """Return the larger of the steps between beams and to the scan before, rad."""
    if limits[HAS_NORMAL] == 0.0:
        return step
    square = 0.0
    for i in range(3):
        square += (T[len(T) // 2, i, 2] - limits[NORMAL + i]) ** 2
    return max(step, np.sqrt(square))


@njit(nogil=True, cache=True)
def _in_beams(knots: Any, stamp: Any, period: Any) -> Any:
    """Return the knots' times in beams after the first; one knot where all beams have one time."""
    n = len(knots) if period != 0.0 else 1
    times = np.zeros(n)
    for k in range(n):
        if n > 1:
            times[k] = (knots[k] - stamp) / period
    return times


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
    tiles: Any,
    counts: Any,
    bits: Any,
    meta: Any,
) -> Any:
    """Place the beams of a scan, drop those outside the region, and bin the rest.

    Parameters
    ----------
    ranges, keep, directions
        float32 (N,) m, bool (N,), and float32 (3, N) as in `place_beams`.
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
        float32 (4, >= N), scratch.
    records, directory, tiles, counts, bits, meta
        State: int64 (M, 2), (z << 32 | x << 16 | y) within the cell and (depth << 32 | address) of
        each point; int32 tile -> slot or -1, and slot -> tile; int32 points per address; uint64
        bitmap of addresses; int64 (N_META,).

    Returns
    -------
    int
        DONE, or what must grow before the call is repeated from ``meta[NEXT_BEAM]``.
    """
    times, T = _poses_of(_in_beams(knots, stamp, period), T_odom_base, T_base_laser)
    growth = limits[DEPTH_PER_RANGE] * limits[TICKS] * _line_step(T, limits, step)
    n, start = len(times), first
    origin, drift = np.empty(3), np.empty(3)
    has_region, seen = limits[REGION_IN] != NO_REGION, np.empty((7, 3), np.float32)
    work[3, first:last] = np.float32(0.0)
    for k in range(max(n - 1, 1)):
        end, f0, df, j = last, 0.0, 0.0, k
        if n > 1:
            j = k + 1
            df = 1.0 / (times[j] - times[k])
            f0 = -times[k] * df
            if j < n - 1:
                end = min(max(np.int64(np.ceil(times[j])), start), last)
        from_beam, to_beam = start, end
        if has_region and start < end:
            _region_from(T_odom_base, T[k], T[j], f0, df, limits, seen)
            _distance_outside(ranges, directions, seen, start, end, work)
            # Most of a scan lies outside: only from the first to the last beam inside is placed.
            while from_beam < to_beam and not work[3, from_beam] <= 0.0:
                from_beam += 1
            while from_beam < to_beam and not work[3, to_beam - 1] <= 0.0:
                to_beam -= 1
        start = end
        if from_beam == to_beam:
            continue
        for i in range(3):
            drift[i] = (T[j, i, 3] - T[k, i, 3]) * df
            origin[i] = T[k, i, 3] + (T[j, i, 3] - T[k, i, 3]) * f0
        place_beams(ranges, directions, T[k], T[j], f0, df, from_beam, to_beam, work)
        wanted = bin_points(
            work, work[3], keep, origin, drift, ranges, growth, limits, from_beam, to_beam,
            records, directory, tiles, counts, bits, meta,
        )  # fmt: skip
        if wanted != DONE:
            return wanted
    for i in range(3):
        limits[NORMAL + i] = T[len(T) // 2, i, 2]
    limits[HAS_NORMAL] = 1.0
    return DONE


@njit(nogil=True, cache=True)
def list_cells(
    directory: Any, counts: Any, bits: Any, meta: Any, cells: Any, starts: Any, addresses: Any
) -> Any:
    """List the counted cells in order of (ix, iy) and turn their counts into start positions.

    Parameters
    ----------
    directory, counts, bits, meta
        State of the binning. `counts` become the cells' first positions; `bits` are cleared.
    cells
        int32 (N, 2), receives (ix, iy).
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
    n = position = 0
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
                word = bits[row]
                bits[row] = np.uint64(0)
                iy0 = (meta[TILE_Y0] + columns[j]) * TILE
                while word != np.uint64(0):
                    bit = lowest_bit(word)
                    word &= word - _ONE
                    address = row * TILE + bit
                    cells[n, 0], cells[n, 1] = ix, iy0 + bit
                    starts[n], addresses[n] = position, address
                    position += counts[address]
                    counts[address] = starts[n]
                    n += 1
    starts[n] = position
    return n
