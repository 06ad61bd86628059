"""Insertions of an object into a compartment, straight through its front.

The swept box is as wide and high as the object or the hand, whichever is larger. It begins
`APPROACH` before the front and ends behind the object. It is free if beams passed each of its
cells, none ended there, and no object of the map is in it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.arrays import Float64
from tccm_ros.geometry import inverse, planar, transform
from tccm_ros.outlines.transformation import transform_outline
from tccm_ros.racks.compartment import Compartment, OpenPart
from tccm_ros.tabletop.free_places import rectangle_corners
from tccm_ros.tabletop.placements import Placement

APPROACH = 0.3
"""Length of the hand's straight motion before the front, m; chosen: the length of a hand."""

ON_BOARD = 0.03
"""Hits up to this height over a board belong to it, m: a cell. Lower objects have boxes."""

LOW = 0.06
"""Boxes are obstacles only for objects up to this height, m: two cells. Lower objects may have no
hits; hits on higher objects bound them more tightly than their boxes."""

FRONT_EDGE = 0.06
"""Distance before the front at which hits may still belong to the board, m: the error of its edge
is 2 cm, and of hits one cube."""

MIN_CLEARANCE = 1e-6
"""Minimum clearance, m, as `tabletop.placements.MIN_CLEARANCE_M`."""


class Hand(NamedTuple):
    """Cross-section of the hand that inserts an object.

    Attributes
    ----------
    width, height
        Size across the direction of insertion, m; the height is measured from the board.
    """

    width: float = 0.0
    height: float = 0.0


class Obstacle(NamedTuple):
    """An object of the map.

    Attributes
    ----------
    id
        Id of the object.
    footprint
        Footprint in map, m.
    low, high
        Its lowest and highest z in map, m.
    """

    id: int
    footprint: Polygon
    low: float
    high: float


class AccessState(StrEnum):
    """State of the access to an object from a direction."""

    FREE = "free"
    BLOCKED = "blocked"
    UNKNOWN = "unknown"
    """Part of the swept box was never observed, and no obstacle in it is known."""


class Access(NamedTuple):
    """Access to an object from a direction.

    Attributes
    ----------
    state
        Free, blocked or unknown.
    objects
        Ids of the blocking objects.
    surface
        Id of the blocking surface above, which is too low; None if no surface blocks.
    open_parts
        Blocking doors and drawers.
    """

    state: AccessState
    objects: tuple[int, ...] = ()
    surface: int | None = None
    open_parts: tuple[OpenPart, ...] = ()


class InsertionSpace:
    """Free space of a compartment for a hand that moves in straight through the front.

    Parameters
    ----------
    compartment
        Compartment of the map.
    obstacles
        Objects in it and before it.
    """

    def __init__(self, compartment: Compartment, obstacles: Sequence[Obstacle] = ()):
        self.compartment = compartment
        space = compartment.space
        self._x = space.corner[0] + np.arange(space.seen.shape[0] + 1) * space.cell
        self._y = space.corner[1] + np.arange(space.seen.shape[1] + 1) * space.cell
        z = space.corner[2] + np.arange(space.seen.shape[2]) * space.cell
        blocked: Any = ~space.seen
        is_board = z < ON_BOARD - 0.5 * space.cell
        at_board = self._x[:-1] >= -FRONT_EDGE
        blocked[np.ix_(at_board, np.ones(len(self._y) - 1, bool), is_board)] = False
        self._blocked, self._z = blocked, z
        self._obstacles = [self._in_front(obstacle) for obstacle in obstacles]

    def _in_front(self, obstacle: Obstacle) -> Obstacle:
        """Return an obstacle in the frame of the front."""
        T = inverse(self.compartment.T_map_front)
        footprint = transform_outline(T, obstacle.footprint)
        return Obstacle(obstacle.id, footprint, obstacle.low + T[2, 3], obstacle.high + T[2, 3])

    def depths(self, height: float, without: int | None = None) -> Float64:
        """Return the free depth of each column of cells along the front, float64 (Y,), m.

        Parameters
        ----------
        height
            Height of the inserted object over the board, m.
        without
            Id of an object to ignore, with its hits.
        """
        low = self._z < height
        blocked = self._blocked[:, :, low].any(axis=2)
        x, y = self._x[:-1] + 0.5 * self.compartment.space.cell, self._y[:-1]
        middles = np.stack(
            np.meshgrid(x, y + 0.5 * self.compartment.space.cell, indexing="ij"), axis=-1
        )
        points = shapely.points(middles)
        for obstacle in self._obstacles:
            is_named = obstacle.high > LOW and obstacle.id != without
            if is_named or obstacle.low > height or obstacle.high < 0.0:
                continue
            covered = shapely.dwithin(points, obstacle.footprint, self.compartment.space.cell)
            blocked = blocked & ~covered if obstacle.id == without else blocked | covered
        blocked[x < -APPROACH] = False
        is_any = blocked.any(axis=0)
        first = np.where(is_any, blocked.argmax(axis=0), len(x))
        return np.asarray(np.minimum(self._x[first], self.compartment.depth))

    def depth_at(self, y: float, width: float, depths: Float64) -> float:
        """Return the free depth for a width along the front, m; negative if blocked before it.

        Parameters
        ----------
        y, width
            Middle along the front, and width, m.
        depths
            Result of `depths`.
        """
        cell = self.compartment.space.cell
        first = math.ceil((y - 0.5 * width - self._y[0]) / cell - 0.5)
        last = math.floor((y + 0.5 * width - self._y[0]) / cell + 0.5)
        if first < 0 or last > len(depths):
            return -math.inf
        return float(depths[first:last].min(initial=math.inf))

    def holds(self, point: Float64) -> bool:
        """Return whether a point (3,) in map is in the compartment."""
        x, y, z = transform(inverse(self.compartment.T_map_front), point[None])[0].tolist()
        c = self.compartment
        return bool(0.0 <= x <= c.depth and abs(y) <= 0.5 * c.width and 0.0 <= z <= c.height)

    def access(self, item: Obstacle, hand: Hand, clearance: float) -> Access:
        """Return the access of a hand to an object of the compartment through the front.

        Parameters
        ----------
        item
            The object; it is removed along the same path.
        hand
            The hand that grasps it.
        clearance
            Minimum distance from the swept box to its sides and above, m.
        """
        own = self._in_front(item)
        low_x, low_y, _, high_y = own.footprint.bounds
        height = max(own.high, hand.height) + clearance
        if height > self.compartment.height:
            return Access(AccessState.BLOCKED, (), self.compartment.above)
        width, y = max(high_y - low_y, hand.width) + 2.0 * clearance, 0.5 * (low_y + high_y)
        depth = self.depth_at(y, width, self.depths(height, without=item.id))
        if depth >= low_x - self.compartment.space.cell:
            return Access(AccessState.FREE)
        way = shapely.box(-APPROACH, y - 0.5 * width, low_x, y + 0.5 * width)
        before = [o.id for o in self._obstacles if o.id != item.id and way.intersects(o.footprint)]
        parts = tuple(self._open_parts_in(way, height))
        is_blocked = bool(before or parts) or self._is_hit(y, width, height, low_x)
        state = AccessState.BLOCKED if is_blocked else AccessState.UNKNOWN
        return Access(state, tuple(before), open_parts=parts)

    def _open_parts_in(self, way: Polygon, height: float) -> Iterator[OpenPart]:
        """Yield the doors and drawers in a swept box, given in plan view and by its height."""
        T_front = inverse(self.compartment.T_map_front)
        for part in self.compartment.open_parts:
            T = T_front @ part.T_map_part
            length, width, _ = part.size.tolist()
            footprint = Polygon(rectangle_corners(length, width, planar(T)[2]) + T[:2, 3])
            if T[2, 3] - 0.5 * part.size[2] < height and way.intersects(footprint):
                yield part

    def _is_hit(self, y: float, width: float, height: float, depth: float) -> bool:
        """Return whether beams ended in a swept box."""
        cell = self.compartment.space.cell
        x, at = self._x[:-1] + 0.5 * cell, np.abs(self._y[:-1] + 0.5 * cell - y) <= 0.5 * width
        hit = self.compartment.space.hit[np.ix_((x >= -APPROACH) & (x < depth - cell), at)]
        return bool(hit[:, :, (self._z >= ON_BOARD) & (self._z < height)].any())

    def insertions(
        self, size: tuple[float, float, float], hand: Hand, clearance: float
    ) -> list[Placement]:
        """Return the placements of an object that is inserted through the front, the best first.

        Candidates are in the middle of the free depth at each position along the front. Of
        candidates whose footprints are nearer to each other than the clearance, the best is kept.

        Parameters
        ----------
        size
            Depth, width and height of the object, along the axes of the front, m.
        hand
            The hand that inserts it.
        clearance
            Minimum distance from the swept box to its sides and above, m.
        """
        c, clearance = self.compartment, max(clearance, MIN_CLEARANCE)
        height = max(size[2], hand.height) + clearance
        reserve = 0.5 * (size[1] + 2.0 * clearance)
        if height > c.height or 2.0 * reserve > c.width:
            return []
        depths = self.depths(height)
        width = max(size[1], hand.width) + 2.0 * clearance
        found = []
        for y in np.arange(-0.5 * c.width + reserve, 0.5 * c.width - reserve + 1e-9, c.space.cell):
            depth = self.depth_at(float(y), width, depths)
            slack = 0.5 * (depth - size[0])
            if slack < clearance:
                continue
            x = 0.5 * depth
            beside = self._clear_beside(float(y), width, depths, x + 0.5 * size[0]) + clearance
            edge = 0.5 * (c.width - size[1]) - abs(float(y))
            found.append((min(slack, beside, edge), -abs(float(y)), float(x), float(y)))
        found.sort(reverse=True)
        every = [self._placed_at(x, y, clear) for clear, _, x, y in found]
        return without_overlaps(every, (size[0], size[1]), clearance)

    def _clear_beside(self, y: float, width: float, depths: Float64, needed: float) -> float:
        """Return the free distance to either side of a swept box, m, up to its width.

        Parameters
        ----------
        y, width, depths
            As in `depth_at`.
        needed
            Depth of the swept box, m.
        """
        wider = 0.0
        while wider < width:
            step = wider + self.compartment.space.cell
            if self.depth_at(y, width + 2.0 * step, depths) < needed:
                break
            wider = step
        return wider

    def _placed_at(self, x: float, y: float, clearance: float) -> Placement:
        T = self.compartment.T_map_front
        position = T[:3, 3] + x * T[:3, 0] + y * T[:3, 1]
        yaw = math.atan2(T[1, 0], T[0, 0])
        return Placement(self.compartment.board, position, yaw, clearance, self.compartment.height)


def without_overlaps(
    found: Sequence[Placement], size: tuple[float, float], clearance: float
) -> list[Placement]:
    """Return the placements without those too near to a better one.

    Parameters
    ----------
    found
        Placements, the best first.
    size
        Sides of the footprint along x and y of a placement, m.
    clearance
        Minimum distance between footprints, m.
    """
    kept: list[tuple[Placement, Polygon]] = []
    for candidate in found:
        corners = rectangle_corners(*size, candidate.yaw) + candidate.position[:2]
        footprint = Polygon(corners)
        if all(footprint.distance(other) >= clearance for _, other in kept):
            kept.append((candidate, footprint))
    return [candidate for candidate, _ in kept]
