"""From beams to binned points, scan by scan: place each beam, find its cell, count it there.

Cells are counted in tiles of 64 x 64, made where points fall, so that the memory follows what was
seen and not the box around it. A cell's address is ``slot * 4096 + x * 64 + y``; a bitmap of the
counted cells lets them be listed in order without sorting.

Beams go through in blocks of `BLOCK`. All that is arithmetic is done first, into a scratch array
whose rows are a block apart: at a distance that the compiler knows, so that it needs no proof that
rows do not overlap and makes vector code. What depends on memory (counting) follows, beam by beam.
Indices are unsigned: a signed one may be negative and then counts from the end, and that test alone
keeps loops from being vectors.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from tccm_ros.scan_kernels import refine_poses

__all__ = [
    "BLOCK",
    "CELLS_PER_TILE",
    "TILE",
    "WORK_SIZE",
    "bin_points",
    "bin_scan",
    "list_cells",
    "lowest_bit",
]

TILE = 64
"""Cells along a tile's edge: one row is one word of the bitmap."""

CELLS_PER_TILE = TILE * TILE

BLOCK = 512
"""Beams that are worked on together: their scratch rows stay in the first cache."""

# Rows of the scratch array, int32: whether the beam is used, its tile in the directory, its cell
# in the tile, its height in ticks, its place in the cell (x << 16 | y) and its depth in ticks.
_USED, _TILE_OF, _CELL_OF, _HEIGHT, _PLACE, _DEPTH_OF = (np.uint64(row * BLOCK) for row in range(6))

WORK_SIZE = 6 * BLOCK
"""Elements of the scratch array `work`, int32."""

GROW_TILES, GROW_SLOTS = -1, -2
"""What `bin_scan` asks for before it goes on."""

# Elements of `meta`, int64: what the kernels count, where the directory of tiles lies, the box of
# tiles that it must cover, and the span of heights.
N_POINTS, N_SLOTS, TILE_X0, TILE_Y0, TILES_X, TILES_Y, NEXT_BEAM = range(7)
BOX_X0, BOX_X1, BOX_Y0, BOX_Y1 = range(7, 11)
LOWEST, HIGHEST = 11, 12
N_META = 13

# Elements of `limits`, float64: settings, the region, and the normal of the scan before's plane.
TICKS, CELL_TICKS, DEPTH, DEPTH_PER_RANGE, MAX_DEPTH, REGION_IN = range(6)
REGION = 6
NORMAL, HAS_NORMAL = 12, 15
N_LIMITS = 16

NO_REGION, REGION_IN_ODOM, REGION_IN_BASE = 0, 1, 2

BLEND_ANGLE = 0.01
"""Poses of a scan that turn by more than this, rad, are refined before matrices are blended: the
chord would shorten a beam by the 80,000th part (angle^2 / 8)."""

FAR = 2**30
"""Points so many ticks (107 km) from the origin, or further, are left out."""

# Adding 2^30 before truncation makes int32() a floor that processors have for vectors.
_SHIFT = np.float64(FAR)
_UNSHIFT = np.int64(FAR)
_REACH = np.float64(FAR - 1)

_U0, _U1, _U2, _U3 = np.uint64(0), np.uint64(1), np.uint64(2), np.uint64(3)
_BEYOND = np.int64(2**40)


def _cttz(typing_context: Any, word: Any) -> Any:
    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.uint64), build


_trailing_zeros: Any = intrinsic(_cttz)
"""The processor's own instruction."""


@njit(nogil=True, cache=True)
def lowest_bit(word: Any) -> Any:
    """Return the index of the lowest set bit of a uint64 that is not zero."""
    return _trailing_zeros(word)


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
def _quantise(
    work: Any, j: Any, used: Any, px: Any, py: Any, pz: Any, depth: Any, grid: Any
) -> Any:
    """Write what a point at (px, py, pz), in ticks, is in whole ticks. Branch-free.

    `grid` holds cells per tick, ticks per cell, and the directory's first tile and width. Returns
    whether the point is used, its tile in the directory along x and y, and its height.
    """
    per_tick, cell, tile_x0, tile_y0, tiles_y = grid
    used = used & (abs(px) < _REACH) & (abs(py) < _REACH) & (abs(pz) < _REACH)
    # What is not used becomes a number that can be converted.
    px, py, pz = (px if used else 0.0), (py if used else 0.0), (pz if used else 0.0)
    x = np.int64(np.int32(px + (_SHIFT + 0.5))) - _UNSHIFT
    y = np.int64(np.int32(py + (_SHIFT + 0.5))) - _UNSHIFT
    z = np.int64(np.int32(pz + (_SHIFT + 0.5))) - _UNSHIFT
    # Half a tick keeps the product off whole numbers: this is the exact floor division.
    ix = np.int64(np.int32((x + 0.5) * per_tick + _SHIFT)) - _UNSHIFT
    iy = np.int64(np.int32((y + 0.5) * per_tick + _SHIFT)) - _UNSHIFT
    tx, ty = (ix >> 6) - tile_x0, (iy >> 6) - tile_y0
    work[_USED + j] = used
    work[_TILE_OF + j] = tx * tiles_y + ty
    work[_CELL_OF + j] = ((ix & 63) << 6) | (iy & 63)
    work[_HEIGHT + j] = z
    work[_PLACE + j] = ((x - ix * cell) << 16) | (y - iy * cell)
    work[_DEPTH_OF + j] = np.int32(depth)
    return used, tx, ty, z


@njit(nogil=True, cache=True)
def _widen(meta: Any, x0: Any, x1: Any, y0: Any, y1: Any, low: Any, high: Any) -> Any:
    """Take in the tiles and heights of a block; return whether the directory covers its tiles."""
    if x0 > x1:
        return True
    meta[BOX_X0], meta[BOX_X1] = x0 + meta[TILE_X0], x1 + meta[TILE_X0]
    meta[BOX_Y0], meta[BOX_Y1] = y0 + meta[TILE_Y0], y1 + meta[TILE_Y0]
    meta[LOWEST], meta[HIGHEST] = min(meta[LOWEST], low), max(meta[HIGHEST], high)
    return x0 >= 0 and y0 >= 0 and x1 < meta[TILES_X] and y1 < meta[TILES_Y]


@njit(nogil=True, cache=True)
def _mark_kept(keep: Any, first: Any, n: Any, work: Any) -> None:
    """Mark the n beams from `first` on that are to be used."""
    for j in range(np.uint64(n)):
        work[_USED + j] = keep[np.uint64(first) + j]


@njit(nogil=True, cache=True)
def _mark_inside(
    ranges: Any, keep: Any, directions: Any, seen: Any, first: Any, n: Any, work: Any
) -> Any:
    """Mark the n beams from `first` on that are to be used and hit inside the region.

    `seen` float32 (7, 3) is the region as beam 0 sees it (`_region_from`), along its axes: the
    laser's x and y axis, how both change per beam, the laser's place from the region's centre, how
    it moves per beam, and half the region's size. Returns the first beam marked, of n, and the one
    after the last.
    """
    a0, a1, a2 = seen[0, 0], seen[0, 1], seen[0, 2]
    b0, b1, b2 = seen[1, 0], seen[1, 1], seen[1, 2]
    c0, c1, c2 = seen[2, 0], seen[2, 1], seen[2, 2]
    d0, d1, d2 = seen[3, 0], seen[3, 1], seen[3, 2]
    p0, p1, p2 = seen[4, 0], seen[4, 1], seen[4, 2]
    q0, q1, q2 = seen[5, 0], seen[5, 1], seen[5, 2]
    h0, h1, h2 = seen[6, 0], seen[6, 1], seen[6, 2]
    cosines, sines = directions[0], directions[1]
    for j in range(np.uint64(n)):
        i = np.uint64(first) + j
        k = np.float32(np.int32(i))
        u, v = ranges[i] * cosines[i], ranges[i] * sines[i]
        x = abs((a0 + k * c0) * u + (b0 + k * d0) * v + (p0 + k * q0)) <= h0
        y = abs((a1 + k * c1) * u + (b1 + k * d1) * v + (p1 + k * q1)) <= h1
        z = abs((a2 + k * c2) * u + (b2 + k * d2) * v + (p2 + k * q2)) <= h2
        work[_USED + j] = keep[i] & x & y & z
    low, high = np.uint64(0), np.uint64(n)
    while low < high and work[_USED + low] == 0:
        low += _U1
    while low < high and work[_USED + high - _U1] == 0:
        high -= _U1
    return np.int64(low), np.int64(high)


@njit(nogil=True, cache=True)
def _place_beams(
    ranges: Any,
    directions: Any,
    T0: Any,
    T1: Any,
    f0: Any,
    df: Any,
    depth_per_range: Any,
    limits: Any,
    first: Any,
    low: Any,
    high: Any,
    work: Any,
    meta: Any,
) -> Any:
    """Place the beams [low, high) of the block that begins with beam `first`.

    Beam i is at the fraction ``f0 + df * i`` of the way from T0 to T1, float64 (3, 4); the matrices
    are blended. `directions` are float32 (2, N), cosines and sines of the bearings. Hits are
    reckoned in float32 from the laser, good for a micrometre there; the laser's place is added in
    float64. Returns whether the directory covers all of them.
    """
    g0, dg = np.float32(f0), np.float32(df)
    a00, a01 = np.float32(T0[0, 0]), np.float32(T0[0, 1])
    a10, a11 = np.float32(T0[1, 0]), np.float32(T0[1, 1])
    a20, a21 = np.float32(T0[2, 0]), np.float32(T0[2, 1])
    b00, b01 = np.float32(T1[0, 0] - T0[0, 0]), np.float32(T1[0, 1] - T0[0, 1])
    b10, b11 = np.float32(T1[1, 0] - T0[1, 0]), np.float32(T1[1, 1] - T0[1, 1])
    b20, b21 = np.float32(T1[2, 0] - T0[2, 0]), np.float32(T1[2, 1] - T0[2, 1])
    mx, my, mz = T1[0, 3] - T0[0, 3], T1[1, 3] - T0[1, 3], T1[2, 3] - T0[2, 3]
    ox, oy, oz = T0[0, 3] + mx * f0, T0[1, 3] + my * f0, T0[2, 3] + mz * f0
    dx, dy, dz = mx * df, my * df, mz * df
    cosines, sines = directions[0], directions[1]
    ticks, least, most = limits[TICKS], limits[DEPTH], limits[MAX_DEPTH]
    grid = (
        1.0 / limits[CELL_TICKS], np.int64(limits[CELL_TICKS]),
        meta[TILE_X0], meta[TILE_Y0], meta[TILES_Y],
    )  # fmt: skip
    x0 = y0 = bottom = _BEYOND
    x1 = y1 = top = -_BEYOND
    for j in range(np.uint64(low), np.uint64(high)):
        i = np.uint64(first) + j
        number = np.int32(i)
        r, f = ranges[i], g0 + dg * np.float32(number)
        u, v = r * cosines[i], r * sines[i]
        x = (a00 + f * b00) * u + (a01 + f * b01) * v
        y = (a10 + f * b10) * u + (a11 + f * b11) * v
        z = (a20 + f * b20) * u + (a21 + f * b21) * v
        px, py, pz = x + (ox + dx * number), y + (oy + dy * number), z + (oz + dz * number)
        depth = depth_per_range * r
        depth = depth if depth > least else least
        depth = depth if depth < most else most
        used, tx, ty, h = _quantise(
            work, j, work[_USED + j] != 0, px * ticks, py * ticks, pz * ticks, depth, grid
        )
        x0, x1 = min(x0, tx if used else _BEYOND), max(x1, tx if used else -_BEYOND)
        y0, y1 = min(y0, ty if used else _BEYOND), max(y1, ty if used else -_BEYOND)
        bottom, top = min(bottom, h if used else _BEYOND), max(top, h if used else -_BEYOND)
    return _widen(meta, x0, x1, y0, y1, bottom, top)


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
        if work[_USED + j] == 0:
            continue
        tile = np.uint64(work[_TILE_OF + j])
        slot = np.int64(directory[tile])
        if slot < 0:
            if (slots + 1) * CELLS_PER_TILE > len(counts):
                at = np.int64(j)
                break
            slot = slots
            directory[tile] = slot
            slots += 1
        cell = np.int64(work[_CELL_OF + j])
        address = slot * CELLS_PER_TILE + cell
        counts[np.uint64(address)] += 1
        bits[np.uint64(address >> 6)] |= _U1 << np.uint64(cell & 63)
        place = np.int64(np.uint32(work[_PLACE + j]))
        records[_U2 * n] = (np.int64(work[_HEIGHT + j]) << 32) | place
        records[_U2 * n + _U1] = (np.int64(work[_DEPTH_OF + j]) << 32) | address
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
        x0 = y0 = bottom = _BEYOND
        x1 = y1 = top = -_BEYOND
        for j in range(np.uint64(count)):
            i = _U3 * (np.uint64(begin) + j)
            x, y, z = points[i], points[i + _U1], points[i + _U2]
            used, tx, ty, h = _quantise(work, j, True, x * ticks, y * ticks, z * ticks, depth, grid)
            x0, x1 = min(x0, tx if used else _BEYOND), max(x1, tx if used else -_BEYOND)
            y0, y1 = min(y0, ty if used else _BEYOND), max(y1, ty if used else -_BEYOND)
            bottom, top = min(bottom, h if used else _BEYOND), max(top, h if used else -_BEYOND)
        meta[NEXT_BEAM] = begin
        if not _widen(meta, x0, x1, y0, y1, bottom, top):
            return GROW_TILES
        done = _count(0, count, work, records, directory, counts, bits, meta)
        if done < count:
            meta[NEXT_BEAM] = begin + done
            return GROW_SLOTS
    return meta[N_POINTS]


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
    counts: Any,
    bits: Any,
    meta: Any,
) -> Any:
    """Place the beams of a scan, drop those outside the region, and bin the rest.

    Parameters
    ----------
    ranges, keep, directions
        float32 (N,) m, bool (N,), and float32 (2, N) as in `_place_beams`.
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
    times, T = _poses_of(_in_beams(knots, stamp, period), T_odom_base, T_base_laser)
    growth = limits[DEPTH_PER_RANGE] * limits[TICKS] * _line_step(T, limits, step)
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
            _region_from(T_odom_base, T[k], T[j], f0, df, limits, seen)
        for begin in range(start, end, BLOCK):
            low, high = np.int64(0), min(end - begin, np.int64(BLOCK))
            if has_region:
                # Most of a scan lies outside: only from the first to the last beam inside is
                # placed.
                low, high = _mark_inside(ranges, keep, directions, seen, begin, high, work)
            else:
                _mark_kept(keep, begin, high, work)
            if low >= high:
                continue
            covered = _place_beams(
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
