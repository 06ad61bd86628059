"""Stray points of a surface in one view: a few points that belong to another surface of the view.

A beam on the front of a table can have the height of the table before it, and of two tables with
nearly the same height, a few points of one may be assigned to the other. The outline would extend
over the gap to such points, and the two tables would be merged.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tccm_ros.arrays import Bool, Float32, Int32
from tccm_ros.robust import MAJORITY, UNIFORM_WIDTH
from tccm_ros.surfaces.views.thinning import cells_of

GAP = 1.5
"""Min gap between stray points and all others, as a multiple of the point spacing of the surface.
Chosen: the next scan line is nearer, with noise."""

CELL = 0.5
"""Edge of the cells whose means are linked, as a multiple of the point spacing: denser points add
no links, at a cost quadratic in their density."""

MAX_FRACTION = 0.05
"""Max fraction of the points of a surface that are no evidence of it: in a stray group, or left
over when a newer view looked through the others or measured them again. Chosen: the parts of a
surface on both sides of an occlusion are larger."""

MAX_FRONT_FRACTION, MAX_FRONT_DEPTH = 0.3, 0.1
"""The same fraction for a strip of less than this depth, m: points on a whole front. Chosen: less
than the surface itself, which has more lines; noise, and a table's rotated front."""

NOT_LOWER = 0.006
"""Max height of stray points over that surface, m: they are on its front, or on the surface.
Chosen: two standard deviations of a range."""


def mark_strays(
    points: Float32, weights: Int32, spacing: float, others: Float32, beside: float
) -> Bool:
    """Return whether each point is a stray point, bool (N,).

    Parameters
    ----------
    points
        float32 (N, 3), points of one surface in one view, m.
    weights
        int32 (N,), number of measurements of each point.
    spacing
        Median distance of neighbours, m; if it is 0, no point is a stray.
    others
        float32 (M, 3), points of the other surfaces of the view, m.
    beside
        Max horizontal distance of stray points from those of another surface, m, or the spacing.
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
            strays[part_of == part] = _are_explained(members, others, max(spacing, beside))
    return strays


def _depth(points: Float32) -> float:
    """Return the horizontal extent of points along their shorter axis, m."""
    if len(points) < 2:
        return 0.0
    variance = np.linalg.eigvalsh(np.cov(points[:, :2].astype(np.float64).T))[0]
    return UNIFORM_WIDTH * float(np.sqrt(max(variance, 0.0)))


def _are_explained(members: Float32, others: Float32, beside: float) -> bool:
    """Return whether most points are within a distance, m, of points that are not lower."""
    places = members[:, :2].astype(np.float64)
    low, high = places.min(axis=0) - beside, places.max(axis=0) + beside
    is_beside = ((others[:, :2] >= low) & (others[:, :2] <= high)).all(axis=1)
    near = others[is_beside & (others[:, 2] >= members[:, 2].mean() - NOT_LOWER)]
    if not len(near):
        return False
    distance = cKDTree(near[:, :2]).query(places)[0]
    return bool(np.mean(distance <= beside) > MAJORITY)
