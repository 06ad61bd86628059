"""Bucket grid of points for fast neighbour search."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int32, Int64

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


def _extent(points: Float64) -> Float64:
    return np.array([(x.min(), x.max()) for x in points.T]).T


def sort_into_buckets(points: Float64, origin: Float64, shape: Int64) -> tuple[Int64, Int32]:
    """Sort points by bucket; points of a bucket keep their order.

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
    x, y = ((points - origin) / BUCKET).astype(np.int64).T
    bucket = x * shape[1] + y
    ends = np.cumsum(np.bincount(bucket, minlength=shape[0] * shape[1]))
    starts = np.stack([np.append(0, ends[:-1]), ends], axis=1)
    order = np.argsort(bucket, kind="stable")
    return order, starts.reshape(*shape, 2).astype(np.int32)
