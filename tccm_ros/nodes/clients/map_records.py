"""Plain Python records of the surface map, converted from messages of tccm_interfaces."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
from operator import attrgetter
from typing import Any, Self, TypeVar

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Vector3
from tccm_interfaces.msg import Compartment, FoundObject, Localisation, SurfaceEvent
from tccm_interfaces.srv import CheckBox

from tccm_ros.arrays import Float64
from tccm_ros.racks.compartment import OpenPart
from tccm_ros.records.building import pose_from_message, stamp_ns_from_message


def _vector(message: Any) -> Float64:
    return np.array([message.x, message.y, message.z])


def _points(messages: Iterable[Any]) -> Float64:
    """Return points as float64 (N, 3)."""
    return np.array([_vector(point) for point in messages]).reshape(-1, 3)


def _bases(messages: Iterable[Any]) -> Float64:
    """Return the poses float64 (N, 4, 4) of tccm_interfaces/BasePose messages."""
    return np.array([pose_from_message(base.pose) for base in messages]).reshape(-1, 4, 4)


def _open_parts(space: Any) -> tuple[OpenPart, ...]:
    """Return the open doors and drawers of a tccm_interfaces/Compartment."""
    boxes = zip(space.open_parts, space.open_part_sizes)
    return tuple(OpenPart(pose_from_message(T), _vector(size)) for T, size in boxes)


def _known_pose(pose: Any) -> Float64 | None:
    """Return a pose float64 (4, 4); None if its position is nan."""
    return None if math.isnan(pose.position.x) else pose_from_message(pose)


def _names(kind: Any, names: str, prefix: str = "") -> Callable[[int], str]:
    """Return the function from values of a message's constants to their names in lower case."""
    known = {getattr(kind, prefix + name): name.lower() for name in names.split()}
    return lambda value: known.get(value, "unknown")


EVENT_KIND = _names(SurfaceEvent, "APPEARED MOVED MERGED SPLIT GONE OBJECT_APPEARED OBJECT_LEFT")
LOCALISATION_STATE = _names(Localisation, "UNKNOWN TRACKING SEARCHING LOST")
FACE_STATE = _names(Compartment, "UNKNOWN MEASURED OPEN", "FACE_")
ACCESS_STATE = _names(FoundObject, "UNKNOWN FREE BLOCKED", "ACCESS_")
BOX_STATE = _names(CheckBox.Response, "UNKNOWN FREE OCCUPIED")

CONVERSIONS: Mapping[type, Callable[[Any], Any]] = {
    Pose: pose_from_message,
    Point: _vector,
    Vector3: _vector,
    Time: stamp_ns_from_message,
    list: tuple,
    array: tuple,
}
"""Conversion of a message's field by its type; all others are kept as they are."""


def _from(path: str, convert: Callable[[Any], Any] | None = None) -> dict[str, Any]:
    """Return the metadata of a record's field that differs from the message's field.

    Parameters
    ----------
    path
        Field of the message, with dots into its parts; empty for the whole message.
    convert
        Conversion of its value; by default that of `CONVERSIONS`.
    """
    return {"path": path, "convert": convert}


WHOLE = _from("")


class _Record:
    """Base of the records: their fields are those of a message, unless their metadata differ."""

    __slots__ = ()

    @classmethod
    def of(cls, message: Any) -> Self:
        """Return the record of a message."""
        values = {}
        for known in fields(cls):  # type: ignore[arg-type]  # each subclass is a dataclass
            path = known.metadata.get("path", known.name)
            value = attrgetter(path)(message) if path else message
            convert = known.metadata.get("convert") or CONVERSIONS.get(type(value))
            values[known.name] = value if convert is None else convert(value)
        return cls(**values)


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
class MapSurface(_Record):
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
    T_map_surface: Float64 = field(metadata=_from("pose"))
    size: Float64 = field(metadata=_from("", lambda m: np.array([m.size_x, m.size_y])))
    height: float
    area: float
    boundary: Float64 = field(metadata=_from("boundary.points", _points))
    near_signs: tuple[str, ...]
    message: Any = field(metadata=WHOLE)


@dataclass(frozen=True, slots=True, eq=False)
class MapObject(_Record):
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
    T_map_object: Float64 = field(metadata=_from("pose"))
    size: Float64
    message: Any = field(metadata=WHOLE)


@dataclass(frozen=True, slots=True, eq=False)
class MapFoundObject(_Record):
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

    item: MapObject = field(metadata=_from("object", MapObject.of))
    above: str = field(metadata=_from("above", ACCESS_STATE))
    front: str = field(metadata=_from("front", ACCESS_STATE))
    message: Any = field(metadata=WHOLE)


@dataclass(frozen=True, slots=True, eq=False)
class MapCompartment(_Record):
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
    T_map_front: Float64 = field(metadata=_from("front"))
    width: float
    depth: float
    height: float
    left: str = field(metadata=_from("left", FACE_STATE))
    right: str = field(metadata=_from("right", FACE_STATE))
    back: str = field(metadata=_from("back", FACE_STATE))
    ceiling: str = field(metadata=_from("ceiling", FACE_STATE))
    open_parts: tuple[OpenPart, ...] = field(metadata=_from("", _open_parts))
    message: Any = field(metadata=WHOLE)


@dataclass(frozen=True, slots=True, eq=False)
class MapPlacement(_Record):
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
    T_map_object: Float64 = field(metadata=_from("pose"))
    clearance: float
    free_height: float
    T_map_bases: Float64 = field(metadata=_from("base_poses", _bases))


@dataclass(frozen=True, slots=True, eq=False)
class MapEvent(_Record):
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

    kind: str = field(metadata=_from("kind", EVENT_KIND))
    ids_before: tuple[int, ...] = field(metadata=_from("surface_ids_before"))
    ids_after: tuple[int, ...] = field(metadata=_from("surface_ids_after"))
    object_id: int
    label: str
    T_before: Float64 | None = field(metadata=_from("pose_before", _known_pose))
    T_after: Float64 | None = field(metadata=_from("pose_after", _known_pose))
    stamp_ns: int = field(metadata=_from("header.stamp"))


@dataclass(frozen=True, slots=True, eq=False)
class MapWall(_Record):
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
    endpoints: Float64 = field(metadata=_from("endpoints", _points))
    message: Any = field(metadata=WHOLE)


@dataclass(frozen=True, slots=True, eq=False)
class MapSign(_Record):
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
    message: Any = field(metadata=WHOLE)


@dataclass(frozen=True, slots=True, eq=False)
class MapLocalisation(_Record):
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

    state: str = field(metadata=_from("state", LOCALISATION_STATE))
    reason: str
    T_map_base: Float64 = field(metadata=_from("pose.pose"))
    message: Any = field(metadata=WHOLE)


@dataclass(frozen=True, slots=True, eq=False)
class MapApproach(_Record):
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
    T_map_surface: Float64 = field(metadata=_from("surface_pose"))
    message: Any = field(metadata=WHOLE)


@dataclass(frozen=True, slots=True, eq=False)
class MapSpot(_Record):
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

    surface: MapSurface = field(metadata=_from("surface", MapSurface.of))
    position: Float64 = field(metadata=_from("spot.point"))
    T_map_bases: Float64 = field(metadata=_from("base_poses", _bases))


@dataclass(frozen=True, slots=True)
class BoxState(_Record):
    """Occupancy of a box.

    Attributes
    ----------
    state
        ``unknown``, ``free`` or ``occupied``.
    cycle, stamp_ns
        The newest tilt cycle that observed it, and its stamp; -1 and 0 if none did.
    """

    state: str = field(metadata=_from("state", BOX_STATE))
    cycle: int
    stamp_ns: int = field(metadata=_from("stamp"))


@dataclass(frozen=True, slots=True)
class SavedMapInfo(_Record):
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
    saved_ns: int = field(metadata=_from("saved"))
    message: Any = field(metadata=WHOLE)
