"""Kernels of `objects`: cuboids above a surface, their clusters, hulls and rectangles.

`shapely` is not used for hull and rectangle: of rectangles of equal size the first one is taken
here, so that the yaw of an object does not depend on rounding.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int32, Int64
from tccm_ros.cuboids.cuboids import CuboidArrays
from tccm_ros.kernels import kernel
from tccm_ros.outlines.rings import is_inside
from tccm_ros.robust import UNIFORM_WIDTH
from tccm_ros.union_find import find_root, merge_sets


class LooseCuboids(NamedTuple):
    """The cuboids of a map that belong to no surface and no wall.

    Attributes
    ----------
    column
        int64 (L,), ix of each, rising.
    counts
        float64 (L,), points.
    mean, low, high
        float64 (L, 3), mean, low and high corner of their points, m.
    is_free
        bool (L,), whether it is not assigned to a surface yet.
    cell
        Edge of a cell, m.
    """

    column: Int64
    counts: Float64
    mean: Float64
    low: Float64
    high: Float64
    is_free: Bool
    cell: float


@kernel
def loose_cuboids(arrays: tuple[Any, ...], labels: Int32, structure: Bool) -> LooseCuboids:
    """Return the cuboids that belong to no surface and no wall, all free.

    Parameters
    ----------
    arrays
        The fields of `CuboidArrays`.
    labels
        int32 (N,), plane of each cuboid, -1 for none.
    structure
        bool (F,), whether a plane is a surface or a wall.
    """
    ix, iy, bottom, top, count, s, S, cell, tick = CuboidArrays(*arrays)
    n = 0
    for label in labels:
        n += label < 0 or not structure[label]
    column, points = np.empty(n, np.int64), np.empty(n)
    mean, low, high = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    k = 0
    for i in range(len(labels)):
        if labels[i] >= 0 and structure[labels[i]]:
            continue
        w = 1.0 / count[i]
        x, y, z = s[i, 0] * w, s[i, 1] * w, s[i, 2] * w
        rx = 0.5 * UNIFORM_WIDTH * math.sqrt(max(S[i, 0] * w - x * x, 0.0))
        ry = 0.5 * UNIFORM_WIDTH * math.sqrt(max(S[i, 3] * w - y * y, 0.0))
        rz = 0.5 * UNIFORM_WIDTH * math.sqrt(max(S[i, 5] * w - z * z, 0.0))
        x, y = x + np.rint(ix[i] * cell), y + np.rint(iy[i] * cell)
        column[k], points[k] = ix[i], count[i]
        mean[k, 0], mean[k, 1], mean[k, 2] = x * tick, y * tick, z * tick
        low[k, 0], low[k, 1] = (x - rx) * tick, (y - ry) * tick
        low[k, 2] = max(z - rz, float(bottom[i])) * tick
        high[k, 0], high[k, 1], high[k, 2] = (x + rx) * tick, (y + ry) * tick, top[i] * tick
        k += 1
    return LooseCuboids(column, points, mean, low, high, np.ones(n, np.bool_), cell * tick)


@kernel
def cuboids_above(
    loose: LooseCuboids, hull: Float64, normal: Float64, offset: float, min_height: float
) -> Int64:
    """Return the indices of the free cuboids above a plane, rising.

    Parameters
    ----------
    loose
        Loose cuboids of a map.
    hull
        float64 (H, 2), convex, counter-clockwise, m; it contains the means, seen from above.
    normal, offset
        The plane, ``normal . p = offset``, m.
    min_height
        Minimum height of the tops above the plane, m.
    """
    x, mean, high, cell = loose.column, loose.mean, loose.high, loose.cell
    first = np.searchsorted(x, math.floor(hull[:, 0].min() / cell) - 1)
    last = np.searchsorted(x, math.floor(hull[:, 0].max() / cell) + 1, side="right")
    y_low, y_high = hull[:, 1].min(), hull[:, 1].max()
    chosen, n = np.empty(last - first, np.int64), 0
    for i in range(first, last):
        if not loose.is_free[i] or mean[i, 1] < y_low or mean[i, 1] > y_high:
            continue
        reached = high[i, 0] * normal[0] + high[i, 1] * normal[1] + high[i, 2] * normal[2]
        if reached - offset >= min_height and is_inside(hull, mean[i, 0], mean[i, 1]):
            chosen[n] = i
            n += 1
    return chosen[:n].copy()


@kernel
def cluster_footprints(mean: Float64, chosen: Int64, gap: float) -> tuple[Int64, Int64]:
    """Return clusters of cuboids whose means are linked by distances up to a gap, seen from above.

    Parameters
    ----------
    mean
        float64 (L, 3), means of the points of all cuboids, m.
    chosen
        int64 (K,), indices of the cuboids to cluster.
    gap
        Maximum distance of neighbours, m.

    Returns
    -------
    members : int64 (K,)
        Cuboids of `chosen` by cluster, in the order of first members; rising within a cluster.
    starts : int64 (G + 1,)
        Index of each cluster's first cuboid in `members`.
    """
    n = len(chosen)
    if n == 0:
        return chosen.copy(), np.zeros(1, np.int64)
    low_x, low_y = mean[chosen[0], 0], mean[chosen[0], 1]
    high_x, high_y = low_x, low_y
    for i in chosen:
        low_x, high_x = min(low_x, mean[i, 0]), max(high_x, mean[i, 0])
        low_y, high_y = min(low_y, mean[i, 1]), max(high_y, mean[i, 1])
    # Bins of the gap's width: neighbours are in the same bin or an adjacent one.
    rows, columns = int((high_x - low_x) / gap) + 3, int((high_y - low_y) / gap) + 3
    last = np.full((rows, columns), -1, np.int32)
    before = np.empty(n, np.int32)
    parent = np.arange(n).astype(np.int32)
    for k in range(n):
        x, y = mean[chosen[k], 0], mean[chosen[k], 1]
        a, b = int((x - low_x) / gap) + 1, int((y - low_y) / gap) + 1
        for p in range(a - 1, a + 2):
            for q in range(b - 1, b + 2):
                m = last[p, q]
                while m >= 0:
                    dx, dy = mean[chosen[m], 0] - x, mean[chosen[m], 1] - y
                    if dx * dx + dy * dy <= gap * gap:
                        merge_sets(parent, k, m)
                    m = before[m]
        before[k] = last[a, b]
        last[a, b] = k
    # The root of a group is its first member, so numbers rise with first members.
    group, groups = np.empty(n, np.int64), 0
    for k in range(n):
        root = find_root(parent, k)
        if root == k:
            group[k] = groups
            groups += 1
        else:
            group[k] = group[root]
    starts = np.zeros(groups + 2, np.int64)
    for k in range(n):
        starts[group[k] + 2] += 1
    for g in range(1, groups + 2):
        starts[g] += starts[g - 1]
    members = np.empty(n, np.int64)
    for k in range(n):
        members[starts[group[k] + 1]] = chosen[k]
        starts[group[k] + 1] += 1
    return members, starts[: groups + 1]


@kernel
def footprint_corners(low: Float64, high: Float64, members: Int64) -> Float64:
    """Return the corners of the footprints of cuboids.

    Parameters
    ----------
    low, high
        float64 (L, 3), low and high corner of the points of all cuboids, m.
    members
        int64 (M,), indices of the cuboids.

    Returns
    -------
    float64 (4 M, 2), m.
    """
    out = np.empty((4 * len(members), 2))
    for k in range(len(members)):
        i = members[k]
        for c in range(4):
            out[4 * k + c, 0] = high[i, 0] if c & 1 else low[i, 0]
            out[4 * k + c, 1] = high[i, 1] if c & 2 else low[i, 1]
    return out


@kernel
def convex_hull(points: Float64) -> Float64:
    """Return the convex hull (H, 2) of points (N, 2), counter-clockwise, by a monotone chain.

    H < 3 where all points lie in a line.
    """
    by_y = np.argsort(points[:, 1], kind="mergesort")
    order = by_y[np.argsort(points[by_y, 0], kind="mergesort")]
    n = len(order)
    hull, used = np.empty((2 * n + 2, 2)), 0
    for side in range(2):
        start = used
        for k in range(n):
            p = points[order[k if side == 0 else n - 1 - k]]
            while used - start >= 2:
                ax, ay = hull[used - 2, 0], hull[used - 2, 1]
                bx, by = hull[used - 1, 0], hull[used - 1, 1]
                if (bx - ax) * (p[1] - ay) - (by - ay) * (p[0] - ax) > 0.0:
                    break
                used -= 1
            if used > start and hull[used - 1, 0] == p[0] and hull[used - 1, 1] == p[1]:
                continue
            hull[used] = p
            used += 1
        used -= 1  # the last point of a chain is the first of the other
    return hull[:used].copy()


@kernel
def rectangle(hull: Float64) -> tuple[float, float, float, float, float]:
    """Return centre x and y, length, width and yaw of the smallest rectangle around a hull.

    One of its sides lies on a side of the hull. The yaw is that of the longer side, in
    (-pi / 2, pi / 2].
    """
    best = np.inf
    x = y = length = width = yaw = 0.0
    j = len(hull) - 1
    for i in range(len(hull)):
        dx, dy = hull[i, 0] - hull[j, 0], hull[i, 1] - hull[j, 1]
        j = i
        side = math.hypot(dx, dy)
        if side == 0.0:
            continue
        c, s = dx / side, dy / side
        u_low = v_low = np.inf
        u_high = v_high = -np.inf
        for k in range(len(hull)):
            u, v = c * hull[k, 0] + s * hull[k, 1], c * hull[k, 1] - s * hull[k, 0]
            u_low, u_high = min(u_low, u), max(u_high, u)
            v_low, v_high = min(v_low, v), max(v_high, v)
        size = (u_high - u_low) * (v_high - v_low)
        if size >= best * (1.0 - 1e-9):
            continue
        best = size
        u, v = 0.5 * (u_low + u_high), 0.5 * (v_low + v_high)
        x, y = c * u - s * v, s * u + c * v
        length, width, yaw = u_high - u_low, v_high - v_low, math.atan2(s, c)
        if width > length:
            length, width, yaw = width, length, yaw + 0.5 * math.pi
    while yaw > 0.5 * math.pi:
        yaw -= math.pi
    while yaw <= -0.5 * math.pi:
        yaw += math.pi
    return x, y, length, width, yaw
