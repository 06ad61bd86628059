"""Objects and free places on the surfaces of the map, from the latest view of each surface."""

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

MAX_HEIGHT_DIFFERENCE = 0.10
"""Max difference in height of an object or a free place and the surface of the map under it, m;
chosen."""

OUTLINE_MARGIN = 0.05
"""Max distance of an object's centre from the outline of the surface under it, m; chosen."""

MAX_RISE = 0.05
"""Max rise of a surface's plane over `OUTLINE_MARGIN`, m: a slope of 45 deg; chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneObject:
    """The bounding box of an object on a surface, in map.

    Attributes
    ----------
    id
        Of the tabletop object.
    surface
        Id of the surface that it is on.
    center
        float64 (3,), m.
    size
        float64 (3,), edges along its own x, y and z, m.
    yaw
        Of its x axis, in (-pi/2, pi/2], rad.
    """

    id: int
    surface: int
    center: Float64
    size: Float64
    yaw: float


def scene_objects(
    solution: SurfaceSolution, cycles: Sequence[CycleResult]
) -> tuple[list[SceneObject], dict[int, list[Float64]]]:
    """Return objects and free places: for each surface those of the last tilt cycle that saw it.

    Parameters
    ----------
    solution
        The surfaces of the map.
    cycles
        Results of the tilt cycles of this session.

    Returns
    -------
    objects : list of SceneObject
        Sorted by (surface, id).
    free : dict of int to list of float64 (N, 3)
        Boundaries of free places in map, by the id of the surface.
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
        for item, (at_xy, bottom) in zip(cycle.objects, heights):
            surface = _surface_under(at_xy, bottom, current, footprints)
            if surface is not None:
                objects.append(_in_map(item, surface, T_map_odom))
        for places in cycle.free_places(_near_surfaces(cycle.planes, T_map_odom, current)):
            for ring in places.polygons:
                ring_map = transform(T_map_odom, ring)
                middle = ring_map.mean(axis=0)
                surface = _surface_under(middle[:2], middle[2], current, footprints)
                if surface is not None:
                    free.setdefault(surface, []).append(ring_map)
    return sorted(objects, key=lambda o: (o.surface, o.id)), free


def _near_surfaces(
    planes: Sequence[PlaneRecord], T_map_odom: Float64, surfaces: Sequence[Surface]
) -> list[PlaneRecord]:
    """Return the horizontal planes whose bounding boxes overlap those of surfaces, with margins."""
    margins = np.array([OUTLINE_MARGIN, OUTLINE_MARGIN, MAX_HEIGHT_DIFFERENCE + MAX_RISE])
    low = np.array([s.boundary.min(axis=0) for s in surfaces]).reshape(-1, 3) - margins
    high = np.array([s.boundary.max(axis=0) for s in surfaces]).reshape(-1, 3) + margins
    near = []
    for plane in planes:
        if plane.kind == "horizontal" and len(plane.boundary) >= 3:
            outline = transform(T_map_odom, plane.boundary)
            meets = (outline.min(axis=0) <= high) & (outline.max(axis=0) >= low)
            if meets.all(axis=1).any():
                near.append(plane)
    return near


def _bottoms(objects: Sequence[TabletopObject], T_map_odom: Float64) -> list[tuple[Float64, float]]:
    """Return position (x, y) and height of the lower side of objects, in map."""
    result = []
    for item in objects:
        center = transform(T_map_odom, item.center[None])[0]
        result.append((center[:2], float(center[2] - 0.5 * item.size[2])))
    return result


def _surface_under(
    at_xy: Float64, height: float, surfaces: Sequence[Surface], footprints: dict[int, Polygon]
) -> int | None:
    """Return the id of the surface under a position, the nearest in height; None: none."""
    best, nearest = None, MAX_HEIGHT_DIFFERENCE
    for surface in surfaces:
        z = (surface.offset - at_xy @ surface.normal[:2]) / surface.normal[2]
        if abs(z - height) < nearest and shapely.dwithin(
            footprints[surface.id], shapely.points(at_xy), OUTLINE_MARGIN
        ):
            best, nearest = surface.id, abs(z - height)
    return best


def _in_map(item: TabletopObject, surface: int, T_map_odom: Float64) -> SceneObject:
    center = transform(T_map_odom, item.center[None])[0]
    yaw = item.yaw + float(planar(T_map_odom)[2])
    yaw = 0.5 * np.pi - (0.5 * np.pi - yaw) % np.pi
    return SceneObject(item.id, surface, center, item.size, float(yaw))
