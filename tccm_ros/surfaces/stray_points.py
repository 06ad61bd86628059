"""Stray points of a surface in one view: a few far from all others, on the front of a higher one.

A beam on the front of a table behind can have the height of the table before it. The outline would
go on over the gap between them to such points, and two tables would be one where they overlap.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tccm_ros.arrays import Bool, Float32, Int32

GAP = 3.0
"""Strays are further from all others than so many times the spacing of the surface's points.
Chosen: one scan line may be missing between two others, and noise moves both."""

MAX_FRACTION = 0.05
"""And are at most this fraction of the points. Chosen: what an object hides is seen to both sides,
by more."""

FRONT = 0.05
"""And they are so near to points of a higher surface, seen from above, m. Chosen: two cells."""


def mark_strays(points: Float32, weights: Int32, spacing: float, others: Float32) -> Bool:
    """Return which points are strays, bool (N,).

    Parameters
    ----------
    points
        float32 (N, 3), of one surface in one view, m.
    weights
        int32 (N,), measurements of each.
    spacing
        Median distance of neighbours, m; where it is 0 nothing is a stray.
    others
        float32 (M, 3), of the other surfaces of the view, m.
    """
    if spacing <= 0.0 or not len(others):
        return np.zeros(len(points), np.bool_)
    pairs = cKDTree(points[:, :2]).query_pairs(GAP * spacing, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(points), len(points)))
    part_of = connected_components(links, directed=False)[1]
    measured = np.bincount(part_of, weights=weights)
    strays = np.asarray((measured <= MAX_FRACTION * measured.sum())[part_of])
    for part in np.unique(part_of[strays]):
        members = points[part_of == part]
        higher = others[others[:, 2] > members[:, 2].max()]
        near = len(higher) and cKDTree(higher[:, :2]).query(members[:, :2])[0] <= FRONT
        strays[part_of == part] = np.mean(near) > 0.5
    return strays
