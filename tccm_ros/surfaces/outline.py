"""The outline of a patch of points, with holes, at the scale of its own sampling.

The points of a horizontal surface are triangulated in x and y. A triangle belongs to the surface
where it is not much larger than those around it: lines of a far sweep are decimetres apart and
still one table top, while a gap of a few decimetres in a near and dense sweep is a gap.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError, cKDTree
from shapely import MultiPolygon

from tccm_ros.surfaces.expected_edge import expected_area
from tccm_ros.surfaces.polygons import GRID, polygons_of

__all__ = ["covered_area", "horizontal_outline"]

Float64 = NDArray[np.float64]

SPACING_FACTOR = 2.2
"""A triangle longer than this many local spacings bridges a gap: twice the spacing, and noise."""

NEIGHBOURS = 24
"""Points whose gaps make the local spacing."""

QUANTILE = 0.4
"""Of the neighbours' largest gaps: along a border up to half of them look across it."""

Mesh = tuple[Float64, NDArray[np.int64], Float64]


def horizontal_outline(points_xy: Float64, least_gap: float) -> tuple[MultiPolygon, float]:
    """Return the outline of what a view saw of a surface, and how densely its points lie.

    Parameters
    ----------
    points_xy
        float64 (N, 2), m, without duplicates, in the base frame: the robot is at the origin.
    least_gap
        Gaps up to this are closed however dense the points are, m.

    Returns
    -------
    outline : MultiPolygon
        The area that the points cover, with far edges where they are expected; possibly empty.
    spacing : float
        Median of the local spacing, m; 0 where there is no outline.
    """
    area, spacing = covered_area(points_xy, least_gap)
    return expected_area(area, spacing), spacing


def covered_area(points_xy: Float64, least_gap: float) -> tuple[MultiPolygon, float]:
    """Return the area that points cover, as disjoint parts, and their spacing, m.

    The parameters are those of `horizontal_outline`, but for the frame, which may be any.
    """
    mesh = _mesh(_thin(points_xy, 0.5 * least_gap))
    gap = 0.25 * _gap_by_area(*mesh)
    if gap > 0.5 * least_gap:
        mesh = _mesh(_thin(points_xy, gap))
    points, triangles, longest = mesh
    if len(triangles) == 0:
        return MultiPolygon(), 0.0
    local = _local_spacing(points, triangles, longest)
    limit = np.maximum(least_gap, SPACING_FACTOR * np.median(local[triangles], axis=1))
    return _area_of(points, triangles[longest <= limit]), float(np.median(local))


def _mesh(points_xy: Float64) -> Mesh:
    """Triangulate points: (points (N, 2), triangles (T, 3), longest edges (T,) in m)."""
    triangles = _triangulate(points_xy)
    corners = points_xy[triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return points_xy, triangles, longest.max(axis=1, initial=0.0)


def _gap_by_area(points_xy: Float64, triangles: NDArray[np.int64], longest: Float64) -> float:
    """Return the gap, m, that half of the area consists of: noise makes many slivers, no area."""
    if len(triangles) == 0:
        return 0.0
    a, b, c = (points_xy[triangles[:, k]] for k in range(3))
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    order = np.argsort(longest, kind="stable")
    area = np.cumsum(np.abs(ux * vy - uy * vx)[order])
    return float(longest[order[np.searchsorted(area, 0.5 * area[-1])]])


def _thin(points_xy: Float64, cell: float) -> Float64:
    """Return the mean of the points of each cell, so that noise does not look like spacing."""
    cells = np.floor(points_xy / cell).astype(np.int64)
    if len(cells) == 0:
        return points_xy
    cells -= cells.min(axis=0)
    keys = cells[:, 0] * (cells[:, 1].max() + 1) + cells[:, 1]
    _, group, count = np.unique(keys, return_inverse=True, return_counts=True)
    sums = [np.bincount(group, points_xy[:, k], len(count)) for k in range(2)]
    return np.stack(sums, axis=1) / count[:, None]


def _area_of(points_xy: Float64, triangles: NDArray[np.int64]) -> MultiPolygon:
    """Return the area that triangles cover: what the edges of only one triangle enclose."""
    if len(triangles) == 0:
        return MultiPolygon()
    a, b = triangles, triangles[:, [1, 2, 0]]
    keys = (np.minimum(a, b) * len(points_xy) + np.maximum(a, b)).ravel()
    keys, uses = np.unique(keys, return_counts=True)
    edges = np.stack(np.divmod(keys[uses == 1], len(points_xy)), axis=1)
    border = np.round(points_xy[edges] / GRID) * GRID
    lines = shapely.multilinestrings(shapely.linestrings(border))
    return polygons_of(shapely.make_valid(shapely.build_area(lines)))


def _triangulate(points_xy: Float64) -> NDArray[np.int64]:
    """Return the Delaunay triangles, int64 (T, 3); none where all points are on one line."""
    if len(points_xy) < 3:
        return np.zeros((0, 3), np.int64)
    try:
        return Delaunay(points_xy - points_xy.mean(axis=0)).simplices.astype(np.int64)
    except QhullError:
        return np.zeros((0, 3), np.int64)


def _local_spacing(points_xy: Float64, triangles: NDArray[np.int64], longest: Float64) -> Float64:
    """Return the spacing around each point, float64 (N,), m.

    A point's own gap is the longest edge of its triangles: the distance between sweep lines, even
    where the beams of a line are a hundred times nearer to each other.
    """
    own = np.zeros(len(points_xy))
    np.maximum.at(own, triangles.ravel(), np.repeat(longest, 3))
    count = min(NEIGHBOURS, len(points_xy))
    _, near = cKDTree(points_xy).query(points_xy, k=count)
    rank = int(QUANTILE * (count - 1))
    return np.partition(own[near.reshape(-1, count)], rank, axis=1)[:, rank]
