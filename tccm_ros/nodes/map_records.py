"""What the surface map tells Python nodes, as plain objects made of messages of tccm_interfaces."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from tccm_interfaces.msg import Localisation, SurfaceEvent
from tccm_interfaces.srv import CheckBox

from tccm_ros.arrays import Float64
from tccm_ros.geometry import pose_from_quaternion

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

BOX_STATES = {
    getattr(CheckBox.Response, name): name.lower() for name in ("UNKNOWN", "FREE", "OCCUPIED")
}


Item = TypeVar("Item")


class Found(list[Item]):
    """What a question found, the best or nearest first.

    Attributes
    ----------
    message
        The node's sentence: how much was found, or why nothing was.
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
        What it is.
    T_map_surface
        float64 (4, 4), middle of the smallest rectangle around it, x along the longer side.
    size
        float64 (2,), edges of that rectangle, m.
    height
        Over the floor, m.
    area
        m2.
    boundary
        float64 (N, 3), in map, counter-clockwise seen from above.
    near_signs
        Texts of the signs near it.
    message
        All that is known: tccm_interfaces/Surface.
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
    """Something that stands on a surface.

    Attributes
    ----------
    id, surface_id
        Of the object, and of the surface that it stands on.
    label, confidence
        Class and its score, 0 to 1, where a detector gave it one; else empty and nan.
    T_map_object
        float64 (4, 4), middle of its box.
    size
        float64 (3,), edges of the box, m.
    message
        All that is known: tccm_interfaces/SurfaceObject.
    """

    id: int
    surface_id: int
    label: str
    confidence: float
    T_map_object: Float64
    size: Float64
    message: Any


@dataclass(frozen=True, slots=True, eq=False)
class MapPlacement:
    """Where an object can be put down.

    Attributes
    ----------
    surface_id
        Of the surface.
    T_map_object
        float64 (4, 4), middle of the object's lower side.
    clearance
        Distance to the nearest edge or object, m.
    free_height
        Height that is free above, m; inf where nothing is known above.
    T_map_bases
        Where the base can stand, float64 (N, 4, 4), the best first.
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
        Ids of the surfaces that it concerns.
    object_id
        -1 where it is about surfaces alone.
    label
        Of the surface or the object.
    T_before, T_after
        float64 (4, 4) in map; None where there was none.
    stamp_ns
        Of the view that shows it, ns.
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
        Within this map; the next one may count otherwise.
    endpoints
        float64 (2, 3), ends of what was seen of it, in map, z = 0.
    message
        All that is known: tccm_interfaces/Wall.
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
        What it is, and says.
    position, normal
        float64 (3,), its middle, and the unit normal of its front, in map.
    message
        All that is known: tccm_interfaces/Sign.
    """

    id: int
    text: str
    position: Float64
    normal: Float64
    message: Any


@dataclass(frozen=True, slots=True, eq=False)
class MapLocalisation:
    """Whether the robot knows where it is.

    Attributes
    ----------
    state
        ``unknown``, ``tracking``, ``searching`` or ``lost``.
    reason
        Why, in a sentence; empty while tracking.
    T_map_base
        float64 (4, 4); the pose of the robot only while tracking.
    message
        All that is known: tccm_interfaces/Localisation.
    """

    state: str
    reason: str
    T_map_base: Float64
    message: Any


@dataclass(frozen=True, slots=True)
class BoxState:
    """Whether anything is in a box.

    Attributes
    ----------
    state
        ``unknown``, ``free`` or ``occupied``.
    cycle, stamp_ns
        The newest tilt cycle that says so, and its stamp; -1 and 0 where none looked there.
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
        Under which it is loaded.
    saved_ns
        When it was saved, on the clock of its machine.
    message
        All that is known: tccm_interfaces/MapInfo.
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
            _pose(m.pose),
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
        MapObject(m.id, m.surface_id, m.label, m.confidence, _pose(m.pose), _vector(m.size), m)
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
            _pose(m.pose),
            m.clearance,
            m.free_height,
            np.array([_pose(base.pose) for base in m.base_poses]).reshape(-1, 4, 4),
        )
        for m in messages
    ]


def event_of(message: Any) -> MapEvent:
    """Return a tccm_interfaces/SurfaceEvent as a plain object."""
    before, after = (
        None if math.isnan(pose.position.x) else _pose(pose)
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
        nanoseconds(message.header.stamp),
    )


def localisation_of(message: Any) -> MapLocalisation:
    """Return a tccm_interfaces/Localisation as a plain object."""
    T, state = _pose(message.pose.pose), LOCALISATION_STATES.get(message.state, "unknown")
    return MapLocalisation(state, message.reason, T, message)


def box_state_of(answer: Any) -> BoxState:
    """Return an answer of tccm_interfaces/CheckBox as a plain object."""
    return BoxState(BOX_STATES[answer.state], answer.cycle, nanoseconds(answer.stamp))


def saved_map_of(message: Any) -> SavedMap:
    """Return a tccm_interfaces/MapInfo as a plain object."""
    return SavedMap(message.name, nanoseconds(message.saved), message)


def _vector(message: Any) -> Float64:
    return np.array([message.x, message.y, message.z])


def _pose(message: Any) -> Float64:
    p, q = message.position, message.orientation
    return pose_from_quaternion([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])


def nanoseconds(stamp: Any) -> int:
    """Return a builtin_interfaces/Time, ns."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
