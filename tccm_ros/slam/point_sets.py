"""The points of several scans in one frame, and how far they reach."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["extent_near_median", "place_scans"]

Float64 = NDArray[np.float64]
Near = NDArray[np.bool_] | slice


@njit(nogil=True, cache=True)
def place_scans(
    poses: Float64, counts: NDArray[np.int64], points: Float64, normals: Float64
) -> tuple[Float64, Float64]:  # pragma: no cover - compiled
    """Return points and normals, float64 (N, 2), in the frame of the scans' poses.

    Parameters
    ----------
    poses
        float64 (K, 3), m and rad.
    counts
        int64 (K,), points of each scan; their sum is N.
    points, normals
        float64 (N, 2), scan after scan, each in its scan's frame.
    """
    placed, turned = np.empty_like(points), np.empty_like(normals)
    i = 0
    for k in range(len(counts)):
        x, y = poses[k, 0], poses[k, 1]
        c, s = np.cos(poses[k, 2]), np.sin(poses[k, 2])
        for _ in range(counts[k]):
            placed[i, 0] = c * points[i, 0] - s * points[i, 1] + x
            placed[i, 1] = s * points[i, 0] + c * points[i, 1] + y
            turned[i, 0] = c * normals[i, 0] - s * normals[i, 1]
            turned[i, 1] = s * normals[i, 0] + c * normals[i, 1]
            i += 1
    return placed, turned


def extent_near_median(points: Float64, half: float) -> tuple[Near, Float64, Float64]:
    """Return which points are within `half` (m) of their median in x and y, and their extent.

    Parameters
    ----------
    points
        float64 (N, 2), N > 0; no extent is larger than 2 `half`.

    Returns
    -------
    An index of points, and their lower and upper corner float64 (2,)
    """
    low, high = _extent(points)
    if (high - low).max() < half:
        return slice(None), low, high
    near = np.all(np.abs(points - np.median(points, axis=0)) < half, axis=1)
    return near, *_extent(points[near])


@njit(nogil=True, cache=True)
def _extent(points: Float64) -> tuple[Float64, Float64]:  # pragma: no cover - compiled
    low, high = points[0].copy(), points[0].copy()
    for i in range(1, len(points)):
        for k in range(2):
            low[k] = min(low[k], points[i, k])
            high[k] = max(high[k], points[i, k])
    return low, high
