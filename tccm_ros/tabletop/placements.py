"""Placements: poses at which a box is wholly on a surface, clear of all obstacles, best first.

The box is parallel to the minimum-area rectangle of the surface, at either of two yaws. The
position with the most clearance is found to within `TOLERANCE_M` (`placement_kernels`).
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from tccm_ros.arrays import Float64, LimitedNumber, Vector
from tccm_ros.tabletop.footprints import convex_hull, rectangle
from tccm_ros.tabletop.free_places import polygon_parts
from tccm_ros.tabletop.placement_kernels import best_position

TOLERANCE_M = 2e-3
"""Maximum difference of a clearance from the greatest, m; chosen: the accuracy of an outline."""

MIN_CLEARANCE_M = 1e-6
"""Minimum clearance of any placement, m, also if less is requested: touching outlines are no valid
polygons; chosen."""


class ApproachDirection(StrEnum):
    """Direction from which a hand places an object."""

    ANY = "any"
    """Any direction: only the object must fit."""
    ABOVE = "above"
    """From above; the hand is over the object."""
    FRONT = "front"
    """Straight through the front of a compartment of a rack."""


@dataclass(frozen=True, slots=True)
class PlacementRequest:
    """Object to place, and constraints of its placements.

    Attributes
    ----------
    size_x, size_y
        Sides of the footprint, m, > 0.
    height
        Height of the object, m, > 0.
    clearance
        Free distance around the footprint and above the object, m, >= 0.
    max_count
        Maximum number of placements; 0 for all that keep the clearance from each other.
    reach_from
        (x, y) in map, m, centre of the circle that contains all placements; None for any place.
    reach
        Maximum horizontal distance from `reach_from`, m; 0 for any.
    approach
        Direction from which a hand places the object.
    hand_width, hand_height
        Cross-section of the hand for insertion from the front, m; from above, the height of the
        hand above the object.
    """

    size_x: float
    size_y: float
    height: float
    clearance: float = 0.02
    max_count: int = 10
    reach_from: tuple[float, float] | None = None
    reach: float = 0.0
    approach: ApproachDirection = ApproachDirection.ANY
    hand_width: float = 0.0
    hand_height: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """A pose for an object on a surface.

    Attributes
    ----------
    surface
        Id of the surface.
    position
        float64 (3,), middle of the object's bottom, on the surface, in map, m.
    yaw
        Yaw of the side `size_x`, in (-pi, pi], rad.
    clearance
        Distance of the footprint from the nearest edge, hole, object or earlier placement, m.
    free_height
        Free height over the footprint, m; inf where no overhang is known.
    """

    surface: int
    position: Vector
    yaw: float
    clearance: float
    free_height: LimitedNumber


@dataclass(frozen=True, slots=True, eq=False)
class Overhang:
    """An obstacle above a surface.

    Attributes
    ----------
    outline
        Outline seen from above, in map, m.
    height
        Height of its underside over the surface, m.
    surface
        Its id if it is a surface, else None.
    """

    outline: Polygon
    height: float
    surface: int | None = None


class PlacementSurface:
    """A surface on which objects can be put down.

    Parameters
    ----------
    identity
        Id of the surface.
    outline
        Polygons of the surface, in map, m.
    normal, offset
        Its plane: unit normal float64 (3,), up; ``normal . p = offset``, m.
    occupied
        Outlines of the objects on it.
    overhangs
        Obstacles above it.
    """

    def __init__(
        self,
        identity: int,
        outline: shapely.Geometry,
        normal: Float64,
        offset: float,
        occupied: Sequence[Polygon] = (),
        overhangs: Sequence[Overhang] = (),
    ):
        self.id = identity
        self._outline, self._occupied = outline, occupied
        self._normal, self._offset = normal, offset
        self.overhangs = overhangs

    @cached_property
    def free_area(self) -> MultiPolygon:
        """Area of the outline that is not occupied."""
        return MultiPolygon(polygon_parts(self._outline - shapely.union_all(self._occupied)))

    @cached_property
    def yaw(self) -> float:
        """Yaw of the longer side of the outline's minimum-area rectangle, rad."""
        return rectangle(convex_hull(shapely.get_coordinates(self._outline)))[4]

    @cached_property
    def max_radius(self) -> float:
        """Upper bound of `inner_radius`, from the area and the bounding box, m."""
        low_x, low_y, high_x, high_y = self._outline.bounds
        narrow = 0.5 * min(high_x - low_x, high_y - low_y)
        return min(narrow, math.sqrt(self._outline.area / math.pi))

    @cached_property
    def inner_radius(self) -> float:
        """Radius of the largest circle in the free area, to `TOLERANCE_M`, m; 0 if none fits."""
        if self.free_area.is_empty:
            return 0.0
        return float(shapely.maximum_inscribed_circle(self.free_area, TOLERANCE_M).length)

    def lift(self, x: float, y: float) -> Float64:
        """Return the point (3,) of the plane at x, y."""
        nx, ny, nz = self._normal
        return np.array([x, y, (self._offset - nx * x - ny * y) / nz])


def find_placements(
    surfaces: Sequence[PlacementSurface], request: PlacementRequest
) -> list[Placement]:
    """Return placements, those with the most clearance first.

    Surfaces are searched in the order of an upper bound of their clearance, until there are enough
    placements with more clearance than the remaining bounds.

    Parameters
    ----------
    surfaces
        In order of preference among equal clearances.
    request
        Object to place. Footprints of two placements keep the clearance from each other.
    """
    half_width = 0.5 * min(request.size_x, request.size_y)
    queue: list[tuple[float, int, int, _Candidates | None]] = []

    def consider(bound: float, k: int, stage: int, candidates: _Candidates | None = None) -> None:
        if bound >= max(request.clearance, MIN_CLEARANCE_M):
            heapq.heappush(queue, (-bound, stage, k, candidates))

    for k, surface in enumerate(surfaces):
        consider(surface.max_radius - half_width, k, 0)
    found: list[Placement] = []
    while queue and (request.max_count == 0 or len(found) < request.max_count):
        _, stage, k, candidates = heapq.heappop(queue)
        if stage == 0:
            consider(surfaces[k].inner_radius + TOLERANCE_M - half_width, k, 1)
            continue
        if candidates is None:
            candidates = _Candidates(surfaces[k], request)
        else:
            found.append(candidates.take())
        consider(candidates.clearance, k, 2, candidates)
    # Each clearance is exact to `TOLERANCE_M` only.
    return sorted(found, key=lambda placement: -placement.clearance)


class _Candidates:
    """Remaining free area of a surface, along the surface's axes, and the best position in it."""

    def __init__(self, surface: PlacementSurface, request: PlacementRequest):
        self._surface, self._request = surface, request
        free_area = surface.free_area
        low = [s for s in surface.overhangs if s.height < request.height + request.clearance]
        if low:
            # The clearance is also kept from obstacles above that are too low.
            free_area -= shapely.union_all([overhang.outline for overhang in low])
        c, s = math.cos(surface.yaw), math.sin(surface.yaw)
        self._R_map_sides = np.array([[c, -s], [s, c]])  # xy @ R is along the surface's sides
        rings = [
            np.asarray(ring.coords) @ self._R_map_sides
            for part in polygon_parts(free_area)
            for ring in (part.exterior, *part.interiors)
        ]
        self._sides = np.concatenate([np.zeros((0, 4)), *map(_ring_sides, rings)])
        self._disc = np.array([0.0, 0.0, math.inf])
        if request.reach_from is not None and request.reach > 0.0:
            self._disc[:2] = np.array(request.reach_from) @ self._R_map_sides
            self._disc[2] = request.reach
        half = 0.5 * np.array([request.size_x, request.size_y])
        self._halves = [half, half[::-1].copy()]
        if request.size_x == request.size_y:  # one yaw is enough for a square
            self._halves.pop()
        self._find_best(surface.inner_radius + TOLERANCE_M - float(half.min()))

    @property
    def clearance(self) -> float:
        """Clearance of the best position, m; 0 if no position remains."""
        return self._best[3]

    def take(self) -> Placement:
        """Return the best position as a placement, and remove its footprint from the free area."""
        k, x, y, clearance = self._best
        corners = self._halves[k] * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) + (x, y)
        # A ring within the free area: by the even-odd rule its inside becomes outside.
        self._sides = np.concatenate([self._sides, _ring_sides(corners)])
        self._find_best(clearance)
        footprint = Polygon(corners @ self._R_map_sides.T)
        above = [s.height for s in self._surface.overhangs if s.outline.intersects(footprint)]
        yaw = self._surface.yaw + 0.5 * math.pi * k
        return Placement(
            surface=self._surface.id,
            position=self._surface.lift(*(self._R_map_sides @ (x, y)).tolist()),
            yaw=math.pi - (math.pi - yaw) % (2 * math.pi),
            clearance=clearance,
            free_height=min(above, default=math.inf),
        )

    def _find_best(self, bound: float) -> None:
        """Find the best position, given an upper bound of its clearance, m."""
        limits = np.array([max(self._request.clearance, MIN_CLEARANCE_M), bound - TOLERANCE_M])
        self._best = (0, 0.0, 0.0, 0.0)
        for k, half in enumerate(self._halves):
            found = best_position(self._sides, half, self._disc, limits, TOLERANCE_M)
            if found[2] > self._best[3]:
                self._best = (k, *found)


def _ring_sides(ring: Float64) -> Float64:
    """Return the sides (N, 4) of a closed ring (N + 1, 2)."""
    return np.hstack([ring[:-1], ring[1:]])
