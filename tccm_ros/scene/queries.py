"""Queries of the surface map: surfaces and objects by conditions, and placements.

A `SurfaceQueries` belongs to one solution. It prepares the data of every surface when it is made,
so that a query takes milliseconds on a map of any size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.errors import MessageError
from tccm_ros.racks.compartment import Compartment
from tccm_ros.racks.insertions import (
    Access,
    AccessState,
    Hand,
    InsertionSpace,
    Obstacle,
    without_overlaps,
)
from tccm_ros.records import Surface
from tccm_ros.scene.base_poses import BasePose, FreeFloor
from tccm_ros.scene.words import word_parts
from tccm_ros.surfaces.objects.scene_objects import SceneObject, outline_of
from tccm_ros.tabletop.placements import (
    ApproachDirection,
    Overhang,
    Placement,
    PlacementRequest,
    PlacementSurface,
    find_placements,
)

MAX_PLACEMENTS = 100
"""Maximum number of placements of a query. Chosen: more take seconds."""

MIN_OVERHANG_HEIGHT_M = 0.05
"""Minimum height of an overhanging surface above another one, m; chosen: lower ones are beside it,
and items to put down are higher."""


@dataclass(frozen=True, slots=True)
class SurfaceFilter:
    """Conditions on a surface; by default there are none.

    Attributes
    ----------
    ids
        Ids or merged ids; empty for any.
    labels
        Labels; empty for any label except that of the floor, which `ids` or `labels` must name.
    min_confidence
        Minimum confidence of the label, 0 to 1.
    min_height, max_height
        Range of the height over the floor, m.
    min_area
        Minimum area, m2.
    near
        (x, y) in map, m; results are sorted by their distance from it. None: by id.
    max_distance
        Maximum distance of a surface's outline from `near`, m; 0 for any.
    near_sign
        Parts of the text of a sign near the surface, case-insensitive; empty for any.
    words
        Words that must all be in the label, the room, the texts of signs near the surface or the
        classes of the objects on it, case-insensitive.
    """

    ids: frozenset[int] = frozenset()
    labels: frozenset[str] = frozenset()
    min_confidence: float = 0.0
    min_height: float = -math.inf
    max_height: float = math.inf
    min_area: float = 0.0
    near: tuple[float, float] | None = None
    max_distance: float = 0.0
    near_sign: str = ""
    words: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ObjectFilter:
    """Conditions on an object, by default none, and the size of the hand for its accessibility.

    Attributes
    ----------
    labels
        Classes given by detectors; empty for any.
    surfaces
        Ids of the surfaces under the object; empty for any.
    min_size, max_size
        Minimum length of its shortest edge and maximum length of its longest edge, m.
    near
        (x, y) in map, m; results are sorted by their distance from it. None: by surface.
    max_distance
        Maximum distance of its centre from `near`, m; 0 for any.
    hand_width, hand_height
        Size of the hand, m; from above, the hand needs `hand_height` over the object.
    clearance
        Free space around the hand and the object, m.
    """

    labels: frozenset[str] = frozenset()
    surfaces: frozenset[int] = frozenset()
    min_size: float = 0.0
    max_size: float = math.inf
    near: tuple[float, float] | None = None
    max_distance: float = 0.0
    hand_width: float = 0.0
    hand_height: float = 0.0
    clearance: float = 0.02

    def accepts(self, item: SceneObject) -> bool:
        """Return whether an object meets all conditions."""
        if self.labels and item.class_id not in self.labels:
            return False
        if self.surfaces and item.surface not in self.surfaces:
            return False
        if item.size.min() < self.min_size or item.size.max() > self.max_size:
            return False
        if self.near is None or self.max_distance <= 0.0:
            return True
        return math.dist(item.center[:2], self.near) <= self.max_distance


@dataclass(frozen=True, slots=True)
class FoundObject:
    """An object and its accessibility.

    Attributes
    ----------
    item
        The object.
    above, front
        Access of a hand from above, and through the front of its compartment; the latter is
        unknown if the object is in no compartment.
    """

    item: SceneObject
    above: Access
    front: Access


class SurfaceQueries:
    """Answers queries about one solution.

    Parameters
    ----------
    surfaces
        Surfaces in map, by id.
    objects
        Objects on them, in map.
    floor_z
        Height of the floor in map, m; None if it was never seen: heights then count from z = 0.
    compartments
        Compartments of racks.
    """

    def __init__(
        self,
        surfaces: Sequence[Surface],
        objects: Sequence[SceneObject],
        floor_z: float | None,
        compartments: Sequence[Compartment] = (),
    ):
        self.surfaces = tuple(surfaces)
        self.objects = tuple(objects)
        self._objects_on: dict[int, list[SceneObject]] = {}
        for item in self.objects:
            self._objects_on.setdefault(item.surface, []).append(item)
        self._compartments = tuple(compartments)
        self._spaces: dict[int, list[InsertionSpace]] = {}
        for space in self._compartments:
            on = [_obstacle(item) for item in self._objects_on.get(space.board, ())]
            self._spaces.setdefault(space.board, []).append(InsertionSpace(space, on))
        self._heights = [s.height - (floor_z or 0.0) for s in surfaces]
        self._texts = self._texts_of_surfaces()
        self._outlines = np.array([outline_of(s) for s in surfaces], dtype=object)
        shapely.prepare(self._outlines)
        self._to_put_on = self._placement_surfaces()
        for surface in self._to_put_on:
            _ = surface.inner_radius  # a cached property

    def find_surfaces(self, wanted: SurfaceFilter) -> list[Surface]:
        """Return the surfaces that meet all conditions, by distance or by id."""
        return [self.surfaces[k] for k in self._chosen(wanted)]

    def find_placements(self, wanted: SurfaceFilter, request: PlacementRequest) -> list[Placement]:
        """Return placements on the surfaces that meet all conditions, the best first.

        Parameters
        ----------
        wanted
            Conditions on the surfaces; of placements with the same clearance the nearest is first.
        request
            Size of the item to put down, and of the hand.
        """
        chosen = self._chosen(wanted)
        if request.approach == ApproachDirection.FRONT:
            return self._through_fronts([self.surfaces[k].id for k in chosen], request)
        if request.approach == ApproachDirection.ABOVE:
            request = replace(request, height=request.height + request.hand_height)
        return find_placements([self._to_put_on[k] for k in chosen], request)

    def find_reachable(
        self,
        wanted: SurfaceFilter,
        request: PlacementRequest,
        floor: FreeFloor | None,
        max_range: float,
        robot_radius: float,
        max_bases: int,
    ) -> list[tuple[Placement, list[BasePose]]]:
        """Return the placements within range of a free base pose, with these poses.

        Parameters
        ----------
        wanted, request
            As for `find_placements`; of all placements, `MAX_PLACEMENTS` are tried.
        floor
            Free floor for the base; None if it is unknown.
        max_range, robot_radius, max_bases
            Of the arm, m, and as for `FreeFloor.base_poses`.

        Raises
        ------
        MessageError
            If the free floor is unknown.
        """
        if floor is None:
            raise MessageError("where the base can stand is not known: there is no level laser")
        every = self.find_placements(wanted, replace(request, max_count=MAX_PLACEMENTS))
        with_bases = (
            (p, floor.base_poses(p.position, max_range, robot_radius, max_bases)) for p in every
        )
        return list(islice((found for found in with_bases if found[1]), request.max_count))

    def _through_fronts(self, boards: Sequence[int], request: PlacementRequest) -> list[Placement]:
        """Return placements in the compartments over the given boards, the best first."""
        hand, x, y = Hand(request.hand_width, request.hand_height), request.size_x, request.size_y
        sizes = {(x, y, request.height): 0.0, (y, x, request.height): 0.5 * math.pi}
        found = []
        for space in (s for board in boards for s in self._spaces.get(board, ())):
            every = [
                replace(p, yaw=_wrapped(p.yaw + yaw))
                for size, yaw in sizes.items()
                for p in space.insertions(size, hand, request.clearance)
                if _is_within_arm(p, request)
            ]
            every.sort(key=lambda p: -p.clearance)
            found += without_overlaps(every, (x, y), request.clearance)
        found.sort(key=lambda p: -p.clearance)
        return found[: request.max_count or None]

    def find_objects(self, wanted: ObjectFilter) -> list[FoundObject]:
        """Return the objects that meet all conditions, by distance or by surface and id."""
        found = [item for item in self.objects if wanted.accepts(item)]
        if wanted.near is not None:
            near = np.array(wanted.near)
            found.sort(key=lambda item: float(np.hypot(*(item.center[:2] - near))))
        return [
            FoundObject(item, self._from_above(item, wanted), self._from_front(item, wanted))
            for item in found
        ]

    def _from_above(self, item: SceneObject, wanted: ObjectFilter) -> Access:
        """Return the access of a hand to an object from above."""
        k = next((k for k, s in enumerate(self.surfaces) if s.id == item.surface), None)
        if k is None:
            return Access(AccessState.UNKNOWN)
        top = float(item.center[2] + 0.5 * item.size[2]) - self.surfaces[k].height
        needed = top + wanted.hand_height + wanted.clearance
        low = [
            o
            for o in self._to_put_on[k].overhangs
            if o.height < needed and o.outline.intersects(item.footprint)
        ]
        if not low:
            return Access(AccessState.FREE)
        return Access(AccessState.BLOCKED, (), min(low, key=lambda o: o.height).surface)

    def _from_front(self, item: SceneObject, wanted: ObjectFilter) -> Access:
        """Return the access of a hand to an object through the front of its compartment."""
        hand = Hand(wanted.hand_width, wanted.hand_height)
        for space in self._spaces.get(item.surface, ()):
            if space.holds(item.center):
                return space.access(_obstacle(item), hand, wanted.clearance)
        return Access(AccessState.UNKNOWN)

    def objects_on(self, surfaces: Sequence[Surface]) -> list[SceneObject]:
        """Return the objects on the given surfaces, in the order of the surfaces."""
        return [item for surface in surfaces for item in self._objects_on.get(surface.id, ())]

    def _chosen(self, wanted: SurfaceFilter) -> list[int]:
        chosen = [
            k
            for k, surface in enumerate(self.surfaces)
            if _meets(surface, self._heights[k], self._texts[k], wanted)
        ]
        if wanted.near is None or not chosen:
            return chosen
        distances = shapely.distance(self._outlines[chosen], shapely.points(wanted.near))
        order = np.argsort(distances, kind="stable")
        if wanted.max_distance > 0.0:
            order = order[distances[order] <= wanted.max_distance]
        return [chosen[k] for k in order]

    def _texts_of_surfaces(self) -> list[str]:
        """Return label, room, near signs and object classes of each surface, in lower case."""
        classes: dict[int, list[str]] = {}
        for item in self.objects:
            classes.setdefault(item.surface, []).append(item.class_id)
        return [
            " ".join(
                [surface.label, surface.room, *surface.near, *classes.get(surface.id, ())]
            ).casefold()
            for surface in self.surfaces
        ]

    def _placement_surfaces(self) -> list[PlacementSurface]:
        occupied: dict[int, list[Polygon]] = {}
        for item in self.objects:
            occupied.setdefault(item.surface, []).append(item.footprint)
        pairs: Sequence[Sequence[int]] = ((), ())
        if len(self._outlines):
            pairs = shapely.STRtree(self._outlines).query(self._outlines, "intersects").tolist()
        above: dict[int, list[Overhang]] = {}
        clear = {(c.board, c.above): c.height for c in self._compartments}
        for k, other in zip(*pairs):
            over, under = self.surfaces[other], self.surfaces[k]
            height = clear.get((under.id, over.id), over.height - under.height)
            if height >= MIN_OVERHANG_HEIGHT_M:
                above.setdefault(k, []).append(Overhang(self._outlines[other], height, over.id))
        for k, surface in enumerate(self.surfaces):
            for space in self._compartments:
                if space.board == surface.id and space.above is None:
                    above.setdefault(k, []).append(Overhang(space.outline, space.height))
        return [
            PlacementSurface(
                surface.id,
                _seen(surface, self._outlines[k]),
                surface.normal,
                surface.offset,
                occupied.get(surface.id, ()),
                above.get(k, ()),
            )
            for k, surface in enumerate(self.surfaces)
        ]


def _obstacle(item: SceneObject) -> Obstacle:
    low, high = item.center[2] - 0.5 * item.size[2], item.center[2] + 0.5 * item.size[2]
    return Obstacle(item.id, item.footprint, float(low), float(high))


def _is_within_arm(placement: Placement, request: PlacementRequest) -> bool:
    if request.reach_from is None or request.reach <= 0.0:
        return True
    return math.dist(placement.position[:2], request.reach_from) <= request.reach


def _wrapped(yaw: float) -> float:
    return math.pi - (math.pi - yaw) % (2.0 * math.pi)


def _seen(surface: Surface, outline: shapely.Geometry) -> shapely.Geometry:
    """Return the measured part of a surface's outline: placements are not on extrapolated parts."""
    if not len(surface.boundary_seen):
        return outline
    return shapely.make_valid(Polygon(surface.boundary_seen[:, :2])).intersection(outline)


def _meets(surface: Surface, height: float, text: str, wanted: SurfaceFilter) -> bool:
    """Return whether a surface meets all conditions except those on its position.

    Parameters
    ----------
    surface, height
        The surface, and its height over the floor, m.
    text
        Text in which words are searched, in lower case.
    wanted
        The conditions.
    """
    if wanted.ids and not wanted.ids.intersection((surface.id, *surface.merged_ids)):
        return False
    if wanted.labels:
        if surface.label not in wanted.labels:
            return False
    elif surface.label == "floor" and not wanted.ids:
        return False
    sign = word_parts(wanted.near_sign)
    return (
        surface.confidence >= wanted.min_confidence
        and wanted.min_height <= height <= wanted.max_height
        and surface.area >= wanted.min_area
        and (
            not sign or any(all(part in near.casefold() for part in sign) for near in surface.near)
        )
        and all(part in text for word in wanted.words for part in word_parts(word))
    )
