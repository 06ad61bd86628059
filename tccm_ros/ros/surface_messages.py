"""Typed messages of the surface map (`tccm_interfaces`): surfaces, objects, walls, free areas.

docs/reference/interfaces.md describes every field. Unknown values are nan, -1, 0 or empty, as
defined in interfaces/README.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.racks.compartment import Compartment, FaceState
from tccm_ros.racks.insertions import Access, AccessState
from tccm_ros.records import EdgeState, Sign, Surface, SurfaceShape, Wall
from tccm_ros.ros.types import (
    MessageTypes,
    header_message,
    point_message,
    pose_message,
    stamp_message,
    vector_message,
)
from tccm_ros.scene.changes import Change
from tccm_ros.scene.scene import object_pose, surface_pose
from tccm_ros.surfaces.objects.scene_objects import SceneObject

if TYPE_CHECKING:  # tccm_node does not import the graph
    from tccm_ros.mapping.surface_slam import SurfaceSolution

PACKAGE = "tccm_interfaces/msg/"
SURFACE, SURFACE_OBJECT = PACKAGE + "Surface", PACKAGE + "SurfaceObject"
SURFACE_MAP, SURFACE_OBJECTS = PACKAGE + "SurfaceMap", PACKAGE + "SurfaceObjectArray"
SURFACE_EVENT, LOCALISATION = PACKAGE + "SurfaceEvent", PACKAGE + "Localisation"

SHAPES = {
    SurfaceShape.RECTANGLE: 1,
    SurfaceShape.L: 2,
    SurfaceShape.CIRCLE: 3,
    SurfaceShape.ELLIPSE: 4,
    SurfaceShape.POLYGON: 5,
    SurfaceShape.FREE: 6,
}
"""Values of `Surface.SHAPE_...`."""

EDGE_STATES = {EdgeState.SEEN: 1, EdgeState.HIDDEN: 2, EdgeState.CUT: 3}
"""Values of `Surface.EDGE_...`."""

NOTHING = -1
"""Id of an unknown surface or object that hides an edge, is above a space, or blocks an access."""

FACE_STATES = {FaceState.UNKNOWN: 0, FaceState.MEASURED: 1, FaceState.OPEN: 2}
"""Values of `Compartment.FACE_...`."""

ACCESS_STATES = {AccessState.UNKNOWN: 0, AccessState.FREE: 1, AccessState.BLOCKED: 2}
"""Values of `FoundObject.ACCESS_...`."""

TRACKING, SEARCHING = 1, 2
"""Values of `Localisation.state`."""


def message_of(types: MessageTypes, msgtype: str, record: Any, /, **others: Any) -> Any:
    """Return a message with the record's numbers and texts of the same names, and other fields."""
    common = {
        name: getattr(record, name)
        for name in types.field_names(msgtype)
        if name not in others and hasattr(record, name)
    }
    plain = {k: v.item() if isinstance(v, np.generic) else v for k, v in common.items()}
    return types.make(msgtype, **plain, **others)


def surface_message(
    types: MessageTypes, stamp_ns: int, frame_id: str, surface: Surface, floor_z: float | None
) -> Any:
    """Return a tccm_interfaces/Surface.

    Parameters
    ----------
    types, stamp_ns, frame_id
        Message classes and header.
    surface
        Surface in map.
    floor_z
        Height of the floor in map, m; None if it was never seen.
    """
    T, size = surface_pose(surface)
    hidden_by = [NOTHING if e.hidden_by is None else e.hidden_by for e in surface.edges]
    return message_of(
        types,
        SURFACE,
        surface,
        header=header_message(types, stamp_ns, frame_id),
        merged_ids=types.array("i4", surface.merged_ids),
        pose=pose_message(types, T),
        size_x=float(size[0]),
        size_y=float(size[1]),
        height=float(T[2, 3] - (floor_z or 0.0)),
        plane=types.make(
            PACKAGE + "PlaneWithCovariance",
            normal=vector_message(types, surface.normal),
            offset=float(surface.offset),
            covariance=_plane_covariance(surface, T).ravel(),
        ),
        shape=SHAPES[surface.shape],
        boundary=ring_message(types, surface.boundary),
        holes=[ring_message(types, hole) for hole in surface.holes],
        boundary_seen=ring_message(types, surface.boundary_seen),
        edges=types.array("u1", [EDGE_STATES[e.state] for e in surface.edges]),
        edge_sigmas=types.array("f8", [e.sigma for e in surface.edges]),
        hidden_by_objects=types.array("i4", [NOTHING] * len(surface.edges)),
        hidden_by_surfaces=types.array("i4", hidden_by),
        first_seen=stamp_message(types, surface.first_seen_ns),
        last_seen=stamp_message(types, surface.last_seen_ns),
        view_stamps=types.array("i8", [view.stamp_ns for view in surface.views]),
        view_keyframes=types.array("i4", [view.keyframe for view in surface.views]),
        view_points=types.array("u4", [view.points for view in surface.views]),
        near_signs=list(surface.near),
    )


def _plane_covariance(surface: Surface, T_map_surface: Float64) -> Float64:
    """Return the covariance of a surface's plane relative to its pose, as in PlaneWithCovariance.

    Returns
    -------
    float64 (3, 3) of rotations about x and y of the pose, rad, and the shift at its position, m
    """
    x, y = T_map_surface[:2, 0], T_map_surface[:2, 1]
    J = np.zeros((3, 3))
    J[0, 1:], J[1, 1:] = y, -x
    J[2] = np.r_[1.0, T_map_surface[:2, 3] - surface.centroid[:2]]
    return np.asarray(J @ surface.cov_plane @ J.T)


def object_message(types: MessageTypes, stamp_ns: int, frame_id: str, item: SceneObject) -> Any:
    """Return a tccm_interfaces/SurfaceObject.

    Parameters
    ----------
    types, stamp_ns, frame_id
        Message classes and header.
    item
        Object in map.
    """
    return message_of(
        types,
        SURFACE_OBJECT,
        item,
        header=header_message(types, stamp_ns, frame_id),
        surface_id=item.surface,
        label=item.class_id,
        confidence=math.nan if item.label is None else float(item.label.score),
        pose=pose_message(types, object_pose(item)),
        size=vector_message(types, item.size),
        first_seen=stamp_message(types, item.first_seen_ns),
        last_seen=stamp_message(types, item.last_seen_ns),
    )


def objects_message(
    types: MessageTypes, stamp_ns: int, frame_id: str, objects: Iterable[SceneObject]
) -> Any:
    """Return a tccm_interfaces/SurfaceObjectArray; arguments as for `object_message`."""
    header = header_message(types, stamp_ns, frame_id)
    made = [object_message(types, stamp_ns, frame_id, item) for item in objects]
    return types.make(SURFACE_OBJECTS, header=header, objects=made)


def typed_map_message(
    types: MessageTypes, stamp_ns: int, frame_id: str, solution: SurfaceSolution, map_name: str
) -> Any:
    """Return a tccm_interfaces/SurfaceMap of a solution.

    Parameters
    ----------
    types, stamp_ns, frame_id
        Message classes and header.
    solution
        Solution in map.
    map_name
        Name under which the map was saved or loaded; empty if it has none.
    """
    header, floor_z = header_message(types, stamp_ns, frame_id), solution.floor_z
    return types.make(
        SURFACE_MAP,
        header=header,
        name=map_name,
        floor_z=math.nan if floor_z is None else float(floor_z),
        surfaces=[
            surface_message(types, stamp_ns, frame_id, surface, floor_z)
            for surface in solution.surfaces
        ],
        objects=[object_message(types, stamp_ns, frame_id, item) for item in solution.objects],
        free_areas=_free_areas(types, solution.free_places, solution.place_size),
        compartments=[compartment_message(types, space) for space in solution.compartments],
        walls=[_wall(types, header, wall) for wall in solution.graph.walls],
        signs=[_sign(types, header, sign) for sign in solution.graph.signs],
        localisation=localisation_message(types, stamp_ns, frame_id, solution, map_name),
    )


def change_message(types: MessageTypes, frame_id: str, change: Change) -> Any:
    """Return a tccm_interfaces/SurfaceEvent of a change.

    Parameters
    ----------
    types, frame_id
        Message classes and the map's frame.
    change
        Change in map.
    """
    before, after = (
        pose_message(types, _nowhere() if T is None else T)
        for T in (change.T_before, change.T_after)
    )
    return types.make(
        SURFACE_EVENT,
        header=header_message(types, change.stamp_ns, frame_id),
        kind=int(change.kind),
        surface_ids_before=types.array("i4", change.ids_before),
        surface_ids_after=types.array("i4", change.ids_after),
        object_id=change.object_id,
        label=change.label,
        pose_before=before,
        pose_after=after,
        last_seen_before=stamp_message(types, change.last_seen_ns),
    )


def _nowhere() -> Float64:
    T = np.eye(4)
    T[:3, 3] = np.nan
    return T


def ring_message(types: MessageTypes, ring: Float64) -> Any:
    """Return a tccm_interfaces/Ring of points (N, 3)."""
    return types.make(PACKAGE + "Ring", points=types.rows("geometry_msgs/msg/Point", ring))


def _free_areas(
    types: MessageTypes, free: Mapping[int, Sequence[Float64]], size: tuple[float, float]
) -> list[Any]:
    return [
        types.make(
            PACKAGE + "FreeArea",
            surface_id=surface,
            size_x=float(size[0]),
            size_y=float(size[1]),
            outlines=[ring_message(types, ring) for ring in rings],
        )
        for surface, rings in sorted(free.items())
    ]


def compartment_message(types: MessageTypes, space: Compartment) -> Any:
    """Return a tccm_interfaces/Compartment."""
    return message_of(
        types,
        PACKAGE + "Compartment",
        space,
        rack_id=space.rack,
        board_id=space.board,
        above_id=NOTHING if space.above is None else space.above,
        front=pose_message(types, space.T_map_front),
        left=FACE_STATES[space.left],
        right=FACE_STATES[space.right],
        back=FACE_STATES[space.back],
        ceiling=FACE_STATES[space.ceiling],
        open_parts=[pose_message(types, part.T_map_part) for part in space.open_parts],
        open_part_sizes=[vector_message(types, part.size) for part in space.open_parts],
    )


def found_object_message(types: MessageTypes, item: Any, above: Access, front: Access) -> Any:
    """Return a tccm_interfaces/FoundObject.

    Parameters
    ----------
    types
        Message classes.
    item
        tccm_interfaces/SurfaceObject.
    above, front
        Whether a hand comes to it.
    """
    return types.make(
        PACKAGE + "FoundObject",
        object=item,
        above=ACCESS_STATES[above.state],
        above_blocked_by=NOTHING if above.surface is None else above.surface,
        front=ACCESS_STATES[front.state],
        front_blocked_by=types.array("i4", front.objects),
        front_blocked_by_surface=NOTHING if front.surface is None else front.surface,
        front_blocked_by_open_parts=[pose_message(types, p.T_map_part) for p in front.open_parts],
    )


def _wall(types: MessageTypes, header: Any, wall: Wall) -> Any:
    ends = np.column_stack([wall.endpoints, np.zeros(2)])
    return message_of(
        types,
        PACKAGE + "Wall",
        wall,
        header=header,
        covariance=np.ascontiguousarray(wall.covariance, np.float64).ravel(),
        endpoints=[point_message(types, end) for end in ends],
        corner_ids=types.array("i4", wall.corners),
    )


def _sign(types: MessageTypes, header: Any, sign: Sign) -> Any:
    return message_of(
        types,
        PACKAGE + "Sign",
        sign,
        header=header,
        position=point_message(types, sign.position),
        normal=vector_message(types, sign.normal),
        covariance=np.ascontiguousarray(sign.covariance, np.float64).ravel(),
        wall_id=-1 if sign.wall is None else sign.wall,
        views=len(sign.views),
    )


def localisation_message(
    types: MessageTypes,
    stamp_ns: int,
    frame_id: str,
    solution: SurfaceSolution,
    map_name: str = "",
) -> Any:
    """Return a tccm_interfaces/Localisation with the robot's pose at the stamp of a solution.

    The covariance is not known (nan).

    Parameters
    ----------
    types, stamp_ns, frame_id
        Message classes and header.
    solution
        Solution in map.
    map_name
        As in `typed_map_message`.
    """
    alignment = solution.alignment
    is_found = alignment is None or alignment.found
    T = solution.T_map_base[-1] if len(solution.trajectory) else _nowhere()
    return types.make(
        LOCALISATION,
        header=header_message(types, stamp_ns, frame_id),
        state=TRACKING if is_found else SEARCHING,
        pose=types.make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=pose_message(types, T.reshape(4, 4)),
            covariance=np.full(36, np.nan),
        ),
        sign_id=-1,
        keyframe=-1,
        map_name=map_name,
    )
