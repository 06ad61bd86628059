"""The patches of a vertical plane, each accepted or rejected by a fit as a whole.

Points at one position on a board fall in two cells, on both sides of their border. Rejecting one
cell and keeping the other would shift the plane. Therefore *patches* are tested as a whole: the
cuboids of one step along the board that overlap in height.

Where a board ends in a horizontal surface, as a shelf's front in its top, the highest patch of a
step is a *rim*: it may hold points of that surface, all at the rim's height, up to a cell behind
the board. In a part map the moments of the cuboids' caps are known, and those of rims are
subtracted. In an integration map patches are only marked as rims.
"""

import math

import numpy as np

from tccm_ros.arrays import Float64, Int32
from tccm_ros.cuboids.caps import CAP_DEPTH
from tccm_ros.cuboids.linking import STEPS
from tccm_ros.kernels import kernel
from tccm_ros.planes.arrays import PlaneMap, cap_of
from tccm_ros.planes.inliers import Plane

RIM_DEPTH = 40
"""Maximum depth of a rim's top below the median top of the highest patches, ticks: the height of a
horizontal surface varies from cell to cell. Chosen: 4 mm."""

GAP_STEPS = 2.0
"""Minimum gap that ends a piece of a plane, in mean distances of occupied bins, of one bin or more.
Chosen: one bin may be missing."""

NO_RIM = -(1 << 31)
"""Marks a patch that is no rim."""


@kernel
def bins_along(ix: Int32, iy: Int32, members: Int32, plane: Plane) -> tuple[Int32, int]:
    """Return the step of each cuboid along a vertical plane, and the number of steps.

    Steps run along its horizontal direction and have the width of a cell. A cell belongs to the
    step of its middle, so that the result does not depend on noise.

    Parameters
    ----------
    ix, iy
        int32 (N,), cells of the map's cuboids.
    members, plane
        int32 (M,), indices of the plane's cuboids, and the plane.

    Returns
    -------
    bins : int32 (M,)
    count : int
    """
    slope = math.hypot(plane[0], plane[1])
    ux, uy = -plane[1] / slope, plane[0] / slope
    along = np.empty(len(members))
    low = np.inf
    for k in range(len(members)):
        along[k] = ux * ix[members[k]] + uy * iy[members[k]]
        low = min(low, along[k])
    bins = np.empty(len(members), np.int32)
    count = 0
    for k in range(len(members)):
        bins[k] = int(along[k] - low + 0.5)
        count = max(count, bins[k] + 1)
    return bins, count


@kernel
def link_vertical(ix: Int32, iy: Int32, members: Int32, plane: Plane) -> Int32:
    """Return the connected sets of a vertical plane's cuboids: runs along its horizontal direction.

    A gap of `GAP_STEPS` mean steps ends a run.

    Parameters
    ----------
    ix, iy, members, plane
        As in `bins_along`.

    Returns
    -------
    int32 (M,), the smallest index of each cuboid's set, as in `linking.link`.
    """
    step, bins = bins_along(ix, iy, members, plane)
    run = np.full(bins, -1, np.int32)
    for k in range(len(step)):
        run[step[k]] = 0
    steps, count, last = 0, 0, -1
    for b in range(bins):
        if run[b] == 0:
            if last >= 0:
                steps += min(b - last, STEPS)
                count += 1
            last = b
    limit = GAP_STEPS * max(steps / max(count, 1), 1.0)
    runs, last = 0, 0
    for b in range(bins):
        if run[b] == 0:
            runs += b - last >= limit
            run[b] = runs
            last = b
    first = np.full(runs + 1, -1, np.int32)
    root = np.empty(len(step), np.int32)
    for k in range(len(step)):
        r = run[step[k]]
        if first[r] < 0:
            first[r] = k
        root[k] = first[r]
    return root


@kernel
def pool_patches(cuboids: PlaneMap, members: Int32, plane: Plane) -> tuple[Float64, Int32]:
    """Return the patches of a vertical plane: pools of the cuboids of each step.

    If caps are known, those of rims are subtracted, and no rim remains.

    Parameters
    ----------
    cuboids
        Cuboids of the map.
    members, plane
        Inliers of the plane, and the plane.

    Returns
    -------
    pooled : float64 (P, 10)
        Moments of the patches, by step and rising.
    rim : int32 (P,)
        Top of a rim, ticks; `NO_RIM` for the other patches.
    """
    M, bottom, top = cuboids.M, cuboids.bottom, cuboids.top
    order, start = sort_into_steps(cuboids.ix, cuboids.iy, bottom, members, plane)
    pooled = np.empty((len(members), 10))
    rim = np.full(len(members), NO_RIM, np.int32)
    tops = np.empty(len(start) - 1)
    begins = np.empty(len(members) + 1, np.int32)
    patches, steps = 0, 0
    for b in range(len(start) - 1):
        if start[b] == start[b + 1]:
            continue
        high = NO_RIM
        for j in range(start[b], start[b + 1]):
            i = order[j]
            if high < bottom[i]:
                begins[patches] = j
                for c in range(10):
                    pooled[patches, c] = M[i, c]
                patches += 1
            else:
                for c in range(10):
                    pooled[patches - 1, c] += M[i, c]
            high = max(high, top[i])
        rim[patches - 1] = high
        tops[steps] = high
        steps += 1
    begins[patches] = len(members)
    min_top = np.median(tops[:steps]) - RIM_DEPTH
    for p in range(patches):
        if rim[p] < min_top:
            rim[p] = NO_RIM
    if len(cuboids.cap_rows) == 0:
        return pooled[:patches], rim[:patches]
    kept = 0
    for p in range(patches):
        if rim[p] != NO_RIM:
            for j in range(begins[p], begins[p + 1]):
                if top[order[j]] >= rim[p] - CAP_DEPTH:
                    cap = cap_of(cuboids, order[j])
                    for c in range(10):
                        pooled[p, c] -= cap[c]
            if pooled[p, 0] < 0.5:
                continue
        if kept < p:
            for c in range(10):
                pooled[kept, c] = pooled[p, c]
        kept += 1
    return pooled[:kept], np.full(kept, NO_RIM, np.int32)


@kernel
def sort_into_steps(
    ix: Int32, iy: Int32, bottom: Int32, members: Int32, plane: Plane
) -> tuple[Int32, Int32]:
    """Return a vertical plane's cuboids sorted by step, and by height within a step.

    Parameters
    ----------
    ix, iy, members, plane
        As in `bins_along`.
    bottom
        int32 (N,), ticks.

    Returns
    -------
    order : int32 (M,)
        The cuboids.
    start : int32 (steps + 1,)
        Index of each step's first cuboid in `order`.
    """
    bins, count = bins_along(ix, iy, members, plane)
    start = np.zeros(count + 1, np.int32)
    for b in bins:
        start[b + 1] += 1
    for b in range(count):
        start[b + 1] += start[b]
    fill = start.copy()
    order = np.empty(len(members), np.int32)
    for k in range(len(members)):
        i, b = members[k], bins[k]
        j = fill[b]
        fill[b] += 1
        while j > start[b] and bottom[order[j - 1]] > bottom[i]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = i
    return order, start
