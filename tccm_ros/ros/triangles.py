"""Triangles that fill a polygon with holes, by ear clipping."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["clip_ears"]

Array = NDArray[np.float64]
Int = NDArray[np.int32]
Index = NDArray[np.int64]


@njit(nogil=True, cache=True)
def clip_ears(xy: Array, ends: Index) -> Int:
    """Fill a polygon with triangles between its corners.

    Parameters
    ----------
    xy
        float64 (V, 2), corners of the outer ring and of the holes, one ring after the other. Rings
        do not cross or touch; their turning sense does not matter.
    ends
        int64 (R,), where each ring ends.

    Returns
    -------
    int32 (T, 3)
        Corners of triangles, counter-clockwise; none where the rings cannot be filled, because
        they cross.
    """
    loop = ring_of(xy, 0, ends[0], True)
    # Holes from the right to the left: a bridge never has to pass a hole that is still to come.
    order = np.argsort(np.array([-rightmost(xy, ends, r) for r in range(1, len(ends))]))
    for k in order:
        loop = with_hole(xy, loop, ring_of(xy, ends[k], ends[k + 1], False))
        if len(loop) == 0:
            return np.empty((0, 3), np.int32)
    return clip_loop(xy, loop)


@njit(nogil=True, cache=True)
def rightmost(xy: Array, ends: Index, r: int) -> float:
    """Return the largest x of a ring."""
    return xy[ends[r - 1] : ends[r], 0].max()


@njit(nogil=True, cache=True)
def ring_of(xy: Array, start: int, end: int, left: bool) -> Int:
    """Return the corners of a ring, turning left or right."""
    area, j = 0.0, end - 1
    for i in range(start, end):
        area += xy[j, 0] * xy[i, 1] - xy[i, 0] * xy[j, 1]
        j = i
    ring = np.arange(start, end).astype(np.int32)
    return ring if (area > 0.0) == left else ring[::-1].copy()


@njit(nogil=True, cache=True)
def turn(xy: Array, p: int, q: int, r: int) -> float:
    """Return twice the signed area of three corners."""
    return (xy[q, 0] - xy[p, 0]) * (xy[r, 1] - xy[p, 1]) - (xy[q, 1] - xy[p, 1]) * (
        xy[r, 0] - xy[p, 0]
    )


@njit(nogil=True, cache=True)
def with_hole(xy: Array, loop: Int, hole: Int) -> Int:
    """Return a loop that also goes around a hole, over a bridge to the nearest corner in sight.

    The loop is empty where no corner is in sight.
    """
    start = 0
    for k in range(len(hole)):
        if xy[hole[k], 0] > xy[hole[start], 0]:
            start = k
    m = hole[start]
    best, nearest = -1, np.inf
    for k in range(len(loop)):
        far = math.hypot(xy[loop[k], 0] - xy[m, 0], xy[loop[k], 1] - xy[m, 1])
        if far < nearest and in_sight(xy, loop, k, hole, m):
            best, nearest = k, far
    if best < 0:
        return loop[:0].copy()
    n, h = len(loop), len(hole)
    joined = np.empty(n + h + 2, np.int32)
    joined[: best + 1] = loop[: best + 1]
    for k in range(h + 1):
        joined[best + 1 + k] = hole[(start + k) % h]
    joined[best + h + 2 :] = loop[best:]
    return joined


@njit(nogil=True, cache=True)
def in_sight(xy: Array, loop: Int, k: int, hole: Int, m: int) -> bool:
    """Tell whether the way from corner k of a loop to corner m of a hole lies inside the loop."""
    n = len(loop)
    p, before, after = loop[k], loop[k - 1], loop[(k + 1) % n]
    left_of_in, left_of_out = turn(xy, before, p, m) > 0.0, turn(xy, p, after, m) > 0.0
    convex = turn(xy, before, p, after) > 0.0
    if (convex and not (left_of_in and left_of_out)) or not (left_of_in or left_of_out):
        return False
    return not (meets(xy, loop, p, m) or meets(xy, hole, p, m))


@njit(nogil=True, cache=True)
def meets(xy: Array, ring: Int, p: int, m: int) -> bool:
    """Tell whether the way p m meets a side of a ring, but for the sides at p and m."""
    j = ring[len(ring) - 1]
    for i in ring:
        if i not in (p, m) and j not in (p, m):
            apart = turn(xy, p, m, i) * turn(xy, p, m, j)
            if apart <= 0.0 and turn(xy, i, j, p) * turn(xy, i, j, m) <= 0.0:
                return True
        j = i
    return False


@njit(nogil=True, cache=True)
def clip_loop(xy: Array, loop: Int) -> Int:
    """Fill a loop that turns left, and may pass a corner twice, with triangles."""
    n = len(loop)
    after = np.arange(1, n + 1).astype(np.int32)
    before = np.arange(-1, n - 1).astype(np.int32)
    after[n - 1], before[0] = 0, n - 1
    triangles, used = np.empty((max(n - 2, 0), 3), np.int32), 0
    at, left, tried = 0, n, 0
    while left > 2:
        i, k = before[at], after[at]
        size = turn(xy, loop[i], loop[at], loop[k])
        if size >= 0.0 and (size == 0.0 or is_ear(xy, loop, after, i, at, k)):
            if size > 0.0:
                triangles[used, 0], triangles[used, 1] = loop[i], loop[at]
                triangles[used, 2] = loop[k]
                used += 1
            after[i], before[k] = k, i
            left -= 1
            tried = 0
            at = after[k]  # not beside the ear that was just clipped: fewer slivers
        else:
            at = k
            tried += 1
            if tried > left:
                return np.empty((0, 3), np.int32)
    return triangles[:used].copy()


@njit(nogil=True, cache=True)
def is_ear(xy: Array, loop: Int, after: Int, i: int, j: int, k: int) -> bool:
    """Tell whether no other corner of a loop lies in the triangle of three that follow."""
    a, b, c = loop[i], loop[j], loop[k]
    low_x, high_x = min(xy[a, 0], xy[b, 0], xy[c, 0]), max(xy[a, 0], xy[b, 0], xy[c, 0])
    low_y, high_y = min(xy[a, 1], xy[b, 1], xy[c, 1]), max(xy[a, 1], xy[b, 1], xy[c, 1])
    m = after[k]
    while m != i:
        p = loop[m]
        m = after[m]
        if p in (a, b, c) or not (low_x <= xy[p, 0] <= high_x and low_y <= xy[p, 1] <= high_y):
            continue
        if turn(xy, a, b, p) >= 0.0 and turn(xy, b, c, p) >= 0.0 and turn(xy, c, a, p) >= 0.0:
            return False
    return True
