"""Line extraction by split and merge, from points in beam order."""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Float64, Int32, Int64
from tccm_ros.kernels import kernel

MIN_MERGE_COSINE = 0.996
"""Cosine of the maximum angle (5 deg) between merged pieces (chosen)."""

MERGE_TOLERANCE = 1.5
"""Factor on the maximum distance of a point from the chord for merged pieces (chosen)."""


@kernel
def split_segments(beams: Float64, distance: float, max_gap: float, min_points: int) -> Int32:
    """Return the segment label of each point.

    A run of points without a gap is split at the point farthest from the chord until each piece is
    straight; adjacent pieces on one line are merged again. The scan may wrap around: the first and
    last run are joined where they meet.

    Parameters
    ----------
    beams
        float64 (B, 2), m, in beam order.
    distance
        Maximum distance of a point from its segment's chord, m.
    max_gap
        Maximum distance between adjacent points of a segment, m.
    min_points
        Minimum number of points of a segment.

    Returns
    -------
    int32 (B,), index of the segment, or -1
    """
    n = len(beams)
    labels = np.full(n, -1, np.int32)
    if n < 2:
        return labels
    first = _seam(beams, max_gap)
    points = np.empty((n, 2))
    points[: n - first], points[n - first :] = beams[first:], beams[:first]
    stack = np.empty((n + 2, 2), np.int64)
    pieces = np.empty((n, 2), np.int64)
    count = 0
    start = 0
    while start < n:
        end = start
        while end + 1 < n and _gap2(points, end, end + 1) <= max_gap * max_gap:
            end += 1
        top = 0
        stack[0, 0], stack[0, 1] = start, end
        run = count
        while top >= 0:
            a, b = stack[top]
            top -= 1
            far, where = _farthest(points, a, b)
            if far <= distance:
                pieces[count, 0], pieces[count, 1] = a, b
                count += 1
            elif b - a >= 2:
                # Push the right part first: pieces are popped in beam order.
                stack[top + 1, 0], stack[top + 1, 1] = where, b
                stack[top + 2, 0], stack[top + 2, 1] = a, where
                top += 2
        count = _merge(points, pieces, run, count, distance)
        start = end + 1
    label = 0
    for k in range(count):
        a, b = pieces[k]
        if b - a + 1 < min_points:
            continue
        for i in range(a, b + 1):
            labels[(first + i) % n] = label
        label += 1
    return labels


@kernel
def _gap2(points: Float64, i: int, j: int) -> float:
    """Return the squared distance of two points."""
    dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
    return dx * dx + dy * dy


@kernel
def _seam(beams: Float64, max_gap: float) -> int:
    """Return the first point: 0, or, if the scan closes on itself, the one after the first gap.

    A closed scan without a gap begins at its farthest point, which is a corner.
    """
    n = len(beams)
    if _gap2(beams, n - 1, 0) > max_gap * max_gap:
        return 0
    for i in range(n - 1):
        if _gap2(beams, i, i + 1) > max_gap * max_gap:
            return i + 1
    far, where = -1.0, 0
    for i in range(n):
        d = beams[i, 0] * beams[i, 0] + beams[i, 1] * beams[i, 1]
        if d > far:
            far, where = d, i
    return where


@kernel
def _farthest(points: Float64, a: int, b: int) -> tuple[float, int]:
    """Return the maximum distance from the chord a..b, and its index."""
    px, py = points[a, 0], points[a, 1]
    dx, dy = points[b, 0] - px, points[b, 1] - py
    length = np.sqrt(dx * dx + dy * dy)
    far, where = 0.0, a
    if length > 1e-6:
        for i in range(a + 1, b):
            d = abs(dx * (points[i, 1] - py) - dy * (points[i, 0] - px))
            if d > far:
                far, where = d, i
        return far / length, where
    # A closed run has no chord: use the distance to its start.
    for i in range(a + 1, b):
        d = _gap2(points, a, i)
        if d > far:
            far, where = d, i
    return np.sqrt(far), where


@kernel
def _merge(points: Float64, pieces: Int64, start: int, count: int, distance: float) -> int:
    """Merge adjacent pieces of one run that are on one line; return their new number."""
    if count - start < 2:
        return count
    last = start
    for k in range(start + 1, count):
        a, b = pieces[last, 0], pieces[k, 1]
        p, m, q = points[a], points[pieces[k, 0]], points[b]
        u, v = m - p, q - m
        lengths = np.hypot(u[0], u[1]) * np.hypot(v[0], v[1])
        straight = u[0] * v[0] + u[1] * v[1] >= MIN_MERGE_COSINE * lengths
        far, _ = _farthest(points, a, b)
        if straight and far <= MERGE_TOLERANCE * distance:
            pieces[last, 1] = b
        else:
            last += 1
            pieces[last, 0], pieces[last, 1] = pieces[k, 0], b
    return last + 1
