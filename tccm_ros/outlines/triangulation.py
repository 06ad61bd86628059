"""Triangulation of planar outlines with holes: ear clipping by mapbox_earcut."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import mapbox_earcut
import numpy as np
import shapely

from tccm_ros.arrays import Float64, Int64


class FilledOutline(NamedTuple):
    """A filled outline.

    Attributes
    ----------
    points
        float64 (V, 3), m: those of the rings, one ring after the other, then the crossings of
        rings, if there are any.
    triangles
        int64 (T, 3) into `points`, counter-clockwise seen against the normal.
    rings
        Number of points of each ring.
    """

    points: Float64
    triangles: Int64
    rings: tuple[int, ...]


def fill_outline(boundary: Float64, holes: Sequence[Float64], normal: Float64) -> FilledOutline:
    """Fill a planar polygon in space with triangles.

    Parameters
    ----------
    boundary
        float64 (N, 3), open ring, m.
    holes
        Rings as `boundary`; they stay empty. Rings of fewer than three points are ignored.
    normal
        Unit normal float64 (3,).

    Returns
    -------
    FilledOutline
        Without triangles if the boundary encloses no area, and without points if it has fewer than
        three.
    """
    if len(boundary) < 3:
        return FilledOutline(np.zeros((0, 3)), np.zeros((0, 3), np.int64), ())
    rings = [ring for ring in (boundary, *holes) if len(ring) >= 3]
    origin, axes = boundary.mean(axis=0), _tangents(normal)
    points, lengths = np.concatenate(rings), tuple(len(ring) for ring in rings)
    flat = np.split((points - origin) @ axes.T, np.cumsum(lengths)[:-1])
    corners, triangles = fill_rings(flat)
    crossings = corners[len(points) :] @ axes + origin
    return FilledOutline(np.concatenate([points, crossings]), triangles, lengths)


def fill_rings(rings: Sequence[Float64]) -> tuple[Float64, Int64]:
    """Fill a polygon in the plane with triangles.

    Parameters
    ----------
    rings
        Open rings float64 (N, 2), N >= 3, the outline first, then holes, in any orientation. If
        they cross or touch, they are repaired by `shapely.make_valid`.

    Returns
    -------
    corners : float64 (V, 2)
        Corners of the rings, then those of the parts into which crossing rings are split.
    triangles : int64 (T, 3)
        Counter-clockwise.
    """
    corners = np.concatenate(rings)
    polygon = shapely.Polygon(rings[0], rings[1:])
    if polygon.is_valid:
        return corners, _clip_ears(rings)
    triangles = [np.zeros((0, 3), np.int64)]
    for part in shapely.get_parts(shapely.make_valid(polygon)):
        if isinstance(part, shapely.Polygon):
            split = [shapely.get_coordinates(r)[:-1] for r in (part.exterior, *part.interiors)]
            triangles.append(_clip_ears(split) + len(corners))
            corners = np.concatenate([corners, *split])
    return corners, np.concatenate(triangles)


def _clip_ears(rings: Sequence[Float64]) -> Int64:
    """Return triangles (T, 3) of the corners of rings that do not cross, counter-clockwise."""
    corners = np.concatenate(rings)
    ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
    triangles = mapbox_earcut.triangulate_float64(corners, ends).reshape(-1, 3).astype(np.int64)
    first, second = (corners[triangles[:, k]] - corners[triangles[:, 0]] for k in (1, 2))
    return triangles[first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0] > 0.0]


def _tangents(normal: Float64) -> Float64:
    """Return two rows u, v (2, 3) with u x v = normal."""
    x, y, z = normal.tolist()
    normal_times = np.array([(0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)])
    u = -normal_times[:, np.argmin(np.abs(normal))]  # cross product with the most orthogonal axis
    u /= math.sqrt(u @ u)
    return np.stack([u, normal_times @ u])
