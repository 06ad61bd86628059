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
from tccm_ros.racks.compartment import OpenPart
from tccm_ros.records.building import pose_from_message, stamp_ns_from_message


def _names(kind: Any, names: str, prefix: str = "") -> dict[int, str]:
    """Return the names of constants of a message type, in lower case, by value."""
    return {getattr(kind, prefix + name): name.lower() for name in names.split()}


EVENT_KINDS = _names(SurfaceEvent, "APPEARED MOVED MERGED SPLIT GONE OBJECT_APPEARED OBJECT_LEFT")
LOCALISATION_STATES = _names(Localisation, "UNKNOWN TRACKING SEARCHING LOST")
FACE_STATES = _names(Compartment, "UNKNOWN MEASURED OPEN", "FACE_")
ACCESS_STATES = _names(FoundObject, "UNKNOWN FREE BLOCKED", "ACCESS_")
BOX_STATES = _names(CheckBox.Response, "UNKNOWN FREE OCCUPIED")

Kind = TypeVar("Kind")


def _record(kind: type[Kind], source: Any, /, **others: Any) -> Kind:
    """Return the record of a message: its fields of the same names, except those in `others`."""
    names, known = kind.__dataclass_fields__, {"message": source, **others}  # type: ignore[attr-defined]
    return kind(**{n: known[n] if n in known else getattr(source, n) for n in names})


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

    @classmethod
    def of(cls, message: Any) -> MapSurface:
        """Return the record of a tccm_interfaces/Surface."""
        return _record(
            cls,
            message,
            T_map_surface=pose_from_message(message.pose),
            size=np.array([message.size_x, message.size_y]),
            boundary=np.array([_vector(p) for p in message.boundary.points]).reshape(-1, 3),
            near_signs=tuple(message.near_signs),
        )


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

    @classmethod
    def of(cls, message: Any) -> MapObject:
        """Return the record of a tccm_interfaces/SurfaceObject."""
        T, size = pose_from_message(message.pose), _vector(message.size)
        return _record(cls, message, T_map_object=T, size=size)


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

    @classmethod
    def of(cls, message: Any) -> MapFoundObject:
        """Return the record of a tccm_interfaces/FoundObject."""
        above, front = (ACCESS_STATES.get(n, "unknown") for n in (message.above, message.front))
        return cls(MapObject.of(message.object), above, front, message)


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
    open_parts
        Boxes around doors and drawers that stand open before its front.
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
    open_parts: tuple[OpenPart, ...]
    message: Any

    @classmethod
    def of(cls, message: Any) -> MapCompartment:
        """Return the record of a tccm_interfaces/Compartment."""
        faces = {
            side: FACE_STATES.get(getattr(message, side), "unknown")
            for side in ("left", "right", "back", "ceiling")
        }
        boxes = zip(message.open_parts, message.open_part_sizes)
        parts = tuple(OpenPart(pose_from_message(T), _vector(size)) for T, size in boxes)
        front = pose_from_message(message.front)
        return _record(cls, message, T_map_front=front, open_parts=parts, **faces)


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

    @classmethod
    def of(cls, message: Any) -> MapPlacement:
        """Return the record of a tccm_interfaces/Placement."""
        T, bases = pose_from_message(message.pose), _bases(message.base_poses)
        return _record(cls, message, T_map_object=T, T_map_bases=bases)


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

    @classmethod
    def of(cls, message: Any) -> MapEvent:
        """Return the record of a tccm_interfaces/SurfaceEvent."""
        before, after = (
            None if math.isnan(pose.position.x) else pose_from_message(pose)
            for pose in (message.pose_before, message.pose_after)
        )
        return _record(
            cls,
            message,
            kind=EVENT_KINDS.get(message.kind, "unknown"),
            ids_before=tuple(message.surface_ids_before),
            ids_after=tuple(message.surface_ids_after),
            T_before=before,
            T_after=after,
            stamp_ns=stamp_ns_from_message(message.header.stamp),
        )


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

    @classmethod
    def of(cls, message: Any) -> MapWall:
        """Return the record of a tccm_interfaces/Wall."""
        return cls(message.id, np.array([_vector(p) for p in message.endpoints]), message)


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

    @classmethod
    def of(cls, message: Any) -> MapSign:
        """Return the record of a tccm_interfaces/Sign."""
        position, normal = _vector(message.position), _vector(message.normal)
        return cls(message.id, message.text, position, normal, message)


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

    @classmethod
    def of(cls, message: Any) -> MapLocalisation:
        """Return the record of a tccm_interfaces/Localisation."""
        state = LOCALISATION_STATES.get(message.state, "unknown")
        return cls(state, message.reason, pose_from_message(message.pose.pose), message)


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

    @classmethod
    def of(cls, message: Any) -> MapApproach:
        """Return the record of a result of tccm_interfaces/ApproachSurface."""
        T = pose_from_message(message.surface_pose)
        return _record(cls, message, T_map_surface=T)


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

    @classmethod
    def of(cls, answer: Any) -> MapSpot:
        """Return the record of a response of tccm_interfaces/ResolveName."""
        surface = MapSurface.of(answer.surface)
        return cls(surface, _vector(answer.spot.point), _bases(answer.base_poses))


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

    @classmethod
    def of(cls, answer: Any) -> BoxState:
        """Return the record of a response of tccm_interfaces/CheckBox."""
        return cls(BOX_STATES[answer.state], answer.cycle, stamp_ns_from_message(answer.stamp))


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

    @classmethod
    def of(cls, message: Any) -> SavedMap:
        """Return the record of a tccm_interfaces/MapInfo."""
        return cls(message.name, stamp_ns_from_message(message.saved), message)


def _bases(messages: Iterable[Any]) -> Float64:
    """Return the poses float64 (N, 4, 4) of tccm_interfaces/BasePose messages."""
    return np.array([pose_from_message(base.pose) for base in messages]).reshape(-1, 4, 4)


def _vector(message: Any) -> Float64:
    return np.array([message.x, message.y, message.z])
