"""Placements: poses at which a box stands wholly on a surface, clear of everything, best first.

The clearance of a rectangle at a position is the distance of that position from the outline of the
area of all its positions inside the room: both are the distance of two sets, one of them shifted by
the other (Minkowski sum). So the position with the most clearance is the middle of that area's
largest inscribed circle, and the answer is exact for the two yaws that are tried.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from tccm_ros.arrays import Float64
from tccm_ros.tabletop.footprints import convex_hull, rectangle
from tccm_ros.tabletop.free_places import (
    polygon_parts,
    rectangle_corners,
    rectangle_positions,
)

CIRCLE_TOLERANCE_M = 5e-4
"""Tolerance of the largest inscribed circle, m; chosen: far below the noise of an outline."""

GRID_M = 1e-6
"""Rooms are snapped to this grid, m: differences of polygons fail at denormal numbers; chosen."""

SAME_SIDE_M = 1e-6
"""A footprint whose sides differ by less is square: one yaw is enough; chosen."""


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
    """

    size_x: float
    size_y: float
    height: float
    clearance: float = 0.02
    max_count: int = 10
    reach_from: tuple[float, float] | None = None
    reach: float = 0.0


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
        Of the side `size_x`, in (-pi/2, pi], rad.
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
class Shelter:
    """Something above a surface.

    Attributes
    ----------
    outline
        Seen from above, in map, m.
    height
        Of its lower side over the surface, m.
    """

    outline: Polygon
    height: float


@dataclass(frozen=True, eq=False)
class PlacementSurface:
    """A surface on which objects can be put down.

    Attributes
    ----------
    id
        Of the surface.
    room
        Polygons of the surface less the footprints of what stands on it, in map, m.
    normal, offset
        Its plane: unit normal float64 (3,), up; ``normal . p = offset``, m.
    shelters
        What is above it.
    """

    id: int
    room: shapely.Geometry
    normal: Float64
    offset: float
    shelters: tuple[Shelter, ...] = ()

    @cached_property
    def yaw(self) -> float:
        """Yaw of the longer side of the smallest rectangle around the room, rad."""
        return rectangle(convex_hull(shapely.get_coordinates(self.room)))[4]

    @cached_property
    def inner_radius(self) -> float:
        """Radius of the largest circle in the room, m; 0 where there is no room."""
        return _largest_circle(self.room)[1]

    def prepare(self) -> None:
        """Compute what every question needs."""
        _ = self.yaw, self.inner_radius

    def lift(self, x: float, y: float) -> Float64:
        """Return the point (3,) of the plane at x, y."""
        nx, ny, nz = self.normal
        return np.array([x, y, (self.offset - nx * x - ny * y) / nz])


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
        No surface is looked at whose largest circle leaves less clearance than what was found.
    """
    half_width = 0.5 * min(request.size_x, request.size_y)
    queue: list[tuple[float, int, _Candidates | None]] = []
    for k, surface in enumerate(surfaces):
        bound = surface.inner_radius - half_width
        if bound >= request.clearance:
            queue.append((-bound, k, None))
    heapq.heapify(queue)
    found: list[Placement] = []
    while queue and (request.max_count == 0 or len(found) < request.max_count):
        _, k, candidates = heapq.heappop(queue)
        if candidates is None:
            candidates = _Candidates(surfaces[k], request)
        else:
            found.append(candidates.take())
        if candidates.clearance >= max(request.clearance, CIRCLE_TOLERANCE_M):
            heapq.heappush(queue, (-candidates.clearance, k, candidates))
    return found


class _Candidates:
    """The positions left on one surface, by yaw, and the best of them."""

    def __init__(self, surface: PlacementSurface, request: PlacementRequest):
        self._surface, self._request = surface, request
        sides = request.size_x, request.size_y
        room = shapely.set_precision(surface.room, GRID_M)
        low = [s for s in surface.shelters if s.height < request.height + request.clearance]
        if low:
            # The clearance counts from what is too low as from an edge.
            room = room.difference(shapely.union_all([shelter.outline for shelter in low]))
        yaws = [surface.yaw, surface.yaw + 0.5 * math.pi]
        if abs(sides[0] - sides[1]) < SAME_SIDE_M:
            yaws.pop()
        self._corners = [rectangle_corners(*sides, yaw) for yaw in yaws]
        self._yaws = [math.pi - (math.pi - yaw) % (2 * math.pi) for yaw in yaws]
        self._areas = [_polygons(rectangle_positions(room, c)) for c in self._corners]
        self._best = self._find_best()

    @property
    def clearance(self) -> float:
        """That of the best position, m; 0 where none is left."""
        return self._best[0]

    def take(self) -> Placement:
        """Return the best position as a placement, and keep its place free from now on."""
        clearance, k, x, y = self._best
        footprint = self._corners[k] + (x, y)
        taken = Polygon(footprint)
        # Another footprint keeps the clearance from this one: as if this were an obstacle.
        for n, corners in enumerate(self._corners):
            sums = (footprint[:, None, :] + corners).reshape(-1, 2)
            blocked = shapely.convex_hull(shapely.multipoints(sums))
            self._areas[n] = _polygons(self._areas[n].difference(blocked))
        above = [s.height for s in self._surface.shelters if s.outline.intersects(taken)]
        self._best = self._find_best()
        yaw = self._yaws[k]
        return Placement(
            self._surface.id,
            self._surface.lift(x, y),
            yaw,
            clearance,
            min(above, default=math.inf),
        )

    def _find_best(self) -> tuple[float, int, float, float]:
        """Return clearance, index of the yaw and position of the best; clearance 0 for none."""
        best = (0.0, -1, 0.0, 0.0)
        for k, area in enumerate(self._areas):
            (x, y), radius = self._best_in(area)
            if radius > best[0]:
                best = (radius, k, x, y)
        return best

    def _best_in(self, area: shapely.Geometry) -> tuple[tuple[float, float], float]:
        """Return the position with the most clearance that is in reach, and that clearance."""
        request = self._request
        if request.reach_from is None or request.reach <= 0.0:
            return _largest_circle(area)
        base = shapely.points(request.reach_from)
        best = _largest_circle(area)
        if best[1] <= 0.0 or shapely.distance(base, shapely.points(best[0])) <= request.reach:
            return best
        inside = area.buffer(-max(request.clearance, CIRCLE_TOLERANCE_M))
        in_reach = _polygons(inside.intersection(base.buffer(request.reach)))
        if in_reach.is_empty:
            return best[0], 0.0
        # The widest part of what is in reach, or as near to the best of all as reach goes.
        near = shapely.shortest_line(in_reach, shapely.points(best[0]))
        tried = shapely.points([_largest_circle(in_reach)[0], shapely.get_coordinates(near)[0]])
        clearances = np.where(
            shapely.intersects(in_reach.buffer(SAME_SIDE_M), tried),
            shapely.distance(shapely.boundary(area), tried),
            0.0,
        )
        k = int(np.argmax(clearances))
        return (float(tried[k].x), float(tried[k].y)), float(clearances[k])


def _polygons(shape: shapely.Geometry) -> MultiPolygon:
    return MultiPolygon(polygon_parts(shape))


def _largest_circle(area: shapely.Geometry) -> tuple[tuple[float, float], float]:
    """Return middle and radius of the largest circle in polygons; radius 0 where there are none."""
    if area.is_empty:
        return (0.0, 0.0), 0.0
    line = shapely.maximum_inscribed_circle(area, tolerance=CIRCLE_TOLERANCE_M)
    middle = shapely.get_coordinates(line)[0]
    return (float(middle[0]), float(middle[1])), float(line.length)
