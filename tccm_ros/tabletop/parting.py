"""Objects that touch, parted where height says so.

Seen from above, the columns of cells of one cluster are grouped into regions in which the height
changes by little from column to column. Two regions that lie beside each other are two objects; one
that lies within the other, as the neck of a bottle within its shoulders, is a part of the same.
"""

from __future__ import annotations

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tccm_ros.arrays import Float64, Int64

STEP = 0.03
"""Neighbouring columns of one region differ in height by at most this, m. Chosen: three standard
deviations of a depth camera at 2 m, and the fall of a ball's side over a cell of 2 cm."""

MIN_COLUMNS = 9
"""A region of an object has at least so many columns. Chosen: 6 cm square at cells of 2 cm."""

MIN_FRACTION = 0.2
"""And this fraction of the columns of its cluster. Chosen: a handle or a spout has less."""

MAX_COMMON = 0.25
"""Hulls of two objects have at most this fraction of the smaller one in common. Chosen: boxes that
stand askew beside each other have less, the neck of a bottle and its shoulders more."""


def part_by_height(mean: Float64, top: Float64, cell: float, gap: float) -> list[Int64]:
    """Part the cuboids of a cluster into objects that touch.

    Parameters
    ----------
    mean
        float64 (K, 2), means of the points of the cuboids, seen from above, m.
    top
        float64 (K,), heights of the tops of the cuboids, m.
    cell
        Edge of a cell, m.
    gap
        Columns up to so far from each other are neighbours, m.

    Returns
    -------
    list of int64 (P,)
        Indices of the cuboids of each object, rising; one where nothing is parted.
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
    # What is too small for an object (a side seen askew, an edge) belongs to the nearest one.
    kept = np.isin(region_of, large)
    nearest = cKDTree(columns[kept]).query(columns)[1]
    part_of = region_of[kept][nearest][column_of]
    return [np.flatnonzero(part_of == region) for region in large]


def _regions(places: Float64, height: Float64, gap: float) -> Int64:
    """Return the number of the region of each column, int64 (C,)."""
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
