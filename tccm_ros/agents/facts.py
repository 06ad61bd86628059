"""What agents are told: plain values, with the unit in each name, in the map frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class SurfaceFacts:
    """A surface.

    Attributes
    ----------
    id, label, room
        What it is, and where; the room is empty where it is not known.
    near_signs
        Texts of the door signs near it, the nearest first.
    height_m
        Over the floor.
    length_m, width_m
        Of the smallest rectangle around it.
    area_m2
        Of its outline.
    center_m
        (x, y, z) of the rectangle's middle.
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


@dataclass(frozen=True, slots=True)
class ObjectFacts:
    """An object on a surface.

    Attributes
    ----------
    id
        Of the object.
    label
        Class that a detector gave it; empty where none did.
    surface_id
        What it stands on.
    center_m, size_m
        Of its box.
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


@dataclass(frozen=True, slots=True)
class BasePoseFacts:
    """Where the base can stand: x and y in m, yaw in rad, facing the place."""

    x_m: float
    y_m: float
    yaw_rad: float


@dataclass(frozen=True, slots=True)
class PlacementFacts:
    """Where something can be put down.

    Attributes
    ----------
    surface_id
        Of the surface.
    position_m, yaw_rad
        Middle of the object's lower side, and its yaw.
    clearance_m
        Distance to the nearest edge or object.
    base_poses
        Where the base can stand, the nearest first; empty unless they were asked for.
    """

    surface_id: int
    position_m: list[float]
    yaw_rad: float
    clearance_m: float
    base_poses: list[BasePoseFacts]


@dataclass(frozen=True, slots=True)
class ChangeFacts:
    """A change of the map.

    Attributes
    ----------
    kind
        ``appeared``, ``moved``, ``merged``, ``split``, ``gone``, ``object_appeared`` or
        ``object_left``.
    stamp_s
        Of the view that shows it.
    surface_ids, object_id
        What it concerns; -1 where it is about surfaces alone.
    label
        Of the surface or the object.
    """

    kind: str
    stamp_s: float
    surface_ids: list[int]
    object_id: int
    label: str


@dataclass(frozen=True, slots=True)
class PlacementQuestion:
    """What is to be put down: sizes in m, on which surfaces, and from where it is reached.

    Attributes
    ----------
    size_m
        Length, width and height.
    surface_ids
        Where.
    clearance_m
        Free around and above it.
    limit
        Placements at most.
    reach_m, robot_radius_m
        Of the arm and the base; 0 where the base is not asked for.
    """

    size_m: tuple[float, float, float]
    surface_ids: tuple[int, ...]
    clearance_m: float
    limit: int
    reach_m: float = 0.0
    robot_radius_m: float = 0.0


class MapSource(Protocol):
    """A map that can be asked: a saved one, or that of a running node."""

    def stamp_s(self) -> float:
        """Return the stamp of the map, s."""

    def surfaces(self) -> Sequence[SurfaceFacts]:
        """Return the surfaces but the floor, by id."""

    def objects(self) -> Sequence[ObjectFacts]:
        """Return what stands on surfaces."""

    def rooms(self) -> Sequence[str]:
        """Return the names of the rooms that have one."""

    def placements(self, question: PlacementQuestion) -> tuple[list[PlacementFacts], str]:
        """Return placements, the best first, and a sentence: how many, or why none.

        Raises
        ------
        TccmError
            If the question cannot be answered.
        """

    def changes(self) -> tuple[list[ChangeFacts], str]:
        """Return the changes that are known, the newest first, and which are not, in a sentence."""


def appearances(
    surfaces: Sequence[SurfaceFacts], objects: Sequence[ObjectFacts]
) -> list[ChangeFacts]:
    """Return when surfaces and objects were first seen."""
    came = [ChangeFacts("appeared", s.first_seen_s, [s.id], -1, s.label) for s in surfaces]
    return came + [
        ChangeFacts("object_appeared", o.first_seen_s, [o.surface_id], o.id, o.label)
        for o in objects
    ]


def newest_first(changes: Sequence[ChangeFacts]) -> list[ChangeFacts]:
    """Return changes ordered by stamp, the newest first."""
    return sorted(changes, key=lambda change: -change.stamp_s)
