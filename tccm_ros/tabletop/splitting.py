"""Separation of touching objects at steps in height, and around the surface between them.

Seen from above, the columns of cells of one cluster are grouped into regions in which the height
changes little from column to column. Two regions beside each other are two objects. A region within
another, as the neck of a bottle within its shoulders, belongs to the same object.

A hull that covers much of the surface itself, as that of the back and the arm of a sofa, is cut.
The surface behind an object that is seen obliquely is hidden, so that its sides stay together.
"""

from __future__ import annotations

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.tabletop.footprints import convex_hull, rectangle

STEP = 0.03
"""Maximum difference in height of neighbouring columns of one region, m. Chosen: three standard
deviations of a depth camera at 2 m, and the fall of a ball's side over a cell of 2 cm."""

MIN_COLUMNS = 9
"""Minimum number of columns of an object's region. Chosen: 6 cm square at cells of 2 cm."""

MIN_FRACTION = 0.2
"""Minimum fraction of the cluster's columns in an object's region. Chosen: a handle or a spout has
fewer."""

MAX_COMMON = 0.25
"""Maximum fraction of an object's hull that is in another one, or in which the surface below it is
seen. Chosen: oblique boxes beside each other and the handle of a mug have less, the neck and the
shoulders of a bottle and the corner of an L more."""


def split_by_height(mean: Float64, top: Float64, cell: float, gap: float) -> list[Int64]:
    """Return the cuboids of each of the touching objects in a cluster.

    Parameters
    ----------
    mean
        float64 (K, 2), x and y of the means of the cuboids' points, m.
    top
        float64 (K,), heights of the tops of the cuboids, m.
    cell
        Edge of a cell, m.
    gap
        Maximum distance of neighbouring columns, m.

    Returns
    -------
    list of int64 (P,)
        Indices of the cuboids of each object, rising; one array if the cluster is one object.
    """
    whole = [np.arange(len(mean))]
    cells = np.floor(mean / cell).astype(np.int64)
    columns, column_of = np.unique(cells, axis=0, return_inverse=True)
    column_of = column_of.reshape(-1)
    if len(columns) < 2 * MIN_COLUMNS:
        return whole
    height = np.full(len(columns), -np.inf)
    np.maximum.at(height, column_of, top)
    places: Float64 = columns.astype(np.float64) * cell
    region_of = _regions(places, height, gap)
    sizes = np.bincount(region_of)
    large = np.flatnonzero(sizes >= max(MIN_COLUMNS, MIN_FRACTION * len(columns)))
    if len(large) < 2 or not _are_beside(places, region_of, large, cell):
        return whole
    # Regions too small for an object (an obliquely seen side, an edge) belong to the nearest one.
    kept = np.isin(region_of, large)
    nearest = cKDTree(columns[kept]).query(columns)[1]
    part_of = region_of[kept][nearest][column_of]
    return [np.flatnonzero(part_of == region) for region in large]


def split_at_gaps(mean: Float64, surface: Float64, cell: float, max_length: float) -> list[Int64]:
    """Return the cuboids of each part of a cluster whose hulls cover little of the surface.

    Cuts are parallel to the sides of the smallest rectangle. Objects up to a length stay whole:
    they may have come after the surface below them was measured, or be open above.

    Parameters
    ----------
    mean
        float64 (K, 2), x and y of the means of the cuboids' points, m.
    surface
        float64 (S, 2), means of the surface's cuboids near the cluster, m.
    cell
        Edge of a cell, m.
    max_length
        Maximum length of an object that stays whole, m.

    Returns
    -------
    list of int64 (P,)
        Indices of the cuboids of each part, rising.
    """
    whole = np.arange(len(mean))
    hull = convex_hull(mean)
    if len(hull) < 3:
        return [whole]
    _, _, length, _, yaw = rectangle(hull)
    if length <= max_length:
        return [whole]
    covered = surface[_inside(hull, surface)]
    if len(covered) * cell**2 <= MAX_COMMON * shapely.Polygon(hull).area:
        return [whole]
    along = mean @ np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    best, left = 0.5 * len(covered), None
    for axis in range(2):
        for limit in np.arange(along[:, axis].min() + cell, along[:, axis].max(), cell):
            is_left = along[:, axis] < limit
            hulls = convex_hull(mean[is_left]), convex_hull(mean[~is_left])
            count = sum(int(_inside(part, covered).sum()) for part in hulls)
            if count < best:
                best, left = count, is_left
    if left is None:
        return [whole]
    sides = whole[left], whole[~left]
    return [side[k] for side in sides for k in split_at_gaps(mean[side], covered, cell, max_length)]


def _inside(hull: Float64, points: Float64) -> Bool:
    """Return which points (N, 2) are in a convex hull (H, 2); none if it is a line."""
    if len(hull) < 3:
        return np.zeros(len(points), np.bool_)
    return np.asarray(shapely.contains_xy(shapely.Polygon(hull), *points.T))


def _regions(places: Float64, height: Float64, gap: float) -> Int64:
    """Return the region of each column, int64 (C,)."""
    pairs = cKDTree(places).query_pairs(gap, output_type="ndarray")
    pairs = pairs[np.abs(height[pairs[:, 0]] - height[pairs[:, 1]]) <= STEP]
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(places), len(places)))
    return np.asarray(connected_components(links, directed=False)[1], np.int64)


def _are_beside(places: Float64, region_of: Int64, large: Int64, cell: float) -> bool:
    """Return whether no large region lies within another, seen from above."""
    hulls = [
        shapely.MultiPoint(places[region_of == region]).convex_hull.buffer(cell / 2.0)
        for region in large
    ]
    return all(
        a.intersection(b).area <= MAX_COMMON * min(a.area, b.area)
        for k, a in enumerate(hulls)
        for b in hulls[:k]
    )
