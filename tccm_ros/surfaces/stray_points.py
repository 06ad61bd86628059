"""Stray points of a surface in one view: a few that another surface of the view explains.

A beam on the front of a table behind can have the height of the table before it, and of two tables
of nearly one height a few points of one may go to the other. The outline would go on over the gap
between them to such points, and two tables would be one where they overlap.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tccm_ros.arrays import Bool, Float32, Int32
from tccm_ros.surfaces.thinning import cells_of

GAP = 1.5
"""Strays are further from all others than this multiple of the spacing of the surface's points.
Chosen: the next scan line is nearer, with noise."""

CELL = 0.5
"""Points are linked by the means of cells of this edge, in spacings of the surface's points: denser
points link nothing more, and cost the square of their density."""

MAX_FRACTION = 0.05
"""And are at most this fraction of the points. Chosen: what an object hides is seen to both sides,
by more."""

MAX_FRONT_FRACTION, MAX_FRONT_DEPTH = 0.3, 0.1
"""Or at most this one where they are a strip of less than this depth, m: that of a whole front.
Chosen: less than the surface itself, which has more lines; noise, and a table's rotated front."""

BESIDE = 0.05
"""And they are so near to points of another surface, seen from above, m, or as near as scan lines
are to each other. Chosen: two cells."""

NOT_LOWER = 0.006
"""That surface is not lower than they are by more than this, m: they are on its front, or of it.
Chosen: two deviations of a range."""


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
    cells = cells_of(points[:, :2].astype(np.float64), CELL * spacing)
    pairs = cKDTree(cells.means).query_pairs(GAP * spacing, output_type="ndarray")
    count = len(cells.means)
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count))
    part_of = connected_components(links, directed=False)[1][cells.of_point]
    measured = np.bincount(part_of, weights=weights) / weights.sum()
    strays = np.zeros(len(points), np.bool_)
    for part in np.flatnonzero(measured <= MAX_FRONT_FRACTION):
        members = points[part_of == part]
        if measured[part] <= MAX_FRACTION or _depth(members) <= MAX_FRONT_DEPTH:
            strays[part_of == part] = _are_explained(members, others, max(spacing, BESIDE))
    return strays


def _depth(points: Float32) -> float:
    """Return the shorter side of points, seen from above, m."""
    if len(points) < 2:
        return 0.0
    variance = np.linalg.eigvalsh(np.cov(points[:, :2].astype(np.float64).T))[0]
    return float(np.sqrt(12.0 * max(variance, 0.0)))


def _are_explained(members: Float32, others: Float32, beside: float) -> bool:
    """Return whether most points are within a distance, m, of those of a surface not lower."""
    near = others[others[:, 2] >= members[:, 2].mean() - NOT_LOWER]
    if not len(near):
        return False
    distance = cKDTree(near[:, :2]).query(members[:, :2])[0]
    return bool(np.mean(distance <= beside) > 0.5)
