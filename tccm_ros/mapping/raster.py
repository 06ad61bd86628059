"""Rings around measured cells: gaps between samples are filled, edges are found within a cell.

A raster cell knows how far its points reach. Cells are linked as in `linking`, so a gap shorter
than twice the local sample spacing is filled and a longer one stays open. The rings run through the
middles of the cells' outer sides, each side moved to where the surface is expected to end: at the
reach of the points, or half a sample spacing beyond the last sample.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tccm_ros.mapping.linking import STEPS, accept_links, find_links, patches_of

__all__ = ["cells_lying", "cells_standing", "rings_around"]

Array = NDArray[np.float64]
Int = NDArray[np.int32]
Index = NDArray[np.int64]

ROOT3 = 1.7320508075688772
"""Half the length of a uniform spread, in standard deviations."""

FILLED = -2
"""A cell that lies between linked samples; -1 is empty, others are indices of samples."""


@njit(nogil=True, cache=True)
def widen(reach: Array, a: float, b: float, spread_a: float, spread_b: float) -> None:
    """Let the reach of a cell, (4,): low a, high a, low b, high b, take in a cuboid's points."""
    reach[0] = min(reach[0], a - spread_a)
    reach[1] = max(reach[1], a + spread_a)
    reach[2] = min(reach[2], b - spread_b)
    reach[3] = max(reach[3], b + spread_b)


@njit(nogil=True, cache=True)
def cells_lying(
    s: Array,
    S: Array,
    count: Array,
    ix: Int,
    iy: Int,
    members: Index,
    size: float,
    coarse: int,
) -> tuple[Int, Int, Array]:
    """Return the raster cells of a lying plane's cuboids: the map's, or 2**coarse times as wide.

    Parameters
    ----------
    s, S, count, ix, iy
        As in `Cuboids`.
    members
        int64 (M,), M > 0.
    size
        Edge of a cell, ticks.

    Returns
    -------
    a, b : int32 (K,)
        Cells, sorted.
    reach : float64 (K, 4)
        Low and high a, low and high b of the points, in cells.
    """
    low_a, high_a = ix[members].min() >> coarse, ix[members].max() >> coarse
    low_b, high_b = iy[members].min() >> coarse, iy[members].max() >> coarse
    index = np.full((high_a - low_a + 1, high_b - low_b + 1), -1, np.int32)
    reach = np.empty((len(members), 4))
    reach[:, 0::2], reach[:, 1::2] = np.inf, -np.inf
    scale = 1.0 / (1 << coarse)
    used = 0
    for i in members:
        a, b = (ix[i] >> coarse) - low_a, (iy[i] >> coarse) - low_b
        if index[a, b] < 0:
            index[a, b] = used
            used += 1
        n = count[i]
        x, y = s[i, 0] / n, s[i, 1] / n
        spread_x = ROOT3 * np.sqrt(max(S[i, 0] / n - x * x, 0.0))
        spread_y = ROOT3 * np.sqrt(max(S[i, 3] / n - y * y, 0.0))
        widen(
            reach[index[a, b]], (ix[i] + x / size) * scale, (iy[i] + y / size) * scale,
            spread_x / size * scale, spread_y / size * scale,
        )  # fmt: skip
    return sorted_cells(index, reach, low_a, low_b)


@njit(nogil=True, cache=True)
def cells_standing(u: Array, spread_u: Array, low: Array, high: Array) -> tuple[Int, Int, Array]:
    """Return the raster cells of a standing plane's cuboids: columns along u, all lengths in cells.

    Parameters
    ----------
    u, spread_u
        float64 (M,), middle and half width of each cuboid's points along the level direction.
    low, high
        float64 (M,), heights of its lowest and highest point.

    Returns
    -------
    As `cells_lying`, with a along u and b upwards.
    """
    low_a, low_b = int(np.floor(u.min())), int(np.floor(low.min()))
    index = np.full(
        (int(np.floor(u.max())) - low_a + 1, int(np.floor(high.max())) - low_b + 1), -1, np.int32
    )
    reach = np.empty((index.size, 4))
    reach[:, 0::2], reach[:, 1::2] = np.inf, -np.inf
    used = 0
    for k in range(len(u)):
        a = int(np.floor(u[k])) - low_a
        for b in range(int(np.floor(low[k])) - low_b, int(np.floor(high[k])) - low_b + 1):
            if index[a, b] < 0:
                index[a, b] = used
                used += 1
            bottom, top = max(low[k], b + low_b), min(high[k], b + low_b + 1.0)
            middle = 0.5 * (bottom + top)
            widen(reach[index[a, b]], u[k], middle, spread_u[k], middle - bottom)
    return sorted_cells(index, reach, low_a, low_b)


@njit(nogil=True, cache=True)
def sorted_cells(index: Int, reach: Array, low_a: int, low_b: int) -> tuple[Int, Int, Array]:
    """Return the cells that have an index, in order, with the reach of each."""
    count = 0
    for a in range(index.shape[0]):
        for b in range(index.shape[1]):
            count += index[a, b] >= 0
    out_a, out_b = np.empty(count, np.int32), np.empty(count, np.int32)
    out = np.empty((count, 4))
    k = 0
    for a in range(index.shape[0]):
        for b in range(index.shape[1]):
            if index[a, b] >= 0:
                out_a[k], out_b[k] = a + low_a, b + low_b
                out[k] = reach[index[a, b]]
                k += 1
    return out_a, out_b, out


@njit(nogil=True, cache=True)
def rings_around(a: Int, b: Int, reach: Array) -> tuple[Array, Int]:
    """Return the rings around cells.

    Parameters
    ----------
    a, b, reach
        Of `cells_lying` or `cells_standing`.

    Returns
    -------
    vertices : float64 (V, 2)
        In cells; outer rings counter-clockwise, holes clockwise.
    ends : int32 (R,)
        Where each ring ends in `vertices`.
    """
    n = len(a)
    parent = np.arange(n).astype(np.int32)
    level = np.zeros(n, np.int32)
    back_a, back_b = find_links(a, b, level, level, 1.0, parent)
    patch, patches = patches_of(a, b)
    usual_a = accept_links(a, patch, patches, back_a, parent)
    usual_b = accept_links(b, patch, patches, back_b, parent)
    for i in range(n):
        extend(reach[i], usual_a[patch[i]], usual_b[patch[i]])
    # One empty cell around, so that every side of a cell has a neighbour.
    low_a, low_b = a[0] - 1, b.min() - 1
    grid = np.full((a[n - 1] - low_a + 2, b.max() - low_b + 2), -1, np.int32)
    for i in range(n):
        x, y = a[i] - low_a, b[i] - low_b
        if back_a[i] >= 0:
            for k in range(a[back_a[i]] - low_a + 1, x):
                grid[k, y] = grid[k, y] if grid[k, y] >= 0 else FILLED
        if back_b[i] >= 0:
            for k in range(b[back_b[i]] - low_b + 1, y):
                grid[x, k] = grid[x, k] if grid[x, k] >= 0 else FILLED
        grid[x, y] = i
    # Scan lines whose samples stand in turn leave combs: close along the other axis too.
    close_rows(grid, usual_b.max())
    close_rows(grid.T, usual_a.max())
    return trace(grid, reach, low_a, low_b)


@njit(nogil=True, cache=True)
def close_rows(grid: Int, usual: float) -> None:
    """Fill gaps of a row that are shorter than twice the sample spacing."""
    for a in range(grid.shape[0]):
        last = -STEPS
        for b in range(grid.shape[1]):
            if grid[a, b] != -1:
                if 1 < b - last < 2.0 * usual:
                    grid[a, last + 1 : b] = FILLED
                last = b


@njit(nogil=True, cache=True)
def extend(reach: Array, usual_a: float, usual_b: float) -> None:
    """Extend a reach to half a sample spacing beyond the middle, where samples are sparse."""
    for axis, usual in ((0, usual_a), (2, usual_b)):
        if usual > 1.2:
            middle = 0.5 * (reach[axis] + reach[axis + 1])
            reach[axis] = min(reach[axis], middle - 0.5 * usual)
            reach[axis + 1] = max(reach[axis + 1], middle + 0.5 * usual)


@njit(nogil=True, cache=True)
def trace(grid: Int, reach: Array, low_a: int, low_b: int) -> tuple[Array, Int]:
    """Walk around all sets of full cells, the full side on the left; cells that touch at a corner
    only are apart.
    """
    rows, columns = grid.shape
    done = np.zeros((rows, columns), np.bool_)  # sides that run in +a, below their cell
    most = 4 * (grid != -1).sum()
    vertices, ends = np.empty((most, 2)), np.empty(most // 4 + 1, np.int32)
    used, rings = 0, 0
    for a0 in range(1, rows):
        for b0 in range(1, columns):
            if grid[a0, b0] == -1 or grid[a0, b0 - 1] != -1 or done[a0, b0]:
                continue
            # A corner (a, b) is the low corner of cell (a, b); heading 0 +a, 1 +b, 2 -a, 3 -b.
            a, b, heading = a0, b0, 0
            while True:
                if heading == 0:
                    if done[a, b]:
                        break
                    done[a, b] = True
                    ca, cb = a, b
                    a += 1
                elif heading == 1:
                    ca, cb = a - 1, b
                    b += 1
                elif heading == 2:
                    ca, cb = a - 1, b - 1
                    a -= 1
                else:
                    ca, cb = a, b - 1
                    b -= 1
                vertices[used] = side_of(grid[ca, cb], reach, heading, ca + low_a, cb + low_b)
                used += 1
                # Ahead left and ahead right of the corner that was reached.
                if heading == 0:
                    left, right = grid[a, b] != -1, grid[a, b - 1] != -1
                elif heading == 1:
                    left, right = grid[a - 1, b] != -1, grid[a, b] != -1
                elif heading == 2:
                    left, right = grid[a - 1, b - 1] != -1, grid[a - 1, b] != -1
                else:
                    left, right = grid[a, b - 1] != -1, grid[a - 1, b - 1] != -1
                if not left:
                    heading = (heading + 1) % 4
                elif right:
                    heading = (heading + 3) % 4
            ends[rings] = used
            rings += 1
    return vertices[:used], ends[:rings]


@njit(nogil=True, cache=True)
def side_of(sample: int, reach: Array, heading: int, a: int, b: int) -> Array:
    """Return the middle of a cell's outer side, moved to where the surface ends."""
    point = np.empty(2)
    point[0], point[1] = a + 0.5, b + 0.5
    if sample < 0:
        return point
    if heading == 0:
        point[1] = reach[sample, 2]
    elif heading == 1:
        point[0] = reach[sample, 1]
    elif heading == 2:
        point[1] = reach[sample, 3]
    else:
        point[0] = reach[sample, 0]
    return point
