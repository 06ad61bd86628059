"""Stray points of a surface in one view: a few far from all others, on the front of another one.

A beam on the front of a table behind can have the height of the table before it. The outline would
go on over the gap between them to such points, and two tables would be one where they overlap.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tccm_ros.arrays import Bool, Float64, Int32

GAP = 3.0
"""Strays are further from all others than so many times the spacing of the surface's points.
Chosen: one scan line may be missing between two others, and noise moves both."""

MAX_FRACTION = 0.05
"""And are at most this fraction of the points. Chosen: what an object hides is seen to both sides,
by more."""


def mark_strays(points_xy: Float64, weights: Int32, spacing: float) -> Bool:
    """Return which points are strays, bool (N,).

    Parameters
    ----------
    points_xy
        float64 (N, 2), of one surface in one view, m.
    weights
        int32 (N,), measurements of each.
    spacing
        Median distance of neighbours, m; where it is 0 nothing is a stray.
    """
    if spacing <= 0.0:
        return np.zeros(len(points_xy), np.bool_)
    pairs = cKDTree(points_xy).query_pairs(GAP * spacing, output_type="ndarray")
    shape = (len(points_xy), len(points_xy))
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=shape)
    part_of = connected_components(links, directed=False)[1]
    measured = np.bincount(part_of, weights=weights)
    return np.asarray((measured <= MAX_FRACTION * measured.sum())[part_of])
