"""Surfaces as collision objects for a planning scene: boxes and meshes with poses, as plain data.

A box is what shape_msgs/SolidPrimitive wants, a mesh what shape_msgs/Mesh wants; messages are made
where message classes are known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from tccm_ros.geometry import pose
from tccm_ros.records import Surface

__all__ = ["Box", "Mesh", "surface_box", "surface_mesh"]

Float64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """A box: T_map_box float64 (4, 4), of its middle, and size float64 (3,), m."""

    T_map_box: Float64
    size: Float64


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """A closed mesh in map: vertices float64 (N, 3), triangles int64 (M, 3), normals outwards."""

    vertices: Float64
    triangles: NDArray[np.int64]


def surface_box(surface: Surface, thickness: float = 0.02) -> Box:
    """Return the smallest box under a surface's outline; its top lies in the surface's plane.

    Holes and notches are filled: a planner that avoids the box avoids the surface.
    """
    rectangle = shapely.oriented_envelope(Polygon(surface.boundary[:, :2]))
    corners = np.asarray(rectangle.exterior.coords)[:4]
    edge = corners[1] - corners[0]
    x = np.array([*edge, 0.0]) / np.linalg.norm(edge)
    x -= (x @ surface.normal) * surface.normal
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(surface.normal, x), surface.normal], axis=1)
    local = surface.boundary @ R
    low, high = local.min(axis=0), local.max(axis=0)
    size = np.array([high[0] - low[0], high[1] - low[1], thickness])
    middle = np.array([*(0.5 * (low + high))[:2], surface.offset - 0.5 * thickness])
    return Box(pose(R, R @ middle), size)


def surface_mesh(surface: Surface, thickness: float = 0.02) -> Mesh:
    """Return the slab under a surface, with its holes and its true outline."""
    rings = [surface.boundary, *surface.holes]
    top = np.concatenate(rings)
    polygon = Polygon(surface.boundary[:, :2], [hole[:, :2] for hole in surface.holes])
    faces = _triangles(polygon, top[:, :2])
    count, down = len(top), thickness * surface.normal
    sides = []
    start = 0
    for ring in rings:
        a = start + np.arange(len(ring))
        b = start + (np.arange(len(ring)) + 1) % len(ring)
        sides.append(np.stack([a, a + count, b], axis=1))
        sides.append(np.stack([b, a + count, b + count], axis=1))
        start += len(ring)
    triangles = np.concatenate([faces, faces[:, ::-1] + count, *sides])
    return Mesh(np.concatenate([top, top - down]), triangles.astype(np.int64))


def _triangles(polygon: Polygon, vertices: Float64) -> NDArray[np.int64]:
    """Triangulate a polygon; int64 (T, 3) into `vertices` (N, 2), counter-clockwise."""
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    index = {tuple(v): k for k, v in enumerate(vertices.tolist())}
    faces = []
    for part in parts:
        ring = np.asarray(shapely.geometry.polygon.orient(part).exterior.coords)[:3]
        faces.append([index[tuple(v)] for v in ring.tolist()])
    return np.array(faces, np.int64).reshape(-1, 3)
