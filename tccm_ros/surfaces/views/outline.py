"""The outline of a patch of points, with holes, at the scale of its local point spacing.

The points of a horizontal surface are triangulated in x and y. A triangle belongs to the surface if
its longest edge is not much longer than the local spacing: scan lines on a far table have distances
of decimetres, while a distance of decimetres between dense points of a near table is a gap.

A scan line ends one or two beams before the edge of a surface, as a beam that hits the edge in part
is a mixed pixel. So outlines of scan lines are widened slightly. Depth images sample a surface
every one or two millimetres, and their mixed pixels are beyond its edge, so that their outlines are
not widened.
"""

from __future__ import annotations

import numpy as np
import shapely
from scipy.spatial import Delaunay, QhullError, cKDTree
from shapely import MultiPolygon

from tccm_ros.arrays import Float64, Int64
from tccm_ros.records import SensorKind
from tccm_ros.surfaces.polygons import GRID, polygons_of
from tccm_ros.surfaces.views.thinning import cell_means

SPACING_FACTOR = 2.2
"""Max edge of a triangle of the surface, in local spacings; chosen: two, and noise."""

NEIGHBOURS = 24
"""Number of nearest points from which the local spacing is computed; chosen."""

THINNING_FRACTION = 0.25
"""Cell size of the thinning, as a fraction of the local spacing between scan lines; chosen."""

QUANTILE = 0.4
"""The local spacing is this quantile of the neighbours' largest gaps; chosen: less than half, as at
a border up to half of the neighbours have a gap across it."""

SIDE_EDGE_FRACTION = 0.15
"""Expected distance of the edge beyond the points, and its standard deviation at a near side, as a
fraction of the distance of scan lines; chosen."""

MIN_SIDE_EDGE, MAX_SIDE_EDGE = 0.004, 0.0125
"""Limits of the distance by which an outline is widened, m; chosen: the lower one is half the
distance of beams of 0.5 deg at 1 m."""

MITRE_LIMIT = 2.0
"""Max motion of a corner of a widened outline, as a multiple of the widening; chosen."""

Mesh = tuple[Float64, Int64, Float64]
"""Points, triangles and longest edges, as returned by `_mesh`."""


def horizontal_outline(
    points_xy: Float64, min_gap: float, sensor: SensorKind
) -> tuple[MultiPolygon, float]:
    """Return the outline of the points that one view measured of a surface, and their spacing.

    Parameters
    ----------
    points_xy
        float64 (N, 2), m, without duplicates.
    min_gap
        Gaps up to this are closed at any density of the points, m.
    sensor
        Kind of the sensor: lasers and point clouds have scan lines, depth images have none.

    Returns
    -------
    outline : MultiPolygon
        The area that the points cover, up to the expected edges; possibly empty.
    spacing : float
        Median of the local spacing, m; 0 if there is no outline.
    """
    area, spacing = covered_area(points_xy, min_gap)
    return area if sensor is SensorKind.DEPTH_IMAGE else expected_area(area, spacing), spacing


def covered_area(points_xy: Float64, min_gap: float) -> tuple[MultiPolygon, float]:
    """Return the area that points cover, as disjoint parts, and their spacing, m.

    The parameters are those of `horizontal_outline`.
    """
    # Noise makes a scan line two or three fine cells wide, so that it looks like a dense surface.
    coarse = _local_spacing(*_mesh(cell_means(points_xy, min_gap)[0]))
    gap = float(np.median(coarse)) if len(coarse) else 0.0
    cell_size = max(0.5 * min_gap, THINNING_FRACTION * gap)
    points, triangles, longest = _mesh(cell_means(points_xy, cell_size)[0])
    if len(triangles) == 0:
        return MultiPolygon(), 0.0
    local = _local_spacing(points, triangles, longest)
    limit = np.maximum(min_gap, SPACING_FACTOR * np.median(local[triangles], axis=1))
    return _area_of(points, triangles[longest <= limit]), float(np.median(local))


def _mesh(points_xy: Float64) -> Mesh:
    """Triangulate points: (points (N, 2), triangles (T, 3), longest edges (T,) in m)."""
    triangles = _triangulate(points_xy)
    corners = points_xy[triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return points_xy, triangles, longest.max(axis=1, initial=0.0)


def _area_of(points_xy: Float64, triangles: Int64) -> MultiPolygon:
    """Return the area that triangles cover; edges of only one triangle form its border."""
    if len(triangles) == 0:
        return MultiPolygon()
    a, b = triangles, triangles[:, [1, 2, 0]]
    keys = (np.minimum(a, b) * len(points_xy) + np.maximum(a, b)).ravel()
    keys, uses = np.unique(keys, return_counts=True)
    edges = np.stack(np.divmod(keys[uses == 1], len(points_xy)), axis=1)
    border = np.round(points_xy[edges] / GRID) * GRID
    lines = shapely.multilinestrings(shapely.linestrings(border))
    return polygons_of(shapely.make_valid(shapely.build_area(lines)))


def _triangulate(points_xy: Float64) -> Int64:
    """Return the Delaunay triangles, int64 (T, 3); none if all points are collinear."""
    if len(points_xy) < 3:
        return np.zeros((0, 3), np.int64)
    try:
        return Delaunay(points_xy - points_xy.mean(axis=0)).simplices.astype(np.int64)
    except QhullError:
        return np.zeros((0, 3), np.int64)


def _local_spacing(points_xy: Float64, triangles: Int64, longest: Float64) -> Float64:
    """Return the local spacing at each point, float64 (N,), m; empty without triangles.

    The gap of a point is the longest edge of its triangles: the distance between scan lines, even
    if the distance between the beams of a line is a hundredth of that.
    """
    if len(triangles) == 0:
        return np.zeros(0)
    own = np.zeros(len(points_xy))
    np.maximum.at(own, triangles.ravel(), np.repeat(longest, 3))
    count = min(NEIGHBOURS, len(points_xy))
    _, near = cKDTree(points_xy).query(points_xy, k=count)
    rank = int(QUANTILE * (count - 1))
    return np.partition(own[near.reshape(-1, count)], rank, axis=1)[:, rank]


def expected_area(area: MultiPolygon, spacing: float) -> MultiPolygon:
    """Widen an outline of scan lines to its expected edges.

    Parameters
    ----------
    area
        Area that the points of a view cover, m.
    spacing
        Distance of its scan lines, m.

    Returns
    -------
    MultiPolygon
        One or more parts for each of `area`; parts may overlap.
    """
    aside = min(max(SIDE_EDGE_FRACTION * spacing, MIN_SIDE_EDGE), MAX_SIDE_EDGE)
    wide = [part.buffer(aside, join_style="mitre", mitre_limit=MITRE_LIMIT) for part in area.geoms]
    return MultiPolygon([p for part in wide for p in polygons_of(part).geoms])
