"""Placements: poses at which a box stands wholly on a surface, clear of everything, best first.

The box is parallel to the smallest rectangle around the surface, either way round. Of all positions
the one with the most clearance is found, to `TOLERANCE_M` (`placement_kernels`).
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

from tccm_ros.arrays import Float64
from tccm_ros.tabletop.footprints import convex_hull, rectangle
from tccm_ros.tabletop.free_places import polygon_parts
from tccm_ros.tabletop.placement_kernels import best_position

TOLERANCE_M = 2e-3
"""Clearances are at most so much less than the greatest, m; chosen: an outline is not known better
than that."""

SAME_SIDE_M = 1e-6
"""A footprint whose sides differ by less is square: one yaw is enough; chosen."""

MIN_CLEARANCE_M = 1e-6
"""Placements keep at least this from everything, m, whatever is asked for: touching outlines are
no polygons; chosen."""


class Approach(StrEnum):
    """How a hand comes to a place."""

    ANY = "any"
    """Not asked: the object fits where it is put."""
    ABOVE = "above"
    """From above, and the hand is over the object."""
    FRONT = "front"
    """Straight through the front of a compartment of a rack."""


@dataclass(frozen=True, slots=True)
class PlacementRequest:
    """What is to be put down.

    Attributes
    ----------
    size_x, size_y
        Sides of the footprint, m, > 0.
    height
        Height of the object, m, > 0.
    clearance
        Distance that stays free around the footprint and above the object, m, >= 0.
    max_count
        How many placements are wanted at most; 0 for all that keep the clearance from each other.
    reach_from
        (x, y) in map, m, from where every placement is in reach; None for anywhere.
    reach
        Largest horizontal distance from `reach_from`, m; 0 for any.
    approach
        How a hand comes to the place.
    hand_width, hand_height
        Of the hand across a direction from the front, m; from above, its height over the object.
    """

    size_x: float
    size_y: float
    height: float
    clearance: float = 0.02
    max_count: int = 10
    reach_from: tuple[float, float] | None = None
    reach: float = 0.0
    approach: Approach = Approach.ANY
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
        Height that is free over the footprint, m; inf where nothing is known above.
    """

    surface: int
    position: Float64
    yaw: float
    clearance: float
    free_height: float


@dataclass(frozen=True, slots=True, eq=False)
class Overhang:
    """Something above a surface.

    Attributes
    ----------
    outline
        Seen from above, in map, m.
    height
        Height of its lower side over the surface, m.
    surface
        Id of the surface that it is; None where it is none.
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
        Outlines of what stands on it.
    overhangs
        What is above it.
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
        """What of the outline is not occupied."""
        return MultiPolygon(polygon_parts(self._outline - shapely.union_all(self._occupied)))

    @cached_property
    def yaw(self) -> float:
        """Yaw of the longer side of the smallest rectangle around the outline, rad."""
        return rectangle(convex_hull(shapely.get_coordinates(self._outline)))[4]

    @cached_property
    def max_radius(self) -> float:
        """Bound of the radius of a circle on the surface, from its area and its box, m."""
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
    """Find placements, those with the most clearance first.

    Parameters
    ----------
    surfaces
        In order of preference among equals.
    request
        What is to be put down. Footprints of two placements keep the clearance from each other.

    Returns
    -------
    list of Placement
        Surfaces are looked at in the order of what they can offer at most, until there are enough
        placements with more clearance than any that is left could have.
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
    return found


class _Candidates:
    """The free area left on one surface, parallel to the axes, and the best position in it."""

    def __init__(self, surface: PlacementSurface, request: PlacementRequest):
        self._surface, self._request = surface, request
        free_area = surface.free_area
        low = [s for s in surface.overhangs if s.height < request.height + request.clearance]
        if low:
            # The clearance counts from what is too low as from an edge.
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
        if abs(half[0] - half[1]) < SAME_SIDE_M:
            self._halves.pop()
        self._find_best(surface.inner_radius + TOLERANCE_M - float(half.min()))

    @property
    def clearance(self) -> float:
        """Clearance of the best position, m; 0 where none is left."""
        return self._best[3]

    def take(self) -> Placement:
        """Return the best position as a placement, and keep its place free from now on."""
        k, x, y, clearance = self._best
        corners = self._halves[k] * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) + (x, y)
        # A ring within the free area: what it encloses is not inside any more.
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
        """Find the best position; its clearance is at most `bound`, m."""
        limits = np.array([max(self._request.clearance, MIN_CLEARANCE_M), bound - TOLERANCE_M])
        self._best = (0, 0.0, 0.0, 0.0)
        for k, half in enumerate(self._halves):
            found = best_position(self._sides, half, self._disc, limits, TOLERANCE_M)
            if found[2] > self._best[3]:
                self._best = (k, *found)


def _ring_sides(ring: Float64) -> Float64:
    """Return the sides (N, 4) of a closed ring (N + 1, 2)."""
    return np.hstack([ring[:-1], ring[1:]])
