"""Polygons of outlines: parts, gaps, narrowest boxes and rings."""

from __future__ import annotations

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from tccm_ros.arrays import Float64

GRID = 1e-6
"""Outlines are snapped to this grid, m, so that unions do not depend on rounding; chosen."""


def close_gaps(area: shapely.Geometry, half_width: float) -> shapely.Geometry:
    """Close gaps of up to twice `half_width`, m."""
    return area.buffer(half_width, quad_segs=4).buffer(-half_width, quad_segs=4)


def box_sides(polygon: Polygon) -> Float64:
    """Return the sides of a polygon's narrowest box, float64 (2,), m, the shorter first."""
    box = np.asarray(shapely.oriented_envelope(polygon).exterior.coords)
    return np.sort(np.hypot(*np.diff(box[:3], axis=0).T))


def largest_part(area: MultiPolygon) -> Polygon:
    """Return the polygon of the largest area; an empty one where there is none."""
    return min(area.geoms, key=lambda part: (-part.area, part.bounds), default=Polygon())


def polygons_of(geometry: shapely.Geometry) -> MultiPolygon:
    """Return the polygons of any geometry, without its lines and points."""
    parts = [g for g in shapely.get_parts(geometry) if isinstance(g, Polygon) and not g.is_empty]
    return MultiPolygon(parts)


def polygon_rings(polygon: Polygon) -> tuple[Float64, tuple[Float64, ...]]:
    """Return a polygon's rings, open, in a canonical order.

    Returns
    -------
    boundary : float64 (N, 2)
        Counter-clockwise, from the vertex with the smallest (x, y).
    holes : tuple of float64 (N, 2)
        Clockwise, each from its smallest vertex, sorted by it.
    """
    oriented = shapely.geometry.polygon.orient(polygon, 1.0)
    holes = [_open_ring(ring) for ring in oriented.interiors]
    return _open_ring(oriented.exterior), tuple(sorted(holes, key=lambda ring: tuple(ring[0])))


def _open_ring(ring: shapely.LinearRing) -> Float64:
    points = np.asarray(ring.coords, float)[:-1, :2]
    first = int(np.lexsort((points[:, 1], points[:, 0]))[0])
    return np.roll(points, -first, axis=0)
