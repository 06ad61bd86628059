"""The nearest cuboid of the same height behind each cuboid, in its row (-y) and its column (-x)."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["OBSTACLES", "STEPS", "find_links", "find_links_in_plane"]

Int = NDArray[np.int32]

STEPS = 32
"""Steps of this many cells and more are no links."""

OBSTACLES = 3
"""A search ends behind so many occupied cells that hold nothing of the same height: whatever lies
further off is not a neighbour. Without it a wall's cells, which have no neighbours at all, cost
most of the time."""


@njit(nogil=True, cache=True)
def is_level(top: Int, mean: Int, i: int, j: int, limit: int) -> bool:
    """Tell whether two cuboids have the same height: by their tops or by their means."""
    return (abs(top[i] - top[j]) < limit) | (abs(mean[i] - mean[j]) < limit)


@njit(nogil=True, cache=True)
def find_links(ix: Int, iy: Int, top: Int, mean: Int, threshold: float) -> tuple[Int, Int, Int]:
    """Find for each cuboid the nearest one of the same height behind it in its column and its row.

    Returns
    -------
    back_x, back_y
        int32 (N,), indices, -1 for none.
    touching
        int32 (T, 2), pairs of cuboids of the same height that belong together whatever the spacing:
        in one cell, or in cells that touch at a corner only.
    """
    n = len(ix)
    limit = int(np.ceil(threshold))
    low_y = iy.min()
    # Chains of the cuboids of each column, newest first.
    last = np.full(iy.max() - low_y + 3, -1, np.int32)
    before = np.empty(n, np.int32)
    back_x, back_y = np.empty(n, np.int32), np.empty(n, np.int32)
    touching, pairs = np.empty((3 * n, 2), np.int32), 0
    row, row_x = 0, ix[0]
    for i in range(n):
        x, y = ix[i], iy[i]
        if x != row_x:
            row, row_x = i, x
        found_y, gap_y = -1, STEPS
        j, cell, passed = i - 1, y, 0
        while j >= row:
            if iy[j] != cell:
                cell = iy[j]
                passed += 1
                if passed > OBSTACLES or y - cell >= STEPS:
                    break
            if is_level(top, mean, i, j, limit):
                found_y = j
                if cell == y:
                    touching[pairs, 0], touching[pairs, 1] = i, j
                    pairs += 1
                    found_y = back_y[j]
                if found_y >= 0:
                    gap_y = y - iy[found_y]
                break
            j -= 1
        back_y[i] = found_y
        c = y - low_y + 1
        j = last[c]
        before[i] = j
        last[c] = i
        found_x, gap_x = -1, STEPS
        cell, passed = x, 0
        while j >= 0:
            if ix[j] != cell:
                cell = ix[j]
                passed += 1
                if passed > OBSTACLES or x - cell >= STEPS:
                    break
            if cell != x and is_level(top, mean, i, j, limit):
                found_x, gap_x = j, x - cell
                break
            j = before[j]
        back_x[i] = found_x
        # The cell behind in the column leads to both corners, that in the row to the nearer one.
        if gap_x > 1:
            j = level_corner(ix, top, mean, limit, before, last[c + 1], i)
            if j >= 0:
                touching[pairs, 0], touching[pairs, 1] = i, j
                pairs += 1
            if gap_y > 1:
                j = level_corner(ix, top, mean, limit, before, last[c - 1], i)
                if j >= 0:
                    touching[pairs, 0], touching[pairs, 1] = i, j
                    pairs += 1
    return back_x, back_y, touching[:pairs]


@njit(nogil=True, cache=True)
def level_corner(ix: Int, top: Int, mean: Int, limit: int, before: Int, j: int, i: int) -> int:
    """Return a cuboid of the height of i in the row behind, j or before it in its column, or -1."""
    while j >= 0 and ix[i] - ix[j] < 2:
        if ix[j] != ix[i] and is_level(top, mean, i, j, limit):
            return j
        j = before[j]
    return -1


@njit(nogil=True, cache=True)
def find_links_in_plane(ix: Int, iy: Int) -> tuple[Int, Int, Int]:
    """Find the links of cuboids that all lie in one plane: as `find_links` where all is level."""
    n = len(ix)
    low_y = iy.min()
    last = np.full(iy.max() - low_y + 3, -1, np.int32)
    # The row of the last cuboid of each column; far behind where there is none.
    last_x = np.full(len(last), ix[0] - STEPS, np.int32)
    back_x, back_y = np.empty(n, np.int32), np.empty(n, np.int32)
    touching, pairs = np.empty((3 * n, 2), np.int32), 0
    before_x, before_y = ix[0] - 1, 0
    for i in range(n):
        x, y = ix[i], iy[i]
        c = y - low_y + 1
        gap_y = y - before_y if x == before_x else STEPS
        before_x, before_y = x, y
        if gap_y == 0:
            touching[pairs, 0], touching[pairs, 1] = i, i - 1
            pairs += 1
            back_x[i], back_y[i] = back_x[i - 1], back_y[i - 1]
            last[c] = i
            continue
        back_y[i] = i - 1 if gap_y < STEPS else -1
        gap_x = x - last_x[c]
        back_x[i] = last[c] if gap_x < STEPS else -1
        last[c], last_x[c] = i, x
        if gap_x > 1:
            if x - last_x[c + 1] == 1:
                touching[pairs, 0], touching[pairs, 1] = i, last[c + 1]
                pairs += 1
            if gap_y > 1 and x - last_x[c - 1] == 1:
                touching[pairs, 0], touching[pairs, 1] = i, last[c - 1]
                pairs += 1
    return back_x, back_y, touching[:pairs]
