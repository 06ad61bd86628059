"""Connected components of a surface's cuboids, with empty cells between scan lines.

For each cuboid, the nearest previous one of the same surface is found in its row (-y) and its
column (-x). The typical step between them is the local sample spacing, per patch and direction; a
step is a link if it is shorter than twice that spacing. If every cell is occupied, the spacing is
one cell, and this is the paper's 8-neighbourhood (IV.A). Noise spreads a scan line over adjacent
cells, so that most steps are within lines; if many steps are longer, these are the line distance.
"""

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int32, UInt8
from tccm_ros.kernels import kernel
from tccm_ros.union_find import merge_sets

PATCH_BITS = 4
"""Width of a patch for the spacing estimate: 2**4 cells. Chosen: 32 cm at 20 mm."""

LINE_STEPS = 0.25
"""Minimum fraction of steps longer than two cells for which they are the distance of scan lines.
Chosen: noise spreads lines over two or three cells; a step over a gap between tables is one of
many.
"""

LINE_GAP = 1.5
"""Maximum length of a link in line distances. Chosen: less than two, as a missing line may be a
gap.
"""

ALL_SIDES = 15
"""Bits of all four sides on which a cuboid may have links."""

STEPS = 32
"""Steps of this many cells or more are no links. Chosen: 64 cm at 20 mm."""

OBSTACLES = 3
"""A search stops after this many occupied cells without a cuboid of the same height, as further
ones are no neighbours. Without this limit, the cells of walls, which have no neighbours, take most
of the time. Chosen."""


@kernel
def has_same_height(top: Int32, mean: Int32, i: int, j: int, limit: int) -> bool:
    """Return whether two cuboids have the same height, by their tops or their means.

    Parameters
    ----------
    top, mean
        int32 (N,), ticks.
    i, j
        Indices of the cuboids.
    limit
        Upper limit of a difference, ticks.
    """
    return (abs(top[i] - top[j]) < limit) | (abs(mean[i] - mean[j]) < limit)


@kernel
def find_links(
    ix: Int32, iy: Int32, top: Int32, mean: Int32, threshold: float
) -> tuple[Int32, Int32, Int32]:
    """Return for each cuboid the nearest previous one of the same height in its column and row.

    Parameters
    ----------
    ix, iy, top, mean, threshold
        As in `link`.

    Returns
    -------
    back_x, back_y
        int32 (N,), indices, -1 for none.
    touching
        int32 (T, 2), pairs of cuboids of the same height that are connected whatever the spacing:
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
    row = 0
    for i in range(n):
        if ix[i] != ix[row]:
            row = i
        j = nearest_in_row(iy, top, mean, limit, row, i)
        if j >= 0 and iy[j] == iy[i]:
            pairs = add_pair(touching, pairs, i, j)
            j = back_y[j]
        back_y[i] = j
        gap_y = iy[i] - iy[j] if j >= 0 else STEPS
        c = iy[i] - low_y + 1
        before[i] = last[c]
        last[c] = i
        j = nearest_in_column(ix, top, mean, limit, before, i)
        back_x[i] = j
        gap_x = ix[i] - ix[j] if j >= 0 else STEPS
        # A previous cell in the column connects both corners, one in the row the nearer corner.
        if gap_x > 1:
            j = corner_of_same_height(ix, top, mean, limit, before, last[c + 1], i)
            pairs = add_pair(touching, pairs, i, j)
            if gap_y > 1:
                j = corner_of_same_height(ix, top, mean, limit, before, last[c - 1], i)
                pairs = add_pair(touching, pairs, i, j)
    return back_x, back_y, touching[:pairs]


@kernel
def nearest_in_row(iy: Int32, top: Int32, mean: Int32, limit: int, row: int, i: int) -> int:
    """Return the nearest previous cuboid of the same height in the row of a cuboid, -1 for none.

    It may be in the same cell. The search stops after `STEPS` cells or `OBSTACLES`.

    Parameters
    ----------
    iy, top, mean
        As in `link`.
    limit
        As in `has_same_height`.
    row
        First cuboid of the row.
    i
        Index of the cuboid.
    """
    y = iy[i]
    cell, passed, j = y, 0, i - 1
    while j >= row:
        if iy[j] != cell:
            cell = iy[j]
            passed += 1
            if passed > OBSTACLES or y - cell >= STEPS:
                return -1
        if has_same_height(top, mean, i, j, limit):
            return j
        j -= 1
    return -1


@kernel
def nearest_in_column(ix: Int32, top: Int32, mean: Int32, limit: int, before: Int32, i: int) -> int:
    """Return the nearest previous cuboid of the same height in a cuboid's column, -1 for none.

    It is in another cell. The search stops after `STEPS` cells or `OBSTACLES`.

    Parameters
    ----------
    ix, top, mean
        As in `link`.
    limit
        As in `has_same_height`.
    before
        int32 (N,), previous cuboid of each one in its column, -1 for none.
    i
        Index of the cuboid.
    """
    x = ix[i]
    cell, passed, j = x, 0, before[i]
    while j >= 0:
        if ix[j] != cell:
            cell = ix[j]
            passed += 1
            if passed > OBSTACLES or x - cell >= STEPS:
                return -1
        if cell != x and has_same_height(top, mean, i, j, limit):
            return j
        j = before[j]
    return -1


@kernel
def add_pair(touching: Int32, pairs: int, i: int, j: int) -> int:
    """Append a pair of cuboids unless `j` is -1; return the number of pairs.

    Parameters
    ----------
    touching, pairs
        int32 (.., 2), updated: the pairs; and their number.
    i, j
        Indices of the cuboids.
    """
    if j < 0:
        return pairs
    touching[pairs, 0], touching[pairs, 1] = i, j
    return pairs + 1


@kernel
def corner_of_same_height(
    ix: Int32, top: Int32, mean: Int32, limit: int, before: Int32, j: int, i: int
) -> int:
    """Return a cuboid of the same height in the previous row of a column, -1 for none.

    Parameters
    ----------
    ix, top, mean
        As in `link`.
    limit
        As in `has_same_height`.
    before
        int32 (N,), previous cuboid of each one in its column, -1 for none.
    j
        Last cuboid of the column to search, -1 for none.
    i
        Index of the cuboid.
    """
    while j >= 0 and ix[i] - ix[j] < 2:
        if ix[j] != ix[i] and has_same_height(top, mean, i, j, limit):
            return j
        j = before[j]
    return -1


@kernel
def find_links_in_plane(ix: Int32, iy: Int32) -> tuple[Int32, Int32, Int32]:
    """Return the links of cuboids of one plane: as `find_links` with equal heights."""
    n = len(ix)
    low_y = iy.min()
    last = np.full(iy.max() - low_y + 3, -1, np.int32)
    # Row of the last cuboid of each column; far back if there is none.
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


@kernel
def spacing(histogram: Int32, fallback: float) -> float:
    """Return the typical step of a histogram of steps: the mean of those up to 1.5 x the median.

    A few long steps, over a gap or a missing return, do not increase it. `fallback` is returned for
    fewer than four steps.
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


@kernel
def line_distance(histogram: Int32) -> int:
    """Return the distance of scan lines that are more than one cell wide, cells; 0 for none.

    It is the upper quartile of the steps, if most are one cell and a fraction of `LINE_STEPS` is
    longer than two.
    """
    total = 0
    for k in range(1, STEPS):
        total += histogram[k]
    if total < 4 or 2 * histogram[1] < total:
        return 0
    below, upper = 0, 1
    while below + histogram[upper] <= (1.0 - LINE_STEPS) * total:
        below += histogram[upper]
        upper += 1
    return upper if upper > 2 else 0


@kernel
def limits_of(cell: Int32, patch: Int32, shape: tuple[int, int], back: Int32) -> Float64:
    """Return the longest link along one axis for each patch, cells, float64 (P,).

    It is twice the local spacing, or `LINE_GAP` times the line distance of the patch and its
    neighbours, if that is longer.

    Parameters
    ----------
    cell
        int32 (N,), coordinate along the axis.
    patch
        int32 (N,), patch of each cuboid; `shape` is the number of rows and columns of patches.
    back
        int32 (N,), from `find_links`.
    """
    patches = shape[0] * shape[1]
    # The first column counts cuboids without a link, which saves a branch.
    histogram = np.zeros((patches + 1, STEPS), np.int32)
    for i in range(len(cell)):
        j = back[i]
        histogram[patch[i], cell[i] - cell[j] if j >= 0 else 0] += 1
    histogram[:, 0] = 0
    for p in range(patches):
        for k in range(STEPS):
            histogram[patches, k] += histogram[p, k]
    overall = spacing(histogram[patches], 1.0)
    limit = np.empty(patches)
    for p in range(patches):
        limit[p] = 2.0 * max(spacing(histogram[p], overall), 1.0)
        around = steps_around(histogram, shape, p)
        limit[p] = max(limit[p], LINE_GAP * line_distance(around))
    return limit


@kernel
def steps_around(histogram: Int32, shape: tuple[int, int], p: int) -> Int32:
    """Return the sum of the histograms of a patch and its eight neighbours, int32 (STEPS,)."""
    around = np.zeros(STEPS, np.int32)
    row, column = p // shape[1], p % shape[1]
    for r in range(max(row - 1, 0), min(row + 2, shape[0])):
        for c in range(max(column - 1, 0), min(column + 2, shape[1])):
            for k in range(1, STEPS):
                around[k] += histogram[r * shape[1] + c, k]
    return around


@kernel
def patches_of(ix: Int32, iy: Int32) -> tuple[Int32, tuple[int, int]]:
    """Return the patch of each cell, sorted by (ix, iy), and the shape of the patch grid."""
    n = len(ix)
    low_x, low_y = ix[0], iy.min()
    wide = ((iy.max() - low_y) >> PATCH_BITS) + 1
    patch = np.empty(n, np.int32)
    for i in range(n):
        patch[i] = ((ix[i] - low_x) >> PATCH_BITS) * wide + ((iy[i] - low_y) >> PATCH_BITS)
    return patch, (((ix[n - 1] - low_x) >> PATCH_BITS) + 1, wide)


@kernel
def accept_links(
    ix: Int32, iy: Int32, back_x: Int32, back_y: Int32, touching: Int32
) -> tuple[Int32, UInt8]:
    """Keep the links within the limits of their patch, and label connected components.

    Parameters
    ----------
    ix, iy
        As in `link`.
    back_x, back_y, touching
        Results of `find_links`; rejected links become -1.

    Returns
    -------
    root : int32 (N,)
        Smallest index of each cuboid's component.
    sides : uint8 (N,)
        Sides on which each cuboid has a link; `ALL_SIDES` if on all four.
    """
    n = len(ix)
    patch, shape = patches_of(ix, iy)
    limit_x = limits_of(ix, patch, shape, back_x)
    limit_y = limits_of(iy, patch, shape, back_y)
    # Cuboids linked along a row are one run; union-find is over runs only.
    run, parent, first = np.empty(n, np.int32), np.empty(n, np.int32), np.empty(n, np.int32)
    sides = np.zeros(n, np.uint8)
    runs = 0
    for i in range(n):
        p, j, own = patch[i], back_y[i], 0
        if j >= 0 and iy[i] - iy[j] < limit_y[p]:
            r = run[j]
            own = 4
            sides[j] |= 8
        else:
            back_y[i] = -1
            r = runs
            parent[r], first[r] = r, i
            runs += 1
        run[i] = r
        j = back_x[i]
        if j >= 0:
            if ix[i] - ix[j] < limit_x[p]:
                merge_sets(parent, r, run[j])
                own |= 1
                sides[j] |= 2
            else:
                back_x[i] = -1
        sides[i] = own
    for k in range(len(touching)):
        merge_sets(parent, run[touching[k, 0]], run[touching[k, 1]])
    # Parents have smaller numbers, so a single pass finds the root of each run.
    for r in range(runs):
        parent[r] = parent[parent[r]]
        first[r] = first[parent[r]]
    for i in range(n):
        run[i] = first[run[i]]
    return run, sides


@kernel
def link(
    ix: Int32, iy: Int32, top: Int32, mean: Int32, threshold: float
) -> tuple[Int32, Int32, Int32]:
    """Label the connected components of cuboids.

    Parameters
    ----------
    ix, iy
        int32 (N,), N > 0, cells, sorted by (ix, iy).
    top, mean
        int32 (N,), ticks: neighbours are linked only if one of the two differs by less than
        `threshold`.
    threshold
        Maximum height difference, ticks.

    Returns
    -------
    root : int32 (N,)
        Smallest index of each cuboid's component.
    back_x, back_y : int32 (N,)
        The links.
    """
    back_x, back_y, touching = find_links(ix, iy, top, mean, threshold)
    return accept_links(ix, iy, back_x, back_y, touching)[0], back_x, back_y


@kernel
def link_in_plane(ix: Int32, iy: Int32) -> tuple[Int32, Bool]:
    """Label the connected components of cuboids of one plane, whatever their heights.

    Returns
    -------
    root : int32 (N,)
        Smallest index of each cuboid's component.
    deep : bool (N,)
        Mask of the cuboids at least two links inside their component.
    """
    back_x, back_y, touching = find_links_in_plane(ix, iy)
    root, sides = accept_links(ix, iy, back_x, back_y, touching)
    return root, are_deep(back_x, back_y, sides)


@kernel
def are_deep(back_x: Int32, back_y: Int32, sides: UInt8) -> Bool:
    """Return a mask of the cuboids with links on all sides whose neighbours have them as well.

    Parameters
    ----------
    back_x, back_y
        int32 (N,), accepted links, -1 for none.
    sides
        uint8 (N,), from `accept_links`.

    Returns
    -------
    bool (N,)
    """
    deep = np.ones(len(sides), np.bool_)
    for i in range(len(sides)):
        x, y = back_x[i], back_y[i]
        if sides[i] == ALL_SIDES:
            deep[i] &= (sides[x] == ALL_SIDES) & (sides[y] == ALL_SIDES)
        else:
            deep[i] = False
            if x >= 0:
                deep[x] = False
            if y >= 0:
                deep[y] = False
    return deep
