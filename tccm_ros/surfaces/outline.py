"""The outline of a patch of points, with holes, at the scale of its local point spacing.

The points of a horizontal surface are triangulated in x and y. A triangle belongs to the surface if
its longest edge is not much longer than the local spacing: scan lines on a far table have distances
of decimetres, while a distance of decimetres between dense points of a near table is a gap.

The scan lines run around the robot, one beyond the other. The far edge of a surface is between the
last line that hit it and the next line; at its near edge, lines hit the front of the object.
Sideways, a line ends one or two beams before the edge, as a beam that hits an edge in part is a
mixed pixel. So an outline is moved away from the robot by much, and widened by little.
"""

from __future__ import annotations

import numpy as np
import shapely
from scipy.spatial import Delaunay, QhullError, cKDTree
from shapely import MultiPolygon
from shapely.geometry.polygon import orient

from tccm_ros.arrays import Float64, Int64
from tccm_ros.surfaces.polygons import GRID, polygons_of
from tccm_ros.surfaces.thinning import cell_means

SPACING_FACTOR = 2.2
"""A triangle longer than this many local spacings bridges a gap; chosen: twice, and noise."""

NEIGHBOURS = 24
"""Number of nearest points over which the local spacing is taken; chosen."""

THINNING_FRACTION = 0.25
"""Points are thinned to this fraction of the local spacing, that between scan lines; chosen."""

QUANTILE = 0.4
"""Quantile of the neighbours' largest gaps that is the local spacing; chosen: less than half, as
along a border up to half of the neighbours have a gap across it."""

FAR_EDGE_FRACTION = 0.35
"""The far edge is expected this fraction of the lines' distance beyond the last one; chosen: less
than half, as the union of several views takes the furthest edge of each."""

MAX_FAR_EDGE = 0.025
"""The far edge is moved by at most this, m; chosen."""

SIDE_EDGE_FRACTION = 0.15
"""Sideways, the edge is expected this fraction of the lines' distance further out; chosen."""

MIN_SIDE_EDGE, MAX_SIDE_EDGE = 0.004, 0.0125
"""Limits of the distance by which an outline is widened, m; chosen: the lower one is half the
distance of beams of 0.5 deg at 1 m."""

MITRE_LIMIT = 2.0
"""Corners of a widened outline move by at most this many times its distance; chosen."""

Mesh = tuple[Float64, Int64, Float64]
"""Points, triangles and longest edges, as of `_mesh`."""


def horizontal_outline(points_xy: Float64, min_gap: float) -> tuple[MultiPolygon, float]:
    """Return the outline of the points of a surface that one view saw, and their spacing.

    Parameters
    ----------
    points_xy
        float64 (N, 2), m, without duplicates, in the base frame: the robot is at the origin.
    min_gap
        Gaps up to this are closed however dense the points are, m.

    Returns
    -------
    outline : MultiPolygon
        The area that the points cover, with far edges where they are expected; possibly empty.
    spacing : float
        Median of the local spacing, m; 0 where there is no outline.
    """
    area, spacing = covered_area(points_xy, min_gap)
    return expected_area(area, spacing), spacing


def covered_area(points_xy: Float64, min_gap: float) -> tuple[MultiPolygon, float]:
    """Return the area that points cover, as disjoint parts, and their spacing, m.

    The parameters are those of `horizontal_outline`; the points may be in any frame.
    """
    # Noise makes a scan line two or three fine cells wide: they seem to be of a dense surface.
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
    """Return the area that triangles cover: edges of only one triangle are its border."""
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
    """Return the Delaunay triangles, int64 (T, 3); none where all points are on one line."""
    if len(points_xy) < 3:
        return np.zeros((0, 3), np.int64)
    try:
        return Delaunay(points_xy - points_xy.mean(axis=0)).simplices.astype(np.int64)
    except QhullError:
        return np.zeros((0, 3), np.int64)


def _local_spacing(points_xy: Float64, triangles: Int64, longest: Float64) -> Float64:
    """Return the spacing around each point, float64 (N,), m; of no triangles, none.

    A point's own gap is the longest edge of its triangles: the distance between scan lines, even
    where the distance between the beams of a line is a hundredth of that.
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
    """Move the far edges of an outline out to where they are expected.

    Parameters
    ----------
    area
        What the points of a view cover, m, in the base frame: the robot is at the origin.
    spacing
        Distance of the scan lines there, m.

    Returns
    -------
    MultiPolygon
        One or more parts for each of `area`; parts may overlap.
    """
    far = min(FAR_EDGE_FRACTION * spacing, MAX_FAR_EDGE)
    aside = min(max(SIDE_EDGE_FRACTION * spacing, MIN_SIDE_EDGE), MAX_SIDE_EDGE)
    moved = [_with_far_edges_moved(part, far) for part in area.geoms]
    wide = [part.buffer(aside, join_style="mitre", mitre_limit=MITRE_LIMIT) for part in moved]
    return MultiPolygon([p for part in wide for p in polygons_of(part).geoms])


def _with_far_edges_moved(part: shapely.Polygon, distance: float) -> shapely.Geometry:
    """Return the area that a polygon passes when it moves away from the origin by a distance, m.

    On each ray from the origin the polygon is some intervals. Moving out, each passes itself and
    what its far end passes: so only edges that face away from the origin add something.
    """
    oriented = orient(part)
    bands = []
    for ring in (oriented.exterior, *oriented.interiors):
        xy = np.asarray(ring.coords)
        start, end = xy[:-1], xy[1:]
        outward = (end - start)[:, ::-1] * (1.0, -1.0)  # the polygon is to the left
        is_far = np.einsum("ij,ij->i", outward, start) > 0.0
        start, end = start[is_far], end[is_far]
        moved = [_away(end, distance), _away(start, distance)]
        bands.append(np.stack([start, end, *moved], axis=1))
    quads = shapely.make_valid(shapely.polygons(np.concatenate(bands)))
    return shapely.union_all([part, *quads], grid_size=GRID)


def _away(xy: Float64, distance: float) -> Float64:
    """Move points (N, 2) away from the origin by a distance, m."""
    radius = np.maximum(np.hypot(xy[:, 0], xy[:, 1]), GRID)
    return np.asarray(xy * (1.0 + distance / radius)[:, None], np.float64)
