"""Endpoints of beams in integer ticks, computed in vectorised blocks.

Blocks of `BLOCK` beams are computed in a scratch array with rows of that length: the compiler knows
the distance of the rows, hence that they do not overlap, and vectorises the loops. Indices are
unsigned: a signed index may be negative and count from the end, and this test alone prevents
vectorisation. Projecting 22,760 beams takes 0.05 ms; with a sine and a cosine of the tilt for each
beam it took 0.24 ms.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from tccm_ros.kernels import kernel
from tccm_ros.sensors.laser_scan_kernels import refine_poses

BLOCK = 512
"""Number of beams per block; its scratch rows fit in the first-level cache."""

# Rows of the scratch array, int32: whether the beam is used, its tile in the directory, its cell
# in the tile, its height in ticks, its position in the cell (x << 16 | y) and its depth in ticks.
USED, TILE_OF, CELL_OF, HEIGHT, IN_CELL, DEPTH_OF = (np.uint64(row * BLOCK) for row in range(6))

WORK_SIZE = 6 * BLOCK
"""Number of elements of the scratch array `work`, int32."""

SETTINGS = np.dtype(
    [
        ("ticks", np.float64),  # per metre
        ("cell_ticks", np.float64),  # edge of a cell
        ("depth", np.float64),  # minimum depth of a point's interval, ticks
        ("depth_per_range", np.float64),  # adaptive gap: per metre and rad; 0 = fixed
        ("max_depth", np.float64),  # ticks
        ("region_frame", np.int64),  # `RegionFrame`
        ("region", np.float64, 6),  # x_min x_max y_min y_max z_min z_max, m
        ("normal", np.float64, 3),  # of the previous scan's plane
        ("has_normal", np.bool_),
    ],
    align=True,
)
"""Settings of binning, and the plane of the previous scan for the adaptive gap."""

BLEND_ANGLE = 0.01
"""Maximum rotation between two poses of a scan, rad; poses are inserted above it, as blending
matrices would shorten a beam by the 80,000th part (angle^2 / 8)."""

FAR = 2**30
"""Points at this distance (107 km) from the origin or further are left out, ticks."""

# Adding 2^30 before truncation makes int32() a floor, for which processors have vector code.
_SHIFT = np.float64(FAR)
_UNSHIFT = np.int64(FAR)
_MAX_TICKS = np.float64(FAR - 1)

_U1 = np.uint64(1)
BEYOND = np.int64(2**40)
"""Larger than any tile index."""


class RegionFrame(IntEnum):
    """The frame of the region of interest."""

    NONE = 0
    ODOM = 1
    BASE = 2


class Beams(NamedTuple):
    """Beams of one scan.

    Attributes
    ----------
    ranges
        float32 (N,), m.
    keep
        bool (N,), mask of the valid beams.
    directions
        float32 (2, N), cosines and sines of the bearings.
    first, last
        Range of beams [first, last) to use.
    step
        Angle between neighbouring beams, rad.
    """

    ranges: Any
    keep: Any
    directions: Any
    first: Any
    last: Any
    step: Any


class ScanSegment(NamedTuple):
    """The part of a scan between two pose samples.

    Attributes
    ----------
    T0, T1
        float64 (3, 4), T_odom_laser at the ends; the matrices are blended linearly in between.
    f0, df
        Beam i is at the fraction ``f0 + df * i`` of the interval from T0 to T1.
    """

    T0: Any
    T1: Any
    f0: Any
    df: Any


@kernel
def _compose(n: Any, T_odom_base: Any, T_base_laser: Any) -> Any:
    """Return the first n T_odom_laser (n, 3, 4), and whether any rotates by over `BLEND_ANGLE`."""
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


@kernel
def poses_in_beams(
    stamps: Any, stamp: Any, period: Any, T_odom_base: Any, T_base_laser: Any
) -> Any:
    """Return the times of a scan's poses, in beams after the first, and T_odom_laser (K, 3, 4).

    Poses are inserted where they rotate by over `BLEND_ANGLE`. If all beams have one time, there is
    one pose.

    Parameters
    ----------
    stamps, stamp, period
        int64 (K,), stamps of the poses; int64, stamp of the first beam; time between beams. In ns.
    T_odom_base, T_base_laser
        float64 (K, 4, 4).
    """
    n = len(stamps) if period != 0.0 else 1
    times = np.zeros(n)
    for k in range(n):
        if n > 1:
            times[k] = (stamps[k] - stamp) / period
    T, coarse = _compose(n, T_odom_base, T_base_laser)
    if not coarse:
        return times, T
    square = np.zeros((n, 4, 4))
    square[:, :3] = T
    return refine_poses(times, square)


@kernel
def angle_between_lines(T: Any, settings: Any, step: Any) -> Any:
    """Return the larger of the angles between beams and to the previous scan's plane, rad.

    Parameters
    ----------
    T
        float64 (K, 3, 4), T_odom_laser at the pose samples of the scan.
    settings
        One element of `SETTINGS`.
    step
        Angle between neighbouring beams, rad.
    """
    if not settings.has_normal:
        return step
    square = 0.0
    for i in range(3):
        square += (T[len(T) // 2, i, 2] - settings.normal[i]) ** 2
    return max(step, np.sqrt(square))


@kernel
def region_in_segment(T_odom_base: Any, segment: Any, settings: Any, seen: Any) -> None:
    """Write the region of interest in the coordinates of a segment's beams.

    Parameters
    ----------
    T_odom_base
        float64 (K, 4, 4), at the pose samples of the scan.
    segment, settings
        `ScanSegment`, and one element of `SETTINGS`.
    seen
        float32 (7, 3), written: see `mark_inside`.
    """
    m = len(T_odom_base) // 2
    in_base = settings.region_frame == RegionFrame.BASE
    T0, T1, f0, df = segment
    for i in range(3):
        low, high = settings.region[2 * i], settings.region[2 * i + 1]
        seen[6, i] = 0.5 * (high - low)
        for c, column in enumerate((0, 1, 3)):
            row = (0, 1, 4)[c]
            at = move = 0.0
            for j in range(3):
                r = T_odom_base[m, j, i] if in_base else np.float64(i == j)
                begin = T0[j, column]
                if column == 3 and in_base:
                    begin -= T_odom_base[m, j, 3]
                change = T1[j, column] - T0[j, column]
                at += r * (begin + f0 * change)
                move += r * df * change
            if column == 3:
                at -= 0.5 * (low + high)
            seen[row, i] = at
            seen[(2, 3, 5)[c], i] = move


@kernel
def quantise(work: Any, j: Any, used: Any, px: Any, py: Any, pz: Any, depth: Any, grid: Any) -> Any:
    """Write a point in integer ticks, by tile, cell and position in the cell. Branch-free.

    Parameters
    ----------
    work, j
        int32 (WORK_SIZE,), column j is written.
    used
        Whether to use the point.
    px, py, pz, depth
        Point, and depth of its interval, ticks.
    grid
        Cells per tick, ticks per cell, and the directory's first tile (x, y) and width.

    Returns
    -------
    used, tx, ty
        Whether the point is used, and its tile in the directory.
    """
    per_tick, cell, tile_x0, tile_y0, tiles_y = grid
    used = used & (abs(px) < _MAX_TICKS) & (abs(py) < _MAX_TICKS) & (abs(pz) < _MAX_TICKS)
    # Unused points get a number that can be converted.
    px, py, pz = (px if used else 0.0), (py if used else 0.0), (pz if used else 0.0)
    x = np.int64(np.int32(px + (_SHIFT + 0.5))) - _UNSHIFT
    y = np.int64(np.int32(py + (_SHIFT + 0.5))) - _UNSHIFT
    z = np.int64(np.int32(pz + (_SHIFT + 0.5))) - _UNSHIFT
    # Half a tick keeps the product away from integers: this is exact floor division.
    ix = np.int64(np.int32((x + 0.5) * per_tick + _SHIFT)) - _UNSHIFT
    iy = np.int64(np.int32((y + 0.5) * per_tick + _SHIFT)) - _UNSHIFT
    tx, ty = (ix >> 6) - tile_x0, (iy >> 6) - tile_y0
    work[USED + j] = used
    work[TILE_OF + j] = tx * tiles_y + ty
    work[CELL_OF + j] = ((ix & 63) << 6) | (iy & 63)
    work[HEIGHT + j] = z
    work[IN_CELL + j] = ((x - ix * cell) << 16) | (y - iy * cell)
    work[DEPTH_OF + j] = np.int32(depth)
    return used, tx, ty


@kernel
def extend_box(counters: Any, x: Any, y: Any) -> Any:
    """Extend the bounding box of tiles by a block's.

    Parameters
    ----------
    counters
        Element of `tiles._COUNTERS`, updated.
    x, y
        Minimum and maximum of the block's tiles in the directory.

    Returns
    -------
    bool
        Whether the directory covers the block's tiles.
    """
    if x[0] > x[1]:
        return True
    counters.box_x0, counters.box_x1 = x[0] + counters.tile_x0, x[1] + counters.tile_x0
    counters.box_y0, counters.box_y1 = y[0] + counters.tile_y0, y[1] + counters.tile_y0
    return x[0] >= 0 and y[0] >= 0 and x[1] < counters.tiles_x and y[1] < counters.tiles_y


@kernel
def mark_kept(keep: Any, first: Any, n: Any, work: Any) -> None:
    """Mark the valid beams of a block.

    Parameters
    ----------
    keep
        bool (N,), mask of the scan's valid beams.
    first, n
        First beam and length of the block.
    work
        int32 (WORK_SIZE,), row USED is written.
    """
    for j in range(np.uint64(n)):
        work[USED + j] = keep[np.uint64(first) + j]


@kernel
def mark_inside(beams: Any, seen: Any, first: Any, n: Any, work: Any) -> Any:
    """Mark the valid beams of a block whose hits are inside the region.

    Parameters
    ----------
    beams
        The scan.
    seen
        float32 (7, 3), the region at beam 0 (`region_in_segment`), along its axes: the laser's x
        and y axis, the change of both per beam, the laser's position relative to the region's
        centre, its change per beam, and half the region's size.
    first, n
        First beam and length of the block.
    work
        int32 (WORK_SIZE,), row USED is written.

    Returns
    -------
    low, high
        Index in the block of the first marked beam, and one past the last.
    """
    a0, a1, a2 = seen[0, 0], seen[0, 1], seen[0, 2]
    b0, b1, b2 = seen[1, 0], seen[1, 1], seen[1, 2]
    c0, c1, c2 = seen[2, 0], seen[2, 1], seen[2, 2]
    d0, d1, d2 = seen[3, 0], seen[3, 1], seen[3, 2]
    p0, p1, p2 = seen[4, 0], seen[4, 1], seen[4, 2]
    q0, q1, q2 = seen[5, 0], seen[5, 1], seen[5, 2]
    h0, h1, h2 = seen[6, 0], seen[6, 1], seen[6, 2]
    ranges, keep = beams.ranges, beams.keep
    cosines, sines = beams.directions[0], beams.directions[1]
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


@kernel
def project_beams(
    beams: Any, segment: Any, growth: Any, settings: Any, block: Any, work: Any, counters: Any
) -> Any:
    """Compute the endpoints of a block's beams.

    They are computed in float32 relative to the laser, exact to a micrometre; the laser's position
    is added in float64.

    Parameters
    ----------
    beams, segment
        The scan, and its segment between two pose samples.
    growth
        Depth of a point's interval per metre of range, ticks.
    settings
        One element of `SETTINGS`.
    block
        (first, low, high): the beams first + [low, high).
    work
        int32 (WORK_SIZE,), written.
    counters
        Element of `tiles._COUNTERS`, updated.

    Returns
    -------
    bool
        Whether the directory covers all tiles of the block.
    """
    T0, T1, f0, df = segment
    first, low, high = block
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
    ranges, cosines, sines = beams.ranges, beams.directions[0], beams.directions[1]
    ticks, min_depth, max_depth = settings.ticks, settings.depth, settings.max_depth
    grid = (
        1.0 / settings.cell_ticks, np.int64(settings.cell_ticks),
        counters.tile_x0, counters.tile_y0, counters.tiles_y,
    )  # fmt: skip
    x0 = y0 = BEYOND
    x1 = y1 = -BEYOND
    for j in range(np.uint64(low), np.uint64(high)):
        i = np.uint64(first) + j
        number = np.int32(i)
        r, f = ranges[i], g0 + dg * np.float32(number)
        u, v = r * cosines[i], r * sines[i]
        x = (a00 + f * b00) * u + (a01 + f * b01) * v
        y = (a10 + f * b10) * u + (a11 + f * b11) * v
        z = (a20 + f * b20) * u + (a21 + f * b21) * v
        px, py, pz = x + (ox + dx * number), y + (oy + dy * number), z + (oz + dz * number)
        depth = growth * r
        depth = depth if depth > min_depth else min_depth
        depth = depth if depth < max_depth else max_depth
        used, tx, ty = quantise(
            work, j, work[USED + j] != 0, px * ticks, py * ticks, pz * ticks, depth, grid
        )
        x0, x1 = min(x0, tx if used else BEYOND), max(x1, tx if used else -BEYOND)
        y0, y1 = min(y0, ty if used else BEYOND), max(y1, ty if used else -BEYOND)
    return extend_box(counters, (x0, x1), (y0, y1))
