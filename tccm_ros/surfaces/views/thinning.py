"""Thinning of points: replace the points of each cell or voxel by their mean."""

from __future__ import annotations

from functools import reduce
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float32, Float64, Int32, Int64
from tccm_ros.cuboids.free_columns import KEY_STEP


class Cells(NamedTuple):
    """The occupied cells of a set of points.

    Attributes
    ----------
    means
        float64 (M, D), mean of the points of each cell, in the order of the cells.
    counts
        int64 (M,), number of points of each cell.
    of_point
        int64 (N,), the cell of each point.
    """

    means: Float64
    counts: Int64
    of_point: Int64


def cell_means(points: Float64, cell_size: float) -> tuple[Float64, Int64]:
    """Return the mean of the points of each cell, and their number.

    Parameters
    ----------
    points
        float64 (N, 2) or (N, 3), m.
    cell_size
        Edge of a cell, m.

    Returns
    -------
    means : float64 (M, 2) or (M, 3)
        In the order of the cells (x, y) or (x, y, z).
    counts : int64 (M,)
        Number of points of each cell.
    """
    return cells_of(points, cell_size)[:2]


def cells_of(points: Float64, cell_size: float) -> Cells:
    """Return the cells of points, with the parameters of `cell_means`."""
    cells = np.floor(points / cell_size).astype(np.int64)
    keys = reduce(lambda key, axis: key * KEY_STEP + axis, cells.T)
    _, group, count = np.unique(keys, return_inverse=True, return_counts=True)
    sums = [np.bincount(group, axis, len(count)) for axis in points.T]
    return Cells(np.stack(sums, axis=1) / count[:, None], count, group)


def thin_cloud(points: Float32, voxel_size: float) -> tuple[Float32, Int32]:
    """Return the mean of the points of each voxel, as `cell_means`, with the dtypes of a cloud.

    Parameters
    ----------
    points
        float32 (N, 3), m.
    voxel_size
        Edge of a voxel, m.

    Returns
    -------
    points : float32 (M, 3)
        In the order of the voxels (x, y, z).
    weights : int32 (M,)
        Number of points of each voxel.
    """
    means, count = cell_means(points.astype(np.float64), voxel_size)
    return means.astype(np.float32), count.astype(np.int32)
