"""Planar polygons in space, filled with triangles."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon

from tccm_ros.ros.triangles import clip_ears

__all__ = ["fill_polygon", "triangulate"]


def triangulate(
    boundary: NDArray[np.float64],
    holes: Sequence[NDArray[np.float64]],
    normal: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Fill a planar polygon with triangles.

    Parameters
    ----------
    boundary
        float64 (N, 3), open ring, m.
    holes
        Rings as `boundary`; they stay empty.
    normal
        Unit normal float64 (3,).

    Returns
    -------
    float64 (M, 3, 3)
        Corners of M triangles, counter-clockwise seen against the normal; M = 0 where the ring
        encloses nothing.
    """
    corners, triangles = fill_polygon(boundary, holes, normal)
    return corners[triangles]


def fill_polygon(
    boundary: NDArray[np.float64],
    holes: Sequence[NDArray[np.float64]],
    normal: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return corners (V, 3), those of the rings first, and triangles (M, 3) of them."""
    rings = [ring for ring in (boundary, *holes) if len(ring) >= 3]
    if len(boundary) < 3:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    corners = np.concatenate(rings)
    origin, axes = boundary.mean(axis=0), _tangents(normal)
    xy, ends = (corners - origin) @ axes.T, np.cumsum([len(ring) for ring in rings])
    triangles = clip_ears(xy, ends)
    if len(triangles):
        return corners, triangles
    # Rings that cross: what they enclose is worked out by a polygon library.
    polygon = shapely.make_valid(Polygon(xy[: ends[0]], np.split(xy, ends[:-1])[1:]))
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    parts = shapely.orient_polygons(parts[shapely.area(parts) > 0.0])
    found = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
    triangles = np.arange(len(found), dtype=np.int32).reshape(-1, 3) + len(corners)
    return np.concatenate([corners, found @ axes + origin]), triangles


def _tangents(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return two rows u, v (2, 3) with u x v = normal."""
    nx, ny, nz = normal.tolist()
    # The axis that is least along the normal, times the normal.
    least = min(abs(nx), abs(ny), abs(nz))
    if abs(nx) == least:
        ux, uy, uz = 0.0, -nz, ny
    elif abs(ny) == least:
        ux, uy, uz = nz, 0.0, -nx
    else:
        ux, uy, uz = -ny, nx, 0.0
    length = math.hypot(ux, uy, uz)
    ux, uy, uz = ux / length, uy / length, uz / length
    v = (ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux)
    return np.array([(ux, uy, uz), v])
