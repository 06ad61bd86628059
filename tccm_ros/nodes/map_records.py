"""Plain Python records of the surface map, converted from messages of tccm_interfaces."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from tccm_interfaces.msg import Compartment, FoundObject, Localisation, SurfaceEvent
from tccm_interfaces.srv import CheckBox

from tccm_ros.arrays import Float64
from tccm_ros.records.building import pose_from_message, stamp_ns_from_message

EVENT_KINDS = {
    getattr(SurfaceEvent, name): name.lower()
    for name in (
        "APPEARED", "MOVED", "MERGED", "SPLIT", "GONE", "OBJECT_APPEARED", "OBJECT_LEFT"
    )
}  # fmt: skip

LOCALISATION_STATES = {
    getattr(Localisation, name): name.lower()
    for name in ("UNKNOWN", "TRACKING", "SEARCHING", "LOST")
}

FACE_STATES = {
    getattr(Compartment, f"FACE_{name}"): name.lower() for name in ("UNKNOWN", "MEASURED", "OPEN")
}

ACCESS_STATES = {
    getattr(FoundObject, f"ACCESS_{name}"): name.lower() for name in ("UNKNOWN", "FREE", "BLOCKED")
}

BOX_STATES = {
    getattr(CheckBox.Response, name): name.lower() for name in ("UNKNOWN", "FREE", "OCCUPIED")
}


Item = TypeVar("Item")


class Found(list[Item]):
    """Results of a query, the best or nearest first.

    Attributes
    ----------
    message
        The node's message: the number of results, or the reason why there are none.
    """

    def __init__(self, items: Iterable[Item], message: str) -> None:
        super().__init__(items)
        self.message = message


@dataclass(frozen=True, slots=True, eq=False)
class MapSurface:
    """A surface of the map.

    Attributes
    ----------
    id, label, room
        Id, semantic label and name of the room.
    T_map_surface
        float64 (4, 4), centre of the minimum-area rectangle, x along its longer side.
    size
        float64 (2,), edge lengths of that rectangle, m.
    height
        Height above the floor, m.
    area
        m2.
    boundary
        float64 (N, 3), in map, counter-clockwise from above.
    near_signs
        Texts of the signs near it.
    message
        The complete message: tccm_interfaces/Surface.
    """

    id: int
    label: str
    room: str
    T_map_surface: Float64
    size: Float64
    height: float
    area: float
    boundary: Float64
    near_signs: tuple[str, ...]
    message: Any


@dataclass(frozen=True, slots=True, eq=False)
class MapObject:
    """An object on a surface.

    Attributes
    ----------
    id, surface_id
        Id of the object, and of the surface below it.
    label, confidence
        Class and score (0 to 1) by a detector; empty and nan without one.
    T_map_object
        float64 (4, 4), centre of its box.
    size
        float64 (3,), edge lengths of the box, m.
    message
        The whole message: tccm_interfaces/SurfaceObject.
    """

    id: int
    surface_id: int
    label: str
    confidence: float
    T_map_object: Float64
    size: Float64
    message: Any


@dataclass(frozen=True, slots=True, eq=False)
class MapFoundObject:
    """An object, and from where a hand can take it.

    Attributes
    ----------
    item
        The object.
    above, front
        ``free``, ``blocked`` or ``unknown``: from above, and straight through the front of its
        compartment.
    message
        The whole message, with the obstacles: tccm_interfaces/FoundObject.
    """

    item: MapObject
    above: str
    front: str
    message: Any


@dataclass(frozen=True, slots=True, eq=False)
class MapCompartment:
    """The space over a board of a rack.

    Attributes
    ----------
    rack_id, board_id
        Id of the lowest board of its rack, and of the surface that it is over.
    T_map_front
        float64 (4, 4), middle of its front edge, x in the direction of insertion, z up.
    width, depth, height
        Clear lengths, m.
    left, right, back, ceiling
        ``measured``, ``open`` or ``unknown``.
    message
        All that is known: tccm_interfaces/Compartment.
    """

    rack_id: int
    board_id: int
    T_map_front: Float64
    width: float
    depth: float
    height: float
    left: str
    right: str
    back: str
    ceiling: str
    message: Any


@dataclass(frozen=True, slots=True, eq=False)
class MapPlacement:
    """A position where an object can be put down.

    Attributes
    ----------
    surface_id
        Id of the surface.
    T_map_object
        float64 (4, 4), centre of the object's bottom face.
    clearance
        Distance to the nearest edge or object, m.
    free_height
        Free height above, m; inf if nothing is known above.
    T_map_bases
        float64 (N, 4, 4), possible poses of the base, the best first.
    """

    surface_id: int
    T_map_object: Float64
    clearance: float
    free_height: float
    T_map_bases: Float64


@dataclass(frozen=True, slots=True, eq=False)
class MapEvent:
    """A change of the map.

    Attributes
    ----------
    kind
        ``appeared``, ``moved``, ``merged``, ``split``, ``gone``, ``object_appeared`` or
        ``object_left``.
    ids_before, ids_after
        Ids of the surfaces concerned.
    object_id
        Id of the object; -1 if only surfaces are concerned.
    label
        Label of the surface or the object.
    T_before, T_after
        float64 (4, 4), poses in map; None if there is none.
    stamp_ns
        Of the view that shows the change, ns.
    """

    kind: str
    ids_before: tuple[int, ...]
    ids_after: tuple[int, ...]
    object_id: int
    label: str
    T_before: Float64 | None
    T_after: Float64 | None
    stamp_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class MapWall:
    """A wall of the map.

    Attributes
    ----------
    id
        Id within this map; later maps may number differently.
    endpoints
        float64 (2, 3), ends of the observed extent, in map, z = 0.
    message
        The complete message: tccm_interfaces/Wall.
    """

    id: int
    endpoints: Float64
    message: Any


@dataclass(frozen=True, slots=True, eq=False)
class MapSign:
    """A door sign.

    Attributes
    ----------
    id, text
        Id, and the text on the sign.
    position, normal
        float64 (3,), centre, and unit normal of the front, in map.
    message
        The complete message: tccm_interfaces/Sign.
    """

    id: int
    text: str
    position: Float64
    normal: Float64
    message: Any


@dataclass(frozen=True, slots=True, eq=False)
class MapLocalisation:
    """Localisation state of the robot.

    Attributes
    ----------
    state
        ``unknown``, ``tracking``, ``searching`` or ``lost``.
    reason
        Reason for the state as a sentence; empty while tracking.
    T_map_base
        float64 (4, 4), pose of the base; valid only while tracking.
    message
        The complete message: tccm_interfaces/Localisation.
    """

    state: str
    reason: str
    T_map_base: Float64
    message: Any


@dataclass(frozen=True, slots=True, eq=False)
class MapApproach:
    """How the base stands at a surface, as tilt cycles measured it.

    Attributes
    ----------
    surface_id
        Of the surface.
    gap, yaw_error
        Between the footprint and the edge, m; heading less the direction straight to the edge, rad.
    distance
        Of the spot from the base's origin, m; nan without a spot.
    has_moved
        Whether the surface is elsewhere than the map has it.
    T_map_surface
        float64 (4, 4), where it is.
    message
        All that is known: the result of tccm_interfaces/ApproachSurface.
    """

    surface_id: int
    gap: float
    yaw_error: float
    distance: float
    has_moved: bool
    T_map_surface: Float64
    message: Any


@dataclass(frozen=True, slots=True, eq=False)
class MapSpot:
    """A named spot in the present map.

    Attributes
    ----------
    surface
        The surface, where it is now.
    position
        float64 (3,), the spot on it, in map; the surface's middle if the name has no spot.
    T_map_bases
        float64 (N, 4, 4), base poses from which the arm gets to the spot, the best first.
    """

    surface: MapSurface
    position: Float64
    T_map_bases: Float64


@dataclass(frozen=True, slots=True)
class BoxState:
    """Occupancy of a box.

    Attributes
    ----------
    state
        ``unknown``, ``free`` or ``occupied``.
    cycle, stamp_ns
        The newest tilt cycle that observed it, and its stamp; -1 and 0 if none did.
    """

    state: str
    cycle: int
    stamp_ns: int


@dataclass(frozen=True, slots=True)
class SavedMap:
    """A map that was saved under a name.

    Attributes
    ----------
    name
        Name for loading it.
    saved_ns
        Time of the save, ns of the clock of the machine that saved it.
    message
        The complete message: tccm_interfaces/MapInfo.
    """

    name: str
    saved_ns: int
    message: Any


def surfaces_of(messages: Iterable[Any]) -> list[MapSurface]:
    """Return tccm_interfaces/Surface messages as plain objects."""
    return [
        MapSurface(
            m.id,
            m.label,
            m.room,
            pose_from_message(m.pose),
            np.array([m.size_x, m.size_y]),
            m.height,
            m.area,
            np.array([_vector(p) for p in m.boundary.points]).reshape(-1, 3),
            tuple(m.near_signs),
            m,
        )
        for m in messages
    ]


def objects_of(messages: Iterable[Any]) -> list[MapObject]:
    """Return tccm_interfaces/SurfaceObject messages as plain objects."""
    return [
        MapObject(
            m.id,
            m.surface_id,
            m.label,
            m.confidence,
            pose_from_message(m.pose),
            _vector(m.size),
            m,
        )
        for m in messages
    ]


def found_objects_of(messages: Iterable[Any]) -> list[MapFoundObject]:
    """Return tccm_interfaces/FoundObject messages as plain objects."""
    return [
        MapFoundObject(
            objects_of([m.object])[0],
            ACCESS_STATES.get(m.above, "unknown"),
            ACCESS_STATES.get(m.front, "unknown"),
            m,
        )
        for m in messages
    ]


def compartments_of(messages: Iterable[Any]) -> list[MapCompartment]:
    """Return tccm_interfaces/Compartment messages as plain objects."""
    return [
        MapCompartment(
            m.rack_id,
            m.board_id,
            pose_from_message(m.front),
            m.width,
            m.depth,
            m.height,
            FACE_STATES.get(m.left, "unknown"),
            FACE_STATES.get(m.right, "unknown"),
            FACE_STATES.get(m.back, "unknown"),
            FACE_STATES.get(m.ceiling, "unknown"),
            m,
        )
        for m in messages
    ]


def walls_of(messages: Iterable[Any]) -> list[MapWall]:
    """Return tccm_interfaces/Wall messages as plain objects."""
    return [MapWall(m.id, np.array([_vector(p) for p in m.endpoints]), m) for m in messages]


def signs_of(messages: Iterable[Any]) -> list[MapSign]:
    """Return tccm_interfaces/Sign messages as plain objects."""
    return [MapSign(m.id, m.text, _vector(m.position), _vector(m.normal), m) for m in messages]


def placements_of(messages: Iterable[Any]) -> list[MapPlacement]:
    """Return tccm_interfaces/Placement messages as plain objects."""
    return [
        MapPlacement(
            m.surface_id,
            pose_from_message(m.pose),
            m.clearance,
            m.free_height,
            np.array([pose_from_message(base.pose) for base in m.base_poses]).reshape(-1, 4, 4),
        )
        for m in messages
    ]


def event_of(message: Any) -> MapEvent:
    """Return a tccm_interfaces/SurfaceEvent as a plain object."""
    before, after = (
        None if math.isnan(pose.position.x) else pose_from_message(pose)
        for pose in (message.pose_before, message.pose_after)
    )
    return MapEvent(
        EVENT_KINDS.get(message.kind, "unknown"),
        tuple(message.surface_ids_before),
        tuple(message.surface_ids_after),
        message.object_id,
        message.label,
        before,
        after,
        stamp_ns_from_message(message.header.stamp),
    )


def localisation_of(message: Any) -> MapLocalisation:
    """Return a tccm_interfaces/Localisation as a plain object."""
    state = LOCALISATION_STATES.get(message.state, "unknown")
    return MapLocalisation(state, message.reason, pose_from_message(message.pose.pose), message)


def approach_of(result: Any) -> MapApproach:
    """Return a result of tccm_interfaces/ApproachSurface as a plain object."""
    return MapApproach(
        result.surface_id,
        result.gap,
        result.yaw_error,
        result.distance,
        result.has_moved,
        pose_from_message(result.surface_pose),
        result,
    )


def spot_of(answer: Any) -> MapSpot:
    """Return a response of tccm_interfaces/ResolveName as a plain object."""
    bases = np.array([pose_from_message(base.pose) for base in answer.base_poses]).reshape(-1, 4, 4)
    return MapSpot(surfaces_of([answer.surface])[0], _vector(answer.spot.point), bases)


def box_state_of(answer: Any) -> BoxState:
    """Return a response of tccm_interfaces/CheckBox as a plain object."""
    return BoxState(BOX_STATES[answer.state], answer.cycle, stamp_ns_from_message(answer.stamp))


def saved_map_of(message: Any) -> SavedMap:
    """Return a tccm_interfaces/MapInfo as a plain object."""
    return SavedMap(message.name, stamp_ns_from_message(message.saved), message)


def _vector(message: Any) -> Float64:
    return np.array([message.x, message.y, message.z])
