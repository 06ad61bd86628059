"""The area of a surface in which a rectangle fits, as the footprint of an object of a given size.

The area that the rectangle can cover in a polygon is exact, by Minkowski sums of the polygon's
edges.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from tccm_ros.arrays import Float64

MIN_AREA_M2 = 1e-9
"""A smaller polygon or hole is a line or a point, m2: rounding gives up to 1e-15 for 1 m."""


def where_fits(room: BaseGeometry, size: tuple[float, float], yaw: float) -> list[Float64]:
    """Return the area that a rectangle can cover inside a polygon, at either of two yaws.

    Parameters
    ----------
    room
        Polygon or MultiPolygon, m.
    size
        Width and depth of the rectangle, m.
    yaw
        Direction of its width or its depth, rad.

    Returns
    -------
    list of float64 (N, 2)
        Outer rings, open, counter-clockwise; by size, then position. Every point of the area is in
        a rectangle inside the room. An area with a hole is cut in two, so that rings suffice.
    """
    w, d = size
    covered = [_opening(room, w, d, yaw)]
    if abs(w - d) > 1e-9:
        covered.append(_opening(room, d, w, yaw))
    return [
        ring for polygon in polygon_parts(shapely.union_all(covered)) for ring in _rings(polygon)
    ]


def _opening(room: BaseGeometry, width: float, depth: float, yaw: float) -> BaseGeometry:
    corners = rectangle_corners(width, depth, yaw)
    # Centres at which the rectangle is inside the room, and the area that it covers there. The
    # rectangle is symmetric, so it equals its own reflection.
    centres = room.difference(_swept(room, corners))
    return shapely.union_all([centres, _swept(centres, corners)])


def rectangle_corners(width: float, depth: float, yaw: float) -> Float64:
    """Return the corners of a rectangle around the origin.

    Parameters
    ----------
    width, depth
        Sides along its own x and y axes, m.
    yaw
        Yaw of its x axis, rad.

    Returns
    -------
    float64 (4, 2)
        Counter-clockwise, m.
    """
    c, s = math.cos(yaw), math.sin(yaw)
    corners = 0.5 * np.array([[width, depth], [-width, depth], [-width, -depth], [width, -depth]])
    return np.asarray(corners @ np.array([[c, s], [-s, c]]), np.float64)


def _swept(shape: BaseGeometry, rectangle: Float64) -> BaseGeometry:
    """Return the union of the rectangle at all points of a shape's boundary."""
    edges = [
        np.stack([ring[:-1], ring[1:]], axis=1)
        for polygon in polygon_parts(shape)
        for ring in (np.asarray(r.coords) for r in (polygon.exterior, *polygon.interiors))
    ]
    if not edges:
        return Polygon()
    ends = np.concatenate(edges)
    corners = (ends[:, :, None, :] + rectangle).reshape(len(ends), -1, 2)
    return shapely.union_all(shapely.convex_hull(shapely.multipoints(corners)))


def polygon_parts(shape: BaseGeometry) -> list[Polygon]:
    """Return the polygons of any geometry, without its lines and points, the largest first.

    Holes that are lines or points, as of polygons that touch themselves, are filled.
    """
    parts = [p for p in getattr(shape, "geoms", [shape]) if isinstance(p, Polygon)]
    parts = [_without_specks(p) for p in parts if p.area > MIN_AREA_M2]
    return sorted(parts, key=lambda p: (-p.area, p.bounds))


def _without_specks(polygon: Polygon) -> Polygon:
    holes = [hole for hole in polygon.interiors if Polygon(hole).area > MIN_AREA_M2]
    return polygon if len(holes) == len(polygon.interiors) else Polygon(polygon.exterior, holes)


def _rings(polygon: Polygon) -> Iterator[Float64]:
    """Yield outer rings; a polygon with holes is cut through the middle of its first hole."""
    if not polygon.interiors:
        yield np.asarray(orient(polygon, 1.0).exterior.coords)[:-1]
        return
    low_x, low_y, high_x, high_y = polygon.bounds
    cut = polygon.interiors[0].centroid.x
    for half in (
        shapely.box(low_x - 1, low_y - 1, cut, high_y + 1),
        shapely.box(cut, low_y - 1, high_x + 1, high_y + 1),
    ):
        for part in polygon_parts(polygon.intersection(half)):
            yield from _rings(part)
