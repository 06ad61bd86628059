"""Outlines with holes as triangles, for drawing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

__all__ = ["Mesh", "triangulate"]

Array = NDArray[np.float64]


class Mesh(NamedTuple):
    """A flat piece: points float64 (V, 3), triangles int64 (T, 3), and its rings.

    The rings are the points in order: the first ``rings[0]`` points, then ``rings[1]``, ...
    """

    points: Array
    triangles: NDArray[np.int64]
    rings: tuple[int, ...]


def triangulate(rings: Sequence[Array], normal: Array) -> Mesh:
    """Triangulate one outline and its holes.

    Parameters
    ----------
    rings
        Open rings float64 (N, 3), the outline first; those of fewer than three points are left
        out. Outlines that cross themselves are split at the crossings.
    normal
        float64 (3,), of their plane.
    """
    usable = [ring for ring in rings if len(ring) >= 3]
    if not usable:
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64), ())
    axis = int(np.argmax(np.abs(normal)))
    kept = [i for i in range(3) if i != axis]
    flat = shapely.Polygon(usable[0][:, kept], [hole[:, kept] for hole in usable[1:]])
    if not flat.is_valid:
        flat = shapely.make_valid(flat)
    outlines = [ring for part in _polygons(flat) for ring in (part.exterior, *part.interiors)]
    corners = [shapely.get_coordinates(ring)[:-1] for ring in outlines]
    corners_all = np.concatenate([np.zeros((0, 2)), *corners])
    triangles = _indices(flat, corners_all)
    points = np.zeros((len(corners_all), 3))
    points[:, kept] = corners_all
    origin = usable[0].mean(axis=0)
    points[:, axis] = origin[axis] - (corners_all - origin[kept]) @ normal[kept] / normal[axis]
    return Mesh(points, triangles, tuple(len(ring) for ring in corners))


def _polygons(geometry: shapely.Geometry) -> list[shapely.Polygon]:
    return [part for part in shapely.get_parts(geometry) if part.geom_type == "Polygon"]


def _indices(flat: shapely.Geometry, corners: Array) -> NDArray[np.int64]:
    """Return the triangles of a geometry as indices into its corners, int64 (T, 3)."""
    index = {corner: i for i, corner in enumerate(map(tuple, corners.tolist()))}
    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(flat))
    found = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3]
    return np.array(
        [[index[tuple(corner)] for corner in triangle] for triangle in found.tolist()], np.int64
    ).reshape(-1, 3)
