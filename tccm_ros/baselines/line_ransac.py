"""Line extraction by RANSAC, the method of the surface mapping paper (III.A.1)."""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Float64, Int32, Int64
from tccm_ros.config import Config
from tccm_ros.kernels import kernel

SPENT = -2
"""Label of points whose line was too short; they are not drawn again."""


def label_by_ransac(beams: Float64, config: Config) -> Int32:
    """Label the beams of each segment; a labelling function for `slam.lines.extract_lines`."""
    x = config.lines
    return ransac_segments(beams, x.distance, x.max_gap, x.min_points, x.min_length, x.trials)


@kernel
def ransac_segments(
    beams: Float64,
    distance: float,
    max_gap: float,
    min_points: int,
    min_length: float,
    trials: int,
) -> Int32:  # pragma: no cover - compiled
    """Label the points of each segment, in order of falling support.

    Draw two of the free points and count the inliers of their line that are connected without a gap
    to the first of them. Keep the line with the most inliers, and repeat on the remaining points
    until no line has enough.

    Parameters
    ----------
    beams
        float64 (B, 2), m, in any order.
    distance
        Maximum distance of an inlier, m.
    max_gap
        Maximum distance between neighbours along a line, m.
    min_points, min_length
        Minimum support and length (m).
    trials
        Number of pairs drawn for each line.

    Returns
    -------
    int32 (B,), index of the segment, or -1
    """
    n = len(beams)
    labels = np.full(n, -1, np.int32)
    free = np.arange(n)
    state = np.uint64(0x9E3779B97F4A7C15)
    label = 0
    while len(free) >= max(min_points, 2):
        # Separate x and y arrays, so that counting is vectorised.
        xs, ys = beams[free, 0], beams[free, 1]
        best = np.empty(0, np.int64)
        for _ in range(trials):
            state = _next(state)
            i = free[int((state >> np.uint64(33)) % np.uint64(len(free)))]
            state = _next(state)
            j = free[int((state >> np.uint64(33)) % np.uint64(len(free)))]
            if i == j or _count(xs, ys, beams[i], beams[j], distance) <= len(best):
                continue
            inliers = _support(beams, free, i, j, distance, max_gap)
            if len(inliers) > len(best):
                best = inliers
        if len(best) < min_points:
            break
        first, last = beams[best[0]], beams[best[-1]]
        if np.hypot(last[0] - first[0], last[1] - first[1]) >= min_length:
            for member in best:
                labels[member] = label
            label += 1
        else:
            for member in best:
                labels[member] = SPENT
        free = np.array([k for k in free if labels[k] == -1])
    for k in range(n):
        if labels[k] < 0:
            labels[k] = -1
    return labels


@kernel
def _next(state: np.uint64) -> np.uint64:  # pragma: no cover - compiled
    """Step a 64-bit linear congruential generator (Knuth's MMIX constants)."""
    return state * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)


@kernel
def _count(
    xs: Float64, ys: Float64, a: Float64, b: Float64, distance: float
) -> int:  # pragma: no cover - compiled
    """Return the number of points near the line a-b, with or without gaps."""
    px, py, dx, dy = a[0], a[1], b[0] - a[0], b[1] - a[1]
    limit = distance * np.sqrt(dx * dx + dy * dy)
    count = 0
    for k in range(len(xs)):
        count += abs(dx * (ys[k] - py) - dy * (xs[k] - px)) <= limit
    return count


@kernel
def _support(
    beams: Float64, free: Int64, i: int, j: int, distance: float, max_gap: float
) -> Int64:  # pragma: no cover - compiled
    """Return the free inliers of line i-j that are connected to i, ordered along it."""
    dx, dy = beams[j, 0] - beams[i, 0], beams[j, 1] - beams[i, 1]
    length = np.hypot(dx, dy)
    if length < 1e-6:
        return np.empty(0, np.int64)
    dx, dy = dx / length, dy / length
    along, who = np.empty(len(free)), np.empty(len(free), np.int64)
    count = 0
    for k in free:
        x, y = beams[k, 0] - beams[i, 0], beams[k, 1] - beams[i, 1]
        if abs(dx * y - dy * x) <= distance:
            along[count], who[count] = dx * x + dy * y, k
            count += 1
    order = np.argsort(along[:count], kind="mergesort")
    centre = 0
    for k in range(count):
        if who[order[k]] == i:
            centre = k
    low, high = centre, centre
    while low > 0 and along[order[low]] - along[order[low - 1]] <= max_gap:
        low -= 1
    while high + 1 < count and along[order[high + 1]] - along[order[high]] <= max_gap:
        high += 1
    return who[order[low : high + 1]]
