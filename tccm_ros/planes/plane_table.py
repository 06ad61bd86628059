"""The table of planes that the plane kernels fill: a row each, which labels name by its index."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["PLANE_COLUMNS", "keep_planes"]

PLANE_COLUMNS = 19
"""Columns of a plane's row: 0..3 normal and offset, 4..6 variances along and across, falling,
7 points of all its cuboids, 8..17 moments of the fit, 18 whether it is level."""


@njit(nogil=True, cache=True)
def keep_planes(
    labels: NDArray[np.int32], planes: NDArray[np.float64], is_kept: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return the rows that are kept, and number the labels anew; those of others become -1."""
    number = np.full(len(planes), -1, np.int32)
    kept = 0
    for p in range(len(planes)):
        if is_kept[p]:
            number[p] = kept
            planes[kept] = planes[p]
            kept += 1
    if kept < len(planes):
        for i in range(len(labels)):
            if labels[i] >= 0:
                labels[i] = number[labels[i]]
    return planes[:kept]
