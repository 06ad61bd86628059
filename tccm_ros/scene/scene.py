"""A solution for clients: surfaces, objects and free floor, without points and graph."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import pose, spatial
from tccm_ros.racks.compartment import Compartment
from tccm_ros.racks.unseen_space import UnseenSpace
from tccm_ros.records import PreviousPose, Surface, TransformSample
from tccm_ros.scene.base_poses import FreeFloor
from tccm_ros.surfaces.objects.object_tracks import NO_OBJECTS, TrackedObjects
from tccm_ros.surfaces.objects.scene_objects import SceneObject
from tccm_ros.tabletop.footprints import convex_hull, rectangle
from tccm_ros.tabletop.placements import Placement


class KnownSurface(NamedTuple):
    """A surface of a scene.

    Attributes
    ----------
    surface
        The surface, without its views.
    last_view_ns
        Stamp of its last view.
    message
        The complete surface as a serialised tccm_interfaces/Surface; empty if it is not needed.
    """

    surface: Surface
    last_view_ns: int
    message: bytes = b""


def known_surface(surface: Surface) -> KnownSurface:
    """Return a surface of a solution as a surface of a scene, without its message."""
    last_ns = surface.views[-1].stamp_ns if surface.views else surface.last_seen_ns
    return KnownSurface(replace(surface, views=()), last_ns)


class Scene(NamedTuple):
    """One solution for clients.

    Attributes
    ----------
    stamp_ns, frame_id
        Stamp and map frame of the solution.
    floor_z
        Height of the floor in map, m; None if it was never seen.
    objects
        Objects by surface and id.
    free_floor
        Free floor for the base; None without a level laser.
    surfaces
        Surfaces by id.
    newest_view_ns, previous_view_ns
        Stamps of the newest and the second-newest view of this session; 0: none.
    compartments
        Compartments of racks.
    unseen
        Unseen space below surfaces, if it was asked for.
    tracked
        The objects before they are assigned to surfaces.
    """

    stamp_ns: int
    frame_id: str
    floor_z: float | None
    objects: tuple[SceneObject, ...]
    free_floor: FreeFloor | None
    surfaces: tuple[KnownSurface, ...] = ()
    newest_view_ns: int = 0
    previous_view_ns: int = 0
    compartments: tuple[Compartment, ...] = ()
    unseen: tuple[UnseenSpace, ...] = ()
    tracked: TrackedObjects = NO_OBJECTS


def surface_pose(surface: Surface | PreviousPose) -> tuple[Float64, Float64]:
    """Return pose and size of the smallest rectangle around a surface's boundary.

    Returns
    -------
    T_map_surface : float64 (4, 4)
        Pose of its centre, on the plane; x along the longer side, z along the normal.
    size : float64 (2,)
        Size along x and y, m.
    """
    x, y, length, width, yaw = rectangle(convex_hull(np.ascontiguousarray(surface.boundary[:, :2])))
    normal = surface.normal
    along = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    along -= (along @ normal) * normal
    along /= np.linalg.norm(along)
    R = np.stack([along, np.cross(normal, along), normal], axis=1)
    z = (surface.offset - normal[0] * x - normal[1] * y) / normal[2]
    return pose(R, np.array([x, y, z])), np.array([length, width])


def surface_frame(surface_id: int, prefix: str) -> str:
    """Return the name of a surface's tf frame; `prefix` is that of the robot's frames."""
    return f"{prefix}surface_{surface_id}"


def frames_of_surfaces(
    surfaces: Iterable[Surface], stamp_ns: int, map_frame: str, prefix: str
) -> list[TransformSample]:
    """Return the frames of all surfaces except the floor, in map (`surface_pose`).

    Parameters
    ----------
    surfaces
        Surfaces in map.
    stamp_ns
        Stamp of the transforms.
    map_frame, prefix
        Name of the map frame, and prefix of frame names.
    """
    return [
        TransformSample(stamp_ns, map_frame, surface_frame(s.id, prefix), surface_pose(s)[0], False)
        for s in surfaces
        if s.label != "floor"
    ]


def object_pose(item: SceneObject) -> Float64:
    """Return the pose (4, 4) of an object's box in map; x along its longer horizontal side."""
    x, y, z = item.center
    return spatial(np.array([x, y, item.yaw]), z)


def placement_pose(placement: Placement) -> Float64:
    """Return the pose (4, 4) of the middle of a placed object's bottom face in map."""
    x, y, z = placement.position
    return spatial(np.array([x, y, placement.yaw]), z)
