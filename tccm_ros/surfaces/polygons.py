"""Polygons of outlines: parts, gaps, sides and rings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from tccm_ros.arrays import Float64
from tccm_ros.outlines.shape_models import area_moments
from tccm_ros.robust import UNIFORM_WIDTH

GRID = 1e-6
"""Grid to which outlines are snapped, m, so that unions do not depend on rounding; chosen."""

OVERLAP = 1e-3
"""Buffer of an area, m, so that it overlaps the outline that it touches. Chosen: more than rounding
of coordinates, less than any gap."""

NEARLY_WHOLE = 0.75
"""Min fraction of an area or a length that is nearly the whole: of the narrowest box of a surface
that is not angled like an L, of a seat along which a back runs. A square of 0.4 m that lost 2.5 cm
at each edge has as much."""


def close_gaps(area: shapely.Geometry, half_width: float) -> shapely.Geometry:
    """Close gaps of up to twice `half_width`, m."""
    return area.buffer(half_width, quad_segs=4).buffer(-half_width, quad_segs=4)


def box_sides(polygon: Polygon) -> Float64:
    """Return the sides of a polygon's narrowest box, float64 (2,), m, the shorter first."""
    box = np.asarray(shapely.oriented_envelope(polygon).exterior.coords)
    return np.sort(np.hypot(*np.diff(box[:3], axis=0).T))


def equal_sides(area: shapely.Geometry) -> Float64:
    """Return the sides of the rectangle with the second moments of an area, float64 (2,), m.

    The shorter side is first. A spike, or a tooth at a corner, hardly changes them.

    Parameters
    ----------
    area
        One or more polygons, not empty.
    """
    _, cov = area_moments(polygons_of(area))
    return np.sqrt(np.linalg.eigvalsh(cov).clip(0.0)) * UNIFORM_WIDTH


def largest_part(area: MultiPolygon) -> Polygon:
    """Return the polygon of the largest area; an empty polygon if there is none."""
    return min(area.geoms, key=lambda part: (-part.area, part.bounds), default=Polygon())


def union_over(outlines: Sequence[Polygon], areas: Sequence[Polygon]) -> Polygon:
    """Return the largest part of the union of outlines and of areas that only touch them."""
    grown = [area.buffer(OVERLAP, join_style="mitre") for area in areas]
    union = shapely.union_all([*outlines, *grown], grid_size=GRID)
    return largest_part(polygons_of(shapely.make_valid(union)))


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
