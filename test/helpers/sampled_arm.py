"""A hand and a forearm at random places, checked by a collision library against a scene and the
true solids of the simulator."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import coal
import numpy as np
import shapely
from sensor_sight import Sight
from shapely import Polygon

from tccm_ros.arrays import Float64
from tccm_ros.geometry import pose, transform
from tccm_ros.records import Surface
from tccm_ros.scene.planning_shapes import Box, Mesh
from tccm_ros.surfaces.objects.scene_objects import SceneObject

LINKS = (
    (coal.Box(0.14, 0.10, 0.06), 0.07),
    (coal.Capsule(0.045, 0.25), 0.26),
)
"""Links along the x axis of the arm, and the distances of their middles from the tip, m."""

DOT = 1e-4
"""Radius of a point for the collision library, m."""

AROUND = 0.08
"""Distance of the tip from the side of a solid or a shape, at most, m."""


LEVEL, COVERED, NEAR = 0.02, 0.9, 0.08
"""A solid is in the map if a surface is at its height, m, and covers this fraction of its top, or
an object is near its middle, m."""


class Placed(NamedTuple):
    """A geometry of the collision library at its pose in map, and the middle and half the edges of
    the box of a shape along its own axes."""

    geometry: coal.CollisionGeometry
    at: coal.Transform3s
    T_map_shape: Float64
    half: Float64


class Clearances(NamedTuple):
    """Signed distances, m, of links from the nearest true solid and the nearest shape of a scene;
    negative: depth of a penetration.

    Attributes
    ----------
    true, scene
        float64 (N,).
    """

    true: Float64
    scene: Float64

    def outside(self) -> Float64:
        """Return how deep links without contact in the scene are in solids, float64 (K,), m."""
        return np.maximum(-self.true[self.scene > 0.0], 0.0)

    def lost(self) -> Float64:
        """Return how deep links without contact in truth are in shapes, float64 (K,), m."""
        return np.maximum(-self.scene[self.true > 0.0], 0.0)


def placed_shapes(shapes: dict[str, Box | Mesh]) -> list[Placed]:
    """Return the shapes of a planning scene."""
    return [_of_mesh(s) if isinstance(s, Mesh) else _of_box(s) for s in shapes.values()]


def placed_solids(solids: Sequence, T_map_world: Float64) -> list[Placed]:
    """Return solids of the simulator that always exist."""
    found = []
    for solid in solids:
        T, half = T_map_world @ solid.T_world_solid, np.array(solid.half)
        is_box = solid.shape == "box"
        geometry = coal.Box(*(2 * half)) if is_box else coal.Cylinder(half[0], 2 * half[2])
        found.append(Placed(geometry, _transform(T), T, half))
    return found


def mapped_solids(
    solids: Sequence,
    T_map_world: Float64,
    surfaces: Sequence[Surface],
    items: Sequence[SceneObject],
) -> tuple[list, list]:
    """Return the solids whose tops are surfaces of the map, and those that are its objects.

    A surface is at the height of the top, and covers nine tenths of it; an object is at its middle.
    """
    outlines = [shapely.make_valid(Polygon(s.boundary[:, :2])) for s in surfaces]
    middles = np.array([item.center[:2] for item in items]).reshape(-1, 2)
    furniture, objects = [], []
    for solid in solids:
        T, half = T_map_world @ solid.T_world_solid, np.array(solid.half)
        if solid.role == "object" and len(middles):
            if np.hypot(*(middles - T[:2, 3]).T).min() < NEAR:
                objects.append(solid)
        elif solid.surface:
            corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half[:2]
            top = Polygon(corners @ T[:2, :2].T + T[:2, 3])
            if any(
                abs(s.height - T[2, 3] - half[2]) < LEVEL
                and outline.intersection(top).area > COVERED * top.area
                for s, outline in zip(surfaces, outlines)
            ):
                furniture.append(solid)
    return furniture, objects


def clearances(
    scene: Sequence[Placed], solids: Sequence[Placed], targets: Sequence[Placed], count: int
) -> Clearances:
    """Return the distances of the links of an arm whose tip is near targets.

    Parameters
    ----------
    scene, solids
        Shapes and true solids in map.
    targets
        Shapes or solids; the tip is within `AROUND` of one of them.
    count
        Number of arms.
    """
    rng = np.random.default_rng(0)
    rows = [
        [_distance(link, at, solids), _distance(link, at, scene)]
        for link, at in _links(rng, targets, count)
    ]
    return Clearances(*np.array(rows).T)


def seen_outside(
    solids: Sequence, scene: Sequence[Placed], sight: Sight, T_map_world: Float64, count: int
) -> Float64:
    """Return how far visible points on true solids are outside of a scene, float64 (K,), m.

    Parameters
    ----------
    solids
        Solids of the simulator.
    scene
        Shapes in map.
    sight
        Tells which points a sensor saw.
    T_map_world
        float64 (4, 4).
    count
        Number of points on each solid.
    """
    rng, dot = np.random.default_rng(0), coal.Sphere(DOT)
    points = np.concatenate([_on_surface(rng, solid, count) for solid in solids])
    place, outside = np.eye(4), []
    for point in transform(T_map_world, points[sight.sees(points)]):
        place[:3, 3] = point
        outside.append(max(_distance(dot, place, scene) + DOT, 0.0))
    return np.array(outside)


def _on_surface(rng: np.random.Generator, solid: object, count: int) -> Float64:
    """Return points on a box, or on side and top of a vertical cylinder, in the world."""
    half, points = np.array(solid.half), rng.uniform(-1.0, 1.0, (count, 3))
    if solid.shape == "box":
        areas = half.prod() / half
        face = rng.choice(3, count, p=areas / areas.sum())
        points[np.arange(count), face] = np.sign(points[np.arange(count), face])
    else:
        is_top = rng.random(count) * (half[0] + 4.0 * half[2]) < half[0]
        radius = np.where(is_top, np.sqrt(rng.random(count)), 1.0)
        angle, z = np.pi * points[:, 0], np.where(is_top, 1.0, points[:, 2])
        points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])
    return transform(solid.T_world_solid, points * half)


def _links(
    rng: np.random.Generator, targets: Sequence[Placed], count: int
) -> Iterator[tuple[coal.CollisionGeometry, Float64]]:
    """Yield the links of arms and their poses (4, 4) in map."""
    for k in rng.integers(len(targets), size=count):
        target = targets[k]
        tip = rng.uniform(-1.0, 1.0, 3) * (target.half + AROUND)
        tip = target.T_map_shape[:3, :3] @ tip + target.T_map_shape[:3, 3]
        yaw, pitch = rng.uniform(-np.pi, np.pi), rng.uniform(-0.2, 0.5 * np.pi)
        c, s = np.cos([yaw, pitch]), np.sin([yaw, pitch])
        R = np.array([[c[0], -s[0], 0.0], [s[0], c[0], 0.0], [0.0, 0.0, 1.0]])
        R = R @ np.array([[c[1], 0.0, -s[1]], [0.0, 1.0, 0.0], [s[1], 0.0, c[1]]])
        for geometry, away in LINKS:
            turned = R if isinstance(geometry, coal.Box) else R[:, [1, 2, 0]]
            yield geometry, pose(turned, tip + away * R[:, 0])


def _distance(link: coal.CollisionGeometry, T_map_link: Float64, others: Sequence[Placed]) -> float:
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    at, nearest = _transform(T_map_link), np.inf
    for other in others:
        result.clear()
        nearest = min(nearest, coal.distance(link, at, other.geometry, other.at, request, result))
    return nearest


def _of_box(shape: Box) -> Placed:
    T, (x, _, z) = shape.T_map_box, shape.size
    geometry = coal.Cylinder(0.5 * x, z) if shape.is_round else coal.Box(*shape.size)
    return Placed(geometry, _transform(T), T, 0.5 * shape.size)


def _of_mesh(shape: Mesh) -> Placed:
    model = coal.BVHModelOBBRSS()
    corners, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    corners.extend(list(shape.vertices))
    faces.extend([coal.Triangle(*map(int, row)) for row in shape.triangles])
    model.beginModel(len(shape.triangles), len(shape.vertices))
    model.addSubModel(corners, faces)
    model.endModel()
    low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
    T = pose(np.eye(3), 0.5 * (low + high))
    return Placed(model, _transform(np.eye(4)), T, 0.5 * (high - low))


def _transform(T: Float64) -> coal.Transform3s:
    return coal.Transform3s(T[:3, :3].copy(), T[:3, 3].copy())
