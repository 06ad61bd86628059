"""Plain Python records of the surface map, read from messages of tccm_interfaces.

The messages may be rosidl's, or those of the rosbags typestore.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, fields
from operator import attrgetter
from typing import Any, Self, TypeVar

import numpy as np

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


def _plain(value: Any) -> Any:
    """Return a pose, stamp, point or sequence of a message as a plain value, others as they are."""
    if hasattr(value, "orientation"):
        return pose_from_message(value)
    if hasattr(value, "nanosec"):
        return stamp_ns_from_message(value)
    if hasattr(value, "z"):
        return _vector(value)
    return tuple(value) if isinstance(value, list | array | np.ndarray) else value


def _name_in(names: Sequence[str]) -> Callable[[int], str]:
    """Return the function from values of a message's constants to their names."""
    return lambda value: names[value] if value < len(names) else "unknown"


EVENT_KINDS = (
    "unknown", "appeared", "moved", "merged", "split", "gone", "object_appeared", "object_left",
)  # fmt: skip
"""Names of the constants of tccm_interfaces/SurfaceEvent, by value."""

LOCALISATION_STATES = ("unknown", "tracking", "searching", "lost")
"""Names of the states of tccm_interfaces/Localisation."""

FACE_STATES = ("unknown", "measured", "open")
"""Names of ``FACE_...`` of tccm_interfaces/Compartment."""

ACCESS_STATES = ("unknown", "free", "blocked")
"""Names of ``ACCESS_...`` of tccm_interfaces/FoundObject."""

BOX_STATES = ("unknown", "free", "occupied")
"""Names of the states of tccm_interfaces/CheckBox."""


def _from(path: str, convert: Callable[[Any], Any] = _plain) -> dict[str, Any]:
    """Return the metadata of a record's field that differs from the message's field.

    Parameters
    ----------
    path
        Field of the message, with dots into its parts; empty for the whole message.
    convert
        Conversion of its value; `_plain` by default.
    """
    return {"path": path, "convert": convert}


@dataclass(frozen=True, slots=True, eq=False)
class MapRecord:
    """Base of the records: fields of a message of the same names, unless their metadata differ.

    Attributes
    ----------
    message
        The complete message; None if the record was not read from one.
    """

    message: Any = field(default=None, kw_only=True, repr=False, compare=False)

    @classmethod
    def of(cls, message: Any) -> Self:
        """Return the record of a message."""
        values = {}
        for known in fields(cls)[1:]:
            source = known.metadata or _from(known.name)
            value = attrgetter(source["path"])(message) if source["path"] else message
            values[known.name] = source["convert"](value)
        return cls(**values, message=message)


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
class MapSurface(MapRecord):
    """A surface of the map: tccm_interfaces/Surface.

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
    first_seen_ns, last_seen_ns
        Stamps of the first and the last view that measured it, ns.
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
    first_seen_ns: int = field(metadata=_from("first_seen"))
    last_seen_ns: int = field(metadata=_from("last_seen"))


@dataclass(frozen=True, slots=True, eq=False)
class MapObject(MapRecord):
    """An object on a surface: tccm_interfaces/SurfaceObject.

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
    first_seen_ns, last_seen_ns
        Stamps of the first and the last view that measured it, ns.
    """

    id: int
    surface_id: int
    label: str
    confidence: float
    T_map_object: Float64 = field(metadata=_from("pose"))
    size: Float64
    first_seen_ns: int = field(metadata=_from("first_seen"))
    last_seen_ns: int = field(metadata=_from("last_seen"))


@dataclass(frozen=True, slots=True, eq=False)
class MapFoundObject(MapRecord):
    """An object, and from where a hand can take it: tccm_interfaces/FoundObject.

    Attributes
    ----------
    item
        The object.
    above, front
        ``free``, ``blocked`` or ``unknown``: from above, and straight through the front of its
        compartment.
    """

    item: MapObject = field(metadata=_from("object", MapObject.of))
    above: str = field(metadata=_from("above", _name_in(ACCESS_STATES)))
    front: str = field(metadata=_from("front", _name_in(ACCESS_STATES)))


@dataclass(frozen=True, slots=True, eq=False)
class MapCompartment(MapRecord):
    """The space over a board of a rack: tccm_interfaces/Compartment.

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
    """

    rack_id: int
    board_id: int
    T_map_front: Float64 = field(metadata=_from("front"))
    width: float
    depth: float
    height: float
    left: str = field(metadata=_from("left", _name_in(FACE_STATES)))
    right: str = field(metadata=_from("right", _name_in(FACE_STATES)))
    back: str = field(metadata=_from("back", _name_in(FACE_STATES)))
    ceiling: str = field(metadata=_from("ceiling", _name_in(FACE_STATES)))
    open_parts: tuple[OpenPart, ...] = field(metadata=_from("", _open_parts))


@dataclass(frozen=True, slots=True, eq=False)
class MapPlacement(MapRecord):
    """A position where an object can be put down: tccm_interfaces/Placement.

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
class MapEvent(MapRecord):
    """A change of the map: tccm_interfaces/SurfaceEvent.

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

    kind: str = field(metadata=_from("kind", _name_in(EVENT_KINDS)))
    ids_before: tuple[int, ...] = field(metadata=_from("surface_ids_before"))
    ids_after: tuple[int, ...] = field(metadata=_from("surface_ids_after"))
    object_id: int
    label: str
    T_before: Float64 | None = field(metadata=_from("pose_before", _known_pose))
    T_after: Float64 | None = field(metadata=_from("pose_after", _known_pose))
    stamp_ns: int = field(metadata=_from("header.stamp"))


@dataclass(frozen=True, slots=True, eq=False)
class MapWall(MapRecord):
    """A wall of the map: tccm_interfaces/Wall.

    Attributes
    ----------
    id
        Id within this map; later maps may number differently.
    endpoints
        float64 (2, 3), ends of the observed extent, in map, z = 0.
    observations
        Number of line measurements.
    """

    id: int
    endpoints: Float64 = field(metadata=_from("endpoints", _points))
    observations: int


@dataclass(frozen=True, slots=True, eq=False)
class MapSign(MapRecord):
    """A door sign: tccm_interfaces/Sign.

    Attributes
    ----------
    id, text
        Id, and the text on the sign.
    position, normal
        float64 (3,), centre, and unit normal of the front, in map.
    """

    id: int
    text: str
    position: Float64
    normal: Float64


@dataclass(frozen=True, slots=True, eq=False)
class MapLocalisation(MapRecord):
    """Localisation state of the robot: tccm_interfaces/Localisation.

    Attributes
    ----------
    state
        ``unknown``, ``tracking``, ``searching`` or ``lost``.
    reason
        Reason for the state as a sentence; empty while tracking.
    T_map_base
        float64 (4, 4), pose of the base; valid only while tracking.
    """

    state: str = field(metadata=_from("state", _name_in(LOCALISATION_STATES)))
    reason: str
    T_map_base: Float64 = field(metadata=_from("pose.pose"))


@dataclass(frozen=True, slots=True, eq=False)
class MapApproach(MapRecord):
    """How the base stands at a surface, as tilt cycles measured it: result of ApproachSurface.

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
    """

    surface_id: int
    gap: float
    yaw_error: float
    distance: float
    has_moved: bool
    T_map_surface: Float64 = field(metadata=_from("surface_pose"))


@dataclass(frozen=True, slots=True, eq=False)
class MapSpot(MapRecord):
    """A named spot in the present map: response of ResolveName.

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
class BoxState(MapRecord):
    """Occupancy of a box: response of CheckBox.

    Attributes
    ----------
    state
        ``unknown``, ``free`` or ``occupied``.
    cycle, stamp_ns
        The newest tilt cycle that observed it, and its stamp; -1 and 0 if none did.
    """

    state: str = field(metadata=_from("state", _name_in(BOX_STATES)))
    cycle: int
    stamp_ns: int = field(metadata=_from("stamp"))


@dataclass(frozen=True, slots=True)
class SavedMapInfo(MapRecord):
    """A map that was saved under a name: tccm_interfaces/MapInfo.

    Attributes
    ----------
    name
        Name for loading it.
    saved_ns
        Time of the save, ns of the clock of the machine that saved it.
    """

    name: str
    saved_ns: int = field(metadata=_from("saved"))
