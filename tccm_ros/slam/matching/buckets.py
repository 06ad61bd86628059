"""Bucket grid of points for fast neighbour search."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int32, Int64
from tccm_ros.kernels import kernel

Near = Bool | slice

BUCKET = 0.30
"""Edge of a bucket, m: the maximum distance of a scan from its solution (chosen)."""


class Buckets(NamedTuple):
    """Ranges of points per bucket; passed to compiled code.

    Attributes
    ----------
    origin
        float64 (2,), lower corner of the grid.
    starts
        int32 (rows, columns, 2): index of the first point of each bucket, and one past the last.
    """

    origin: Float64
    starts: Int32


def extent_near_median(points: Float64, half: float) -> tuple[Near, Float64, Float64]:
    """Return the points within `half` (m) of their median in x and y, and their extent.

    Parameters
    ----------
    points
        float64 (N, 2), N > 0, m.
    half
        Maximum distance from the median along each axis, m; the extent is at most 2 `half`.

    Returns
    -------
    Index of the points (mask or slice), and their lower and upper corner float64 (2,)
    """
    low, high = _extent(points)
    if (high - low).max() < half:
        return slice(None), low, high
    near = np.all(np.abs(points - np.median(points, axis=0)) < half, axis=1)
    return near, *_extent(points[near])


@kernel
def _extent(points: Float64) -> tuple[Float64, Float64]:
    low, high = points[0].copy(), points[0].copy()
    for i in range(1, len(points)):
        for k in range(2):
            low[k] = min(low[k], points[i, k])
            high[k] = max(high[k], points[i, k])
    return low, high


@kernel
def sort_into_buckets(points: Float64, origin: Float64, shape: Int64) -> tuple[Int64, Int32]:
    """Sort points by bucket with a stable counting sort.

    Parameters
    ----------
    points
        float64 (N, 2), m, all within the grid.
    origin
        float64 (2,), lower corner of the grid, m.
    shape
        int64 (2,), rows and columns of the grid.

    Returns
    -------
    The new order of points int64 (N,), and ``Buckets.starts`` for this grid
    """
    starts = np.zeros((shape[0], shape[1], 2), np.int32)
    cells = np.empty((len(points), 2), np.int32)
    for i in range(len(points)):
        cells[i, 0] = int((points[i, 0] - origin[0]) / BUCKET)
        cells[i, 1] = int((points[i, 1] - origin[1]) / BUCKET)
        starts[cells[i, 0], cells[i, 1], 1] += 1
    total = 0
    for x in range(shape[0]):
        for y in range(shape[1]):
            n = starts[x, y, 1]
            starts[x, y, 0] = starts[x, y, 1] = total
            total += n
    order = np.empty(len(points), np.int64)
    for i in range(len(points)):
        k = starts[cells[i, 0], cells[i, 1], 1]
        order[k] = i
        starts[cells[i, 0], cells[i, 1], 1] = k + 1
    return order, starts
