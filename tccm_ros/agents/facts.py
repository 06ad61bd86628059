"""Plain values for agents, in the map frame, with the unit in each name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from tccm_ros.geometry import planar
from tccm_ros.report.entities import rounded, seconds
from tccm_ros.ros.map_records import MapEvent, MapObject, MapPlacement, MapSurface


@dataclass(frozen=True, slots=True)
class SurfaceFacts:
    """A surface.

    Attributes
    ----------
    id, label, room
        Id, label and room; the room is empty if unknown.
    near_signs
        Texts of the door signs near it, the nearest first.
    height_m
        Height above the floor.
    length_m, width_m
        Edges of the smallest rectangle around it.
    area_m2
        Area of its outline.
    center_m
        Centre (x, y, z) of the rectangle.
    first_seen_s, last_seen_s
        Stamps of the first and the last view that measured it.
    """

    id: int
    label: str
    room: str
    near_signs: list[str]
    height_m: float
    length_m: float
    width_m: float
    area_m2: float
    center_m: list[float]
    first_seen_s: float
    last_seen_s: float

    @classmethod
    def of(cls, surface: MapSurface) -> SurfaceFacts:
        """Return the facts of a surface of a map."""
        height, length, width, area = rounded([surface.height, *surface.size, surface.area])
        return cls(
            id=surface.id,
            label=surface.label,
            room=surface.room,
            near_signs=list(surface.near_signs),
            height_m=height,
            length_m=length,
            width_m=width,
            area_m2=area,
            center_m=rounded(surface.T_map_surface[:3, 3]),
            first_seen_s=seconds(surface.first_seen_ns),
            last_seen_s=seconds(surface.last_seen_ns),
        )


@dataclass(frozen=True, slots=True)
class ObjectFacts:
    """An object on a surface.

    Attributes
    ----------
    id
        Id of the object.
    label
        Class assigned by a detector; empty if there is none.
    surface_id
        Id of the surface below it.
    center_m, size_m
        Centre and size of its box.
    first_seen_s, last_seen_s
        Stamps of the first and the last view that measured it.
    """

    id: int
    label: str
    surface_id: int
    center_m: list[float]
    size_m: list[float]
    first_seen_s: float
    last_seen_s: float

    @classmethod
    def of(cls, item: MapObject) -> ObjectFacts:
        """Return the facts of an object of a map."""
        return cls(
            id=item.id,
            label=item.label,
            surface_id=item.surface_id,
            center_m=rounded(item.T_map_object[:3, 3]),
            size_m=rounded(item.size),
            first_seen_s=seconds(item.first_seen_ns),
            last_seen_s=seconds(item.last_seen_ns),
        )


@dataclass(frozen=True, slots=True)
class BasePoseFacts:
    """A pose of the base: x and y in m, yaw in rad, facing the placement."""

    x_m: float
    y_m: float
    yaw_rad: float


@dataclass(frozen=True, slots=True)
class PlacementFacts:
    """A position where an object can be put down.

    Attributes
    ----------
    surface_id
        Id of the surface.
    position_m, yaw_rad
        Centre of the object's bottom face, and its yaw.
    clearance_m
        Distance to the nearest edge or object.
    base_poses
        Possible poses of the base, the nearest first; empty unless requested.
    """

    surface_id: int
    position_m: list[float]
    yaw_rad: float
    clearance_m: float
    base_poses: list[BasePoseFacts]

    @classmethod
    def of(cls, placement: MapPlacement) -> PlacementFacts:
        """Return the facts of a placement."""
        T = placement.T_map_object
        yaw, clearance = rounded([planar(T)[2], placement.clearance])
        bases = [BasePoseFacts(*rounded(pose)) for pose in planar(placement.T_map_bases)]
        return cls(placement.surface_id, rounded(T[:3, 3]), yaw, clearance, bases)


@dataclass(frozen=True, slots=True)
class ChangeFacts:
    """A change of the map.

    Attributes
    ----------
    kind
        ``appeared``, ``moved``, ``merged``, ``split``, ``gone``, ``object_appeared`` or
        ``object_left``.
    stamp_s
        Stamp of the view that shows it.
    surface_ids, object_id
        Ids concerned; the object's is -1 if only surfaces are.
    label
        Label of the surface or the object.
    """

    kind: str
    stamp_s: float
    surface_ids: list[int]
    object_id: int
    label: str

    @classmethod
    def of(cls, event: MapEvent) -> ChangeFacts:
        """Return the facts of a change."""
        ids = list(event.ids_after or event.ids_before)
        return cls(event.kind, seconds(event.stamp_ns), ids, event.object_id, event.label)


@dataclass(frozen=True, slots=True)
class PlacementQuery:
    """Request for placements: object size in m, surfaces, and range of the arm.

    Attributes
    ----------
    size_m
        Length, width and height.
    surface_ids
        Candidate surfaces.
    clearance_m
        Free distance around and above the object.
    limit
        Maximum number of placements.
    reach_m, robot_radius_m
        Range of the arm and radius of the base; 0 without base poses.
    """

    size_m: tuple[float, float, float]
    surface_ids: tuple[int, ...]
    clearance_m: float
    limit: int
    reach_m: float = 0.0
    robot_radius_m: float = 0.0


@dataclass(frozen=True, slots=True)
class ApproachFacts:
    """How the base stands at a surface after an approach.

    Attributes
    ----------
    surface_id
        Id of the surface.
    gap_m, yaw_error_rad
        Distance between the footprint and the edge, and heading less the direction straight to it,
        as measured on arrival.
    has_moved
        Whether the surface is elsewhere than the map has it.
    """

    surface_id: int
    gap_m: float
    yaw_error_rad: float
    has_moved: bool


class Motion(Protocol):
    """A base that drives to surfaces; each method blocks until it stands.

    Raises
    ------
    TccmError
        With the reason why the base did not get there.
    """

    def approach(self, surface_id: int, spot: str, gap_m: float) -> ApproachFacts:
        """Drive to a surface, or to a spot unless its name is empty; gap 0 for the default."""

    def retreat(self, distance_m: float) -> float:
        """Drive straight back; return the distance driven, m."""

    def stop(self) -> None:
        """Stop the base and end the drive in progress."""


class MapSource(Protocol):
    """A map to query: a saved one, or that of a running node.

    Attributes
    ----------
    changes_note
        A sentence about the changes that `changes` contains.
    """

    changes_note: str

    @property
    def stamp_ns(self) -> int:
        """Stamp of the map, ns.

        Raises
        ------
        MapError
            Before the first map.
        """

    @property
    def surfaces(self) -> Sequence[MapSurface]:
        """The surfaces, by id."""

    @property
    def objects(self) -> Sequence[MapObject]:
        """The objects on surfaces."""

    @property
    def rooms(self) -> Sequence[str]:
        """The names of the named rooms, sorted."""

    def placements(self, query: PlacementQuery) -> tuple[Sequence[MapPlacement], str]:
        """Return placements, the best first, and a sentence about their number or absence.

        Raises
        ------
        TccmError
            If the request cannot be answered.
        """

    def changes(self) -> Sequence[MapEvent]:
        """Return the known changes; surfaces and objects of the map may be left out."""
