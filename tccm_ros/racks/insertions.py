"""Insertions: what goes into a compartment straight through its front.

The swept box is as wide and high as the object or the hand, whichever is larger. It begins
`APPROACH` before the front and ends behind the object. It is free if beams passed each of its
cells, none ended there, and no object of the map is in it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely import Polygon
from shapely.affinity import affine_transform

from tccm_ros.arrays import Float64
from tccm_ros.geometry import inverse, transform
from tccm_ros.racks.compartment import Compartment
from tccm_ros.tabletop.free_places import rectangle_corners
from tccm_ros.tabletop.placements import Placement

APPROACH = 0.3
"""A hand comes straight over the last so much before the front, m; chosen: its own length."""

ON_BOARD = 0.03
"""Hits so low over a board are of the board, m: a cell; lower objects have boxes."""

LOW = 0.06
"""Of objects lower than this, m, hits may tell nothing: two cells. Those that are higher show by
what beams ended on, closer than their boxes do."""

FRONT_EDGE = 0.06
"""They are so near before the front, m: the board's edge errs by 2 cm, and hits by one cube."""

MIN_CLEARANCE = 1e-6
"""As `tabletop.placements.MIN_CLEARANCE_M`."""


class Hand(NamedTuple):
    """Cross-section of the hand that goes in with an object.

    Attributes
    ----------
    width, height
        Across the direction of insertion, m; the height counts from the board.
    """

    width: float = 0.0
    height: float = 0.0


class Obstacle(NamedTuple):
    """An object of the map.

    Attributes
    ----------
    id
        Of the object.
    footprint
        In map, m.
    low, high
        Its lowest and highest z in map, m.
    """

    id: int
    footprint: Polygon
    low: float
    high: float


class AccessState(StrEnum):
    """Whether an object can be taken from a direction."""

    FREE = "free"
    BLOCKED = "blocked"
    UNKNOWN = "unknown"
    """Some of the way was never seen, and nothing is known to be in it."""


class Access(NamedTuple):
    """How an object can be taken from a direction.

    Attributes
    ----------
    state
        Whether it can.
    objects
        Ids of the objects in the way.
    surface
        Id of the surface that is too low above it; None where none is.
    """

    state: AccessState
    objects: tuple[int, ...] = ()
    surface: int | None = None


class InsertionSpace:
    """The free space of a compartment as a hand sees it that comes through the front.

    Parameters
    ----------
    compartment
        Of the map.
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
        (a, b), (c, d) = T[:2, :2]
        footprint = affine_transform(obstacle.footprint, [a, b, c, d, *T[:2, 3]])
        return Obstacle(obstacle.id, footprint, obstacle.low + T[2, 3], obstacle.high + T[2, 3])

    def depths(self, height: float, without: int | None = None) -> Float64:
        """Return how far each column of cells along the front is free, float64 (Y,), m.

        Parameters
        ----------
        height
            Of what goes in, over the board, m.
        without
            Id of an object that is no obstacle: what is taken out, and its hits.
        """
        low = self._z < height
        blocked = self._blocked[:, :, low].any(axis=2)
        x, y = self._x[:-1] + 0.5 * self.compartment.space.cell, self._y[:-1]
        middles = np.stack(
            np.meshgrid(x, y + 0.5 * self.compartment.space.cell, indexing="ij"), axis=-1
        )
        points = shapely.points(middles)
        for obstacle in self._obstacles:
            is_told = obstacle.high > LOW and obstacle.id != without
            if is_told or obstacle.low > height or obstacle.high < 0.0:
                continue
            covered = shapely.dwithin(points, obstacle.footprint, self.compartment.space.cell)
            blocked = blocked & ~covered if obstacle.id == without else blocked | covered
        blocked[x < -APPROACH] = False
        is_any = blocked.any(axis=0)
        first = np.where(is_any, blocked.argmax(axis=0), len(x))
        return np.asarray(np.minimum(self._x[first], self.compartment.depth))

    def depth_at(self, y: float, width: float, depths: Float64) -> float:
        """Return how far something goes in, m; negative where its way to the front is blocked.

        Parameters
        ----------
        y, width
            Its middle along the front, and its width, m.
        depths
            Of `depths`.
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
        """Return whether a hand comes to an object of the compartment through the front.

        Parameters
        ----------
        item
            The object; it goes out by the same way.
        hand
            That takes it.
        clearance
            Stays free around the swept box and above it, m.
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
        is_hit = self._is_hit(y, width, height, low_x)
        state = AccessState.BLOCKED if before or is_hit else AccessState.UNKNOWN
        return Access(state, tuple(before))

    def _is_hit(self, y: float, width: float, height: float, depth: float) -> bool:
        """Return whether beams ended in a swept box."""
        cell = self.compartment.space.cell
        x, at = self._x[:-1] + 0.5 * cell, np.abs(self._y[:-1] + 0.5 * cell - y) <= 0.5 * width
        hit = self.compartment.space.hit[np.ix_((x >= -APPROACH) & (x < depth - cell), at)]
        return bool(hit[:, :, (self._z >= ON_BOARD) & (self._z < height)].any())

    def insertions(
        self, size: tuple[float, float, float], hand: Hand, clearance: float
    ) -> list[Placement]:
        """Return where an object can be put through the front, the best first.

        Of each place along the front the middle of its free depth is taken, and those are kept
        that leave the clearance between footprints.

        Parameters
        ----------
        size
            Its depth, width and height, along the axes of the front, m.
        hand
            That puts it there.
        clearance
            Stays free around the swept box and above it, m.
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
        """Return how much wider, to either side, a swept box could be, m, up to its width.

        Parameters
        ----------
        y, width, depths
            As of `depth_at`.
        needed
            How far it goes in, m.
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
    """Return those that leave a clearance between footprints, the first ones.

    Parameters
    ----------
    found
        The best first.
    size
        Of the footprint, along x and y of a placement, m.
    clearance
        Between footprints, m.
    """
    kept: list[tuple[Placement, Polygon]] = []
    for candidate in found:
        corners = rectangle_corners(*size, candidate.yaw) + candidate.position[:2]
        footprint = Polygon(corners)
        if all(footprint.distance(other) >= clearance for _, other in kept):
            kept.append((candidate, footprint))
    return [candidate for candidate, _ in kept]
