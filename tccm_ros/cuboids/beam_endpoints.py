"""Placing beams: where each hits, in whole ticks, in blocks that become vector code.

All that is arithmetic is done in blocks of `BLOCK` beams, into a scratch array whose rows are a
block apart: at a distance that the compiler knows, so that it needs no proof that rows do not
overlap and makes vector code. Indices are unsigned: a signed one may be negative and then counts
from the end, and that test alone keeps loops from being vectors.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from tccm_ros.cuboids.bin_layout import (
    BOX_X0,
    BOX_X1,
    BOX_Y0,
    BOX_Y1,
    CELL_OF,
    CELL_TICKS,
    DEPTH,
    DEPTH_OF,
    HEIGHT,
    HIGHEST,
    LOWEST,
    MAX_DEPTH,
    PLACE,
    REGION,
    REGION_IN,
    REGION_IN_BASE,
    TICKS,
    TILE_OF,
    TILE_X0,
    TILE_Y0,
    TILES_X,
    TILES_Y,
    USED,
)

__all__ = ["BEYOND", "mark_inside", "mark_kept", "place_beams", "quantise", "region_from", "widen"]

FAR = 2**30
"""Points so many ticks (107 km) from the origin, or further, are left out."""

# Adding 2^30 before truncation makes int32() a floor that processors have for vectors.
_SHIFT = np.float64(FAR)
_UNSHIFT = np.int64(FAR)
_REACH = np.float64(FAR - 1)

_U1 = np.uint64(1)
BEYOND = np.int64(2**40)
"""More than any tile or height."""


@njit(nogil=True, cache=True)
def region_from(
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
def quantise(work: Any, j: Any, used: Any, px: Any, py: Any, pz: Any, depth: Any, grid: Any) -> Any:
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
    work[USED + j] = used
    work[TILE_OF + j] = tx * tiles_y + ty
    work[CELL_OF + j] = ((ix & 63) << 6) | (iy & 63)
    work[HEIGHT + j] = z
    work[PLACE + j] = ((x - ix * cell) << 16) | (y - iy * cell)
    work[DEPTH_OF + j] = np.int32(depth)
    return used, tx, ty, z


@njit(nogil=True, cache=True)
def widen(meta: Any, x0: Any, x1: Any, y0: Any, y1: Any, low: Any, high: Any) -> Any:
    """Take in the tiles and heights of a block; return whether the directory covers its tiles."""
    if x0 > x1:
        return True
    meta[BOX_X0], meta[BOX_X1] = x0 + meta[TILE_X0], x1 + meta[TILE_X0]
    meta[BOX_Y0], meta[BOX_Y1] = y0 + meta[TILE_Y0], y1 + meta[TILE_Y0]
    meta[LOWEST], meta[HIGHEST] = min(meta[LOWEST], low), max(meta[HIGHEST], high)
    return x0 >= 0 and y0 >= 0 and x1 < meta[TILES_X] and y1 < meta[TILES_Y]


@njit(nogil=True, cache=True)
def mark_kept(keep: Any, first: Any, n: Any, work: Any) -> None:
    """Mark the n beams from `first` on that are to be used."""
    for j in range(np.uint64(n)):
        work[USED + j] = keep[np.uint64(first) + j]


@njit(nogil=True, cache=True)
def mark_inside(
    ranges: Any, keep: Any, directions: Any, seen: Any, first: Any, n: Any, work: Any
) -> Any:
    """Mark the n beams from `first` on that are to be used and hit inside the region.

    `seen` float32 (7, 3) is the region as beam 0 sees it (`region_from`), along its axes: the
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
        work[USED + j] = keep[i] & x & y & z
    low, high = np.uint64(0), np.uint64(n)
    while low < high and work[USED + low] == 0:
        low += _U1
    while low < high and work[USED + high - _U1] == 0:
        high -= _U1
    return np.int64(low), np.int64(high)


@njit(nogil=True, cache=True)
def place_beams(
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
    x0 = y0 = bottom = BEYOND
    x1 = y1 = top = -BEYOND
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
        used, tx, ty, h = quantise(
            work, j, work[USED + j] != 0, px * ticks, py * ticks, pz * ticks, depth, grid
        )
        x0, x1 = min(x0, tx if used else BEYOND), max(x1, tx if used else -BEYOND)
        y0, y1 = min(y0, ty if used else BEYOND), max(y1, ty if used else -BEYOND)
        bottom, top = min(bottom, h if used else BEYOND), max(top, h if used else -BEYOND)
    return widen(meta, x0, x1, y0, y1, bottom, top)
