"""Kernels for closed rings in a plane: area, point in ring, simplification, crossings.

`shapely` has these functions for one polygon at a time, from Python; here they are steps of a
compiled loop over all planes of a map.
"""

import numpy as np

from tccm_ros.arrays import Float64, Int32
from tccm_ros.kernels import kernel


@kernel
def signed_area(ring: Float64) -> float:
    """Return the area of a ring, positive if counter-clockwise."""
    total, j = 0.0, len(ring) - 1
    for i in range(len(ring)):
        total += ring[j, 0] * ring[i, 1] - ring[i, 0] * ring[j, 1]
        j = i
    return 0.5 * total


@kernel
def is_inside(ring: Float64, x: float, y: float) -> bool:
    """Return whether a point is inside a ring, by counting crossings (even-odd rule).

    Parameters
    ----------
    ring
        float64 (N, 2), open.
    x, y
        The point.
    """
    inside, j = False, len(ring) - 1
    for i in range(len(ring)):
        if (ring[i, 1] > y) != (ring[j, 1] > y):
            t = (y - ring[i, 1]) / (ring[j, 1] - ring[i, 1])
            if x < ring[i, 0] + t * (ring[j, 0] - ring[i, 0]):
                inside = not inside
        j = i
    return inside


@kernel
def simplify(ring: Float64, tolerance: float) -> Float64:
    """Remove corners of a ring within a tolerance of the remaining ring.

    It uses Douglas and Peucker's rule, starting from the corner with the smallest (x, y) and the
    corner furthest from it. A ring that encloses no area at the tolerance may keep only two
    corners.
    """
    n = len(ring)
    keep = np.zeros(n + 1, np.bool_)
    first = 0
    for i in range(1, n):
        if ring[i, 0] < ring[first, 0] or (
            ring[i, 0] == ring[first, 0] and ring[i, 1] < ring[first, 1]
        ):
            first = i
    far, max_distance2 = 0, -1.0
    for i in range(n):
        x, y = ring[(first + i) % n, 0] - ring[first, 0], ring[(first + i) % n, 1] - ring[first, 1]
        if x * x + y * y > max_distance2:
            far, max_distance2 = i, x * x + y * y
    keep[0] = keep[far] = keep[n] = True
    stack = np.empty((n + 2, 2), np.int32)
    stack[0, 0], stack[0, 1] = 0, far
    stack[1, 0], stack[1, 1] = far, n
    height = 2
    while height:
        height -= 1
        i, j = stack[height, 0], stack[height, 1]
        p, q = (first + i) % n, (first + j) % n
        dx, dy = ring[q, 0] - ring[p, 0], ring[q, 1] - ring[p, 1]
        length2 = dx * dx + dy * dy
        at, worst = -1, tolerance * tolerance
        for k in range(i + 1, j):
            m = first + k if first + k < n else first + k - n
            x, y = ring[m, 0] - ring[p, 0], ring[m, 1] - ring[p, 1]
            t = min(max((x * dx + y * dy) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
            x, y = x - t * dx, y - t * dy
            if x * x + y * y > worst:
                at, worst = k, x * x + y * y
        if at >= 0:
            keep[at] = True
            stack[height, 0], stack[height, 1] = i, at
            stack[height + 1, 0], stack[height + 1, 1] = at, j
            height += 2
    out, used = np.empty((keep[:n].sum(), 2)), 0
    for i in range(n):
        if keep[i]:
            out[used] = ring[(first + i) % n]
            used += 1
    return out


@kernel
def crosses(vertices: Float64, ends: Int32) -> bool:
    """Return whether any two sides of the rings cross or touch, except neighbours in a ring."""
    n = len(vertices)
    after = np.empty(n, np.int32)
    start = 0
    for r in range(len(ends)):
        for i in range(start, ends[r]):
            after[i] = i + 1 if i + 1 < ends[r] else start
        start = ends[r]
    low, high = np.empty(n), np.empty(n)
    for i in range(n):
        low[i] = min(vertices[i, 0], vertices[after[i], 0])
        high[i] = max(vertices[i, 0], vertices[after[i], 0])
    order = np.argsort(low)
    for k in range(n):
        i = order[k]
        for m in range(k + 1, n):
            j = order[m]
            if low[j] > high[i]:
                break
            if after[i] == j or after[j] == i:
                if sides_overlap(vertices, i, after[i], j, after[j]):
                    return True
            elif sides_meet(vertices, i, after[i], j, after[j]):
                return True
    return False


@kernel
def ccw(v: Float64, p: int, q: int, r: int) -> float:
    """Return twice the signed area of a triangle, positive if counter-clockwise.

    Parameters
    ----------
    v
        float64 (V, 2), vertices.
    p, q, r
        Indices of the corners.
    """
    return (v[q, 0] - v[p, 0]) * (v[r, 1] - v[p, 1]) - (v[q, 1] - v[p, 1]) * (v[r, 0] - v[p, 0])


@kernel
def sides_meet(v: Float64, p: int, q: int, r: int, s: int) -> bool:
    """Return whether two sides have a point in common.

    Parameters
    ----------
    v
        float64 (V, 2), vertices.
    p, q, r, s
        Indices of the ends: sides p q and r s.
    """
    if min(v[p, 1], v[q, 1]) > max(v[r, 1], v[s, 1]) or min(v[r, 1], v[s, 1]) > max(
        v[p, 1], v[q, 1]
    ):
        return False
    if min(v[p, 0], v[q, 0]) > max(v[r, 0], v[s, 0]) or min(v[r, 0], v[s, 0]) > max(
        v[p, 0], v[q, 0]
    ):
        return False
    return ccw(v, p, q, r) * ccw(v, p, q, s) <= 0.0 and ccw(v, r, s, p) * ccw(v, r, s, q) <= 0.0


@kernel
def sides_overlap(v: Float64, p: int, q: int, r: int, s: int) -> bool:
    """Return whether two sides with a common vertex overlap in more than that vertex.

    Parameters
    ----------
    v
        float64 (V, 2), vertices.
    p, q, r, s
        Indices of the ends, sides p q and r s, with q = r or p = s.
    """
    if q == r:
        a, b, c = p, q, s
    else:
        a, b, c = r, s, q
    along = (v[a, 0] - v[b, 0]) * (v[c, 0] - v[b, 0]) + (v[a, 1] - v[b, 1]) * (v[c, 1] - v[b, 1])
    return ccw(v, a, b, c) == 0.0 and along >= 0.0
