"""What stands on the surfaces of the map, as the latest view of each surface has it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.arrays import Float64
from tccm_ros.geometry import inverse, planar, transform
from tccm_ros.mapping.tccm import CycleResult
from tccm_ros.records import PlaneRecord, Surface, TabletopObject
from tccm_ros.surfaces.surface_slam import SurfaceSolution

__all__ = ["SceneObject", "scene_objects"]


MAX_HEIGHT_DIFFERENCE = 0.10
"""A plane of a cycle and a surface of the map are the same within this height, m."""

OUTLINE_MARGIN = 0.05
"""An object stands on a surface if its centre is within this of the outline, m."""


MAX_RISE = 0.05
"""So much a surface may rise from its outline to a point that is `OUTLINE_MARGIN` outside of it, m."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneObject:
    """A box on a surface, in map: yaw of its x axis in (-pi/2, pi/2]."""

    id: int
    surface: int
    center: Float64
    size: Float64
    yaw: float


def scene_objects(
    solution: SurfaceSolution, cycles: Sequence[CycleResult]
) -> tuple[list[SceneObject], dict[int, list[Float64]]]:
    """Collect objects and free places: for each surface those of the last cycle that saw it.

    Returns
    -------
    objects
        In map, sorted by (surface, id).
    free
        Rings float64 (N, 3) in map by surface.
    """
    footprints = {s.id: Polygon(s.boundary[:, :2]) for s in solution.surfaces}
    # In the order of sessions: the clock of an earlier one may have been ahead.
    latest = {s.id: s.views[-1].stamp_ns for s in solution.surfaces}
    stamps = solution.view_stamps_ns.tolist()
    objects: list[SceneObject] = []
    free: dict[int, list[Float64]] = {}
    for cycle in cycles:
        if cycle.stamp_ns not in stamps:
            continue
        T = solution.T_map_views[stamps.index(cycle.stamp_ns)]
        T_map_odom = T @ inverse(cycle.T_odom_base)
        current = [s for s in solution.surfaces if latest[s.id] == cycle.stamp_ns]
        heights = _bottoms(cycle.objects, T_map_odom)
        for item, (place, bottom) in zip(cycle.objects, heights):
            owner = _surface_under(place, bottom, current, footprints)
            if owner is not None:
                objects.append(_in_map(item, owner, T_map_odom))
        for places in cycle.free_places(_near_surfaces(cycle.planes, T_map_odom, current)):
            for ring in places.polygons:
                ring_map = transform(T_map_odom, ring)
                middle = ring_map.mean(axis=0)
                owner = _surface_under(middle[:2], middle[2], current, footprints)
                if owner is not None:
                    free.setdefault(owner, []).append(ring_map)
    return sorted(objects, key=lambda o: (o.surface, o.id)), free


def _near_surfaces(
    planes: Sequence[PlaneRecord], T_map_odom: Float64, surfaces: Sequence[Surface]
) -> list[PlaneRecord]:
    """Return the planes whose places could lie on a surface: their boxes, and a slack, meet."""
    slack = np.array([OUTLINE_MARGIN, OUTLINE_MARGIN, MAX_HEIGHT_DIFFERENCE + MAX_RISE])
    low = np.array([s.boundary.min(axis=0) for s in surfaces]).reshape(-1, 3) - slack
    high = np.array([s.boundary.max(axis=0) for s in surfaces]).reshape(-1, 3) + slack
    near = []
    for plane in planes:
        if plane.kind == "horizontal" and len(plane.boundary) >= 3:
            outline = transform(T_map_odom, plane.boundary)
            meets = (outline.min(axis=0) <= high) & (outline.max(axis=0) >= low)
            if meets.all(axis=1).any():
                near.append(plane)
    return near


def _bottoms(objects: Sequence[TabletopObject], T_map_odom: Float64) -> list[tuple[Float64, float]]:
    """Return where objects stand: (x, y) and the height of their lower side, in map."""
    result = []
    for item in objects:
        center = transform(T_map_odom, item.center[None])[0]
        result.append((center[:2], float(center[2] - 0.5 * item.size[2])))
    return result


def _surface_under(
    place: Float64, height: float, surfaces: Sequence[Surface], footprints: dict[int, Polygon]
) -> int | None:
    """Return the id of the surface that a place lies on, the nearest in height; None: none."""
    best, nearest = None, MAX_HEIGHT_DIFFERENCE
    for surface in surfaces:
        z = (surface.offset - place @ surface.normal[:2]) / surface.normal[2]
        if abs(z - height) < nearest and shapely.dwithin(
            footprints[surface.id], shapely.points(place), OUTLINE_MARGIN
        ):
            best, nearest = surface.id, abs(z - height)
    return best


def _in_map(item: TabletopObject, surface: int, T_map_odom: Float64) -> SceneObject:
    center = transform(T_map_odom, item.center[None])[0]
    yaw = item.yaw + float(planar(T_map_odom)[2])
    yaw = 0.5 * np.pi - (0.5 * np.pi - yaw) % np.pi
    return SceneObject(item.id, surface, center, item.size, float(yaw))
