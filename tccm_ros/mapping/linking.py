"""Which cuboids of a surface hang together, when beams leave empty cells between scan lines.

Each cuboid looks back along its row (-y) and its column (-x) for the nearest cuboid of the same
surface. The typical step between them is the local sample spacing, per patch and direction; a step
is a link if it is shorter than twice that spacing. Where every cell is filled the spacing is one
cell, and this is the paper's 8-neighbourhood (IV.A).
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["accept_links", "find_links", "is_deep", "link", "link_eight", "patches_of"]

Array = NDArray[np.float64]
Int = NDArray[np.int32]

PATCH_BITS = 4
"""A patch in which the spacing is estimated is 2**4 cells wide."""

STEPS = 32
"""Steps of this many cells and more are no links."""

OBSTACLES = 3
"""A search ends behind so many occupied cells that hold nothing of the same height: whatever lies
further off is not a neighbour. Without it a wall's cells, which have no neighbours at all, cost
most of the time."""


@njit(nogil=True, cache=True)
def root_of(parent: Int, i: int) -> int:
    """Return the representative of i, halving the path on the way."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(nogil=True, cache=True)
def join(parent: Int, i: int, j: int) -> None:
    """Unite the sets of i and j under the smaller index."""
    a, b = parent[i], parent[j]
    if a == b:
        return
    a, b = root_of(parent, a), root_of(parent, b)
    if a < b:
        parent[b] = a
    elif b < a:
        parent[a] = b


@njit(nogil=True, cache=True)
def is_level(top: Int, mean: Int, i: int, j: int, limit: int) -> bool:
    """Tell whether two cuboids have the same height: by their tops or by their means."""
    return abs(top[i] - top[j]) < limit or abs(mean[i] - mean[j]) < limit


@njit(nogil=True, cache=True)
def find_links(
    ix: Int, iy: Int, top: Int, mean: Int, threshold: float, parent: Int
) -> tuple[Int, Int]:
    """Find for each cuboid the nearest one of the same height behind it in its column and its row.

    Cuboids in one cell, and cells that touch at a corner only, are joined in `parent` at once.

    Returns
    -------
    back_x, back_y
        int32 (N,), indices, -1 for none.
    """
    n = len(ix)
    limit = int(np.ceil(threshold))
    low_y = iy.min()
    # Chains of the cuboids of each column, newest first.
    last = np.full(iy.max() - low_y + 3, -1, np.int32)
    before = np.empty(n, np.int32)
    back_x, back_y = np.full(n, -1, np.int32), np.full(n, -1, np.int32)
    row = 0
    for i in range(n):
        x, y = ix[i], iy[i]
        if ix[row] != x:
            row = i
        j, cell, passed = i - 1, y, 0
        while j >= row and y - iy[j] < STEPS:
            if iy[j] != cell:
                cell = iy[j]
                passed += 1
                if passed > OBSTACLES:
                    break
            if is_level(top, mean, i, j, limit):
                back_y[i] = j
                if cell == y:
                    join(parent, i, j)
                    back_y[i] = back_y[j]
                break
            j -= 1
        c = y - low_y + 1
        j = last[c]
        before[i] = j
        last[c] = i
        cell, passed = x, 0
        while j >= 0 and x - ix[j] < STEPS:
            if ix[j] != cell:
                cell = ix[j]
                passed += 1
                if passed > OBSTACLES:
                    break
            if cell != x and is_level(top, mean, i, j, limit):
                back_x[i] = j
                break
            j = before[j]
        # The cell behind in the column leads to both corners, that in the row to the nearer one.
        if back_x[i] < 0 or x - ix[back_x[i]] > 1:
            join_corner(ix, top, mean, limit, before, last[c + 1], i, parent)
            if back_y[i] < 0 or y - iy[back_y[i]] > 1:
                join_corner(ix, top, mean, limit, before, last[c - 1], i, parent)
    return back_x, back_y


@njit(nogil=True, cache=True)
def join_corner(
    ix: Int, top: Int, mean: Int, limit: int, before: Int, j: int, i: int, parent: Int
) -> None:
    """Join cuboid i to one of its height in the next column and the row behind, j and before."""
    while j >= 0 and ix[i] - ix[j] < 2:
        if ix[j] != ix[i] and is_level(top, mean, i, j, limit):
            join(parent, i, j)
            return
        j = before[j]


@njit(nogil=True, cache=True)
def spacing(histogram: Int, fallback: float) -> float:
    """Return the typical step of a histogram of steps: the mean of those up to 1.5 x the median.

    A few long steps, over a gap or a missing return, must not raise it. `fallback` is returned
    where there are fewer than four steps.
    """
    total = 0
    for k in range(STEPS):
        total += histogram[k]
    if total < 4:
        return fallback
    below, median = 0, 0
    while 2 * (below + histogram[median]) < total:
        below += histogram[median]
        median += 1
    steps, weight = 0, 0
    for k in range(min(STEPS, median + (median + 1) // 2 + 1)):
        steps += histogram[k]
        weight += histogram[k] * k
    return weight / steps


@njit(nogil=True, cache=True)
def accept_links(cell: Int, patch: Int, patches: int, back: Int, parent: Int) -> Array:
    """Keep the links along one axis that are shorter than twice the local spacing, and join them.

    Returns the local spacing of each patch along the axis, cells.

    Parameters
    ----------
    cell
        int32 (N,), coordinate along the axis.
    patch
        int32 (N,), patch of each cuboid; `patches` is their number.
    back
        int32 (N,), of `find_links`; rejected links become -1.
    parent
        int32 (N,), joined.
    """
    histogram = np.zeros((patches + 1, STEPS), np.int32)
    for i in range(len(cell)):
        if back[i] >= 0:
            histogram[patch[i], cell[i] - cell[back[i]]] += 1
    for p in range(patches):
        histogram[patches] += histogram[p]
    overall = spacing(histogram[patches], 1.0)
    usual = np.empty(patches)
    for p in range(patches):
        usual[p] = max(spacing(histogram[p], overall), 1.0)
    for i in range(len(cell)):
        if back[i] >= 0:
            if cell[i] - cell[back[i]] < 2.0 * usual[patch[i]]:
                join(parent, i, back[i])
            else:
                back[i] = -1
    return usual


@njit(nogil=True, cache=True)
def patches_of(ix: Int, iy: Int) -> tuple[Int, int]:
    """Return the patch of each cell, sorted by (ix, iy), and the number of patches."""
    n = len(ix)
    low_x, low_y = ix[0], iy.min()
    wide = ((iy.max() - low_y) >> PATCH_BITS) + 1
    patch = np.empty(n, np.int32)
    for i in range(n):
        patch[i] = ((ix[i] - low_x) >> PATCH_BITS) * wide + ((iy[i] - low_y) >> PATCH_BITS)
    return patch, (((ix[n - 1] - low_x) >> PATCH_BITS) + 1) * wide


@njit(nogil=True, cache=True)
def link(ix: Int, iy: Int, top: Int, mean: Int, threshold: float) -> tuple[Int, Int, Int]:
    """Label the connected sets of cuboids.

    Parameters
    ----------
    ix, iy
        int32 (N,), N > 0, cells, sorted by (ix, iy).
    top, mean
        int32 (N,), ticks: neighbours are linked only if one of the two differs by less than
        `threshold`.
    threshold
        Ticks.

    Returns
    -------
    root : int32 (N,)
        The smallest index of each cuboid's set.
    back_x, back_y : int32 (N,)
        The links.
    """
    n = len(ix)
    parent = np.arange(n).astype(np.int32)
    back_x, back_y = find_links(ix, iy, top, mean, threshold, parent)
    patch, patches = patches_of(ix, iy)
    accept_links(ix, patch, patches, back_x, parent)
    accept_links(iy, patch, patches, back_y, parent)
    for i in range(n):
        parent[i] = root_of(parent, i)
    return parent, back_x, back_y


@njit(nogil=True, cache=True)
def is_deep(back_x: Int, back_y: Int) -> NDArray[np.bool_]:
    """Tell which cuboids are at least two links inside their set, from the links of `link`."""
    n = len(back_x)
    sides = np.zeros(n, np.int32)
    for i in range(n):
        if back_x[i] >= 0:
            sides[i] |= 1
            sides[back_x[i]] |= 2
        if back_y[i] >= 0:
            sides[i] |= 4
            sides[back_y[i]] |= 8
    deep = sides == 15
    for i in range(n):
        for j in (back_x[i], back_y[i]):
            if j >= 0:
                deep[i] &= sides[j] == 15
                deep[j] &= sides[i] == 15
    return deep


@njit(nogil=True, cache=True)
def link_eight(ix: Int, iy: Int, top: Int, threshold: float) -> Int:
    """Label the connected sets of touching cells, as published (IV.A).

    Parameters
    ----------
    ix, iy, top, threshold
        As in `link`.

    Returns
    -------
    int32 (N,): the smallest index of each cuboid's set.
    """
    n = len(ix)
    parent = np.arange(n).astype(np.int32)
    # One pointer follows the cells (x - 1, y - 1) of the sorted list.
    side = 0
    for i in range(n):
        while ix[side] < ix[i] - 1 or (ix[side] == ix[i] - 1 and iy[side] < iy[i] - 1):
            side += 1
        j = side
        while ix[j] == ix[i] - 1 and iy[j] <= iy[i] + 1:
            if abs(top[j] - top[i]) < threshold:
                join(parent, i, j)
            j += 1
        j = i - 1
        while j >= 0 and ix[j] == ix[i] and iy[j] >= iy[i] - 1:
            if iy[j] == iy[i] - 1 and abs(top[j] - top[i]) < threshold:
                join(parent, i, j)
            j -= 1
    for i in range(n):
        parent[i] = root_of(parent, i)
    return parent
