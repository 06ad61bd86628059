"""Space below surfaces through which no beam passed: behind fronts, and under tables.

It is divided into cells along the smallest rectangle around each surface, so that its boxes end at
the edges of the furniture. Gaps too narrow for a hand are filled, and boxes join cells, first
upwards, then along both sides.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from scipy.ndimage import binary_opening
from shapely import Polygon

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.geometry import spatial, transform
from tccm_ros.racks.boards import NEAR_RACK
from tccm_ros.racks.compartment import SeenView
from tccm_ros.racks.hits import HitsInMap
from tccm_ros.racks.seen_space import cell_middles, seen_cells
from tccm_ros.records import Surface
from tccm_ros.tabletop.round_objects import rectangle_around

CELL = 0.05
"""Maximum edge of a cell, m; chosen: half a column of free space. Finer cells give more boxes."""

HAND = 3
"""Cells in each direction that a free space fills at least; chosen: a hand is narrower than 15 cm.
"""


class UnseenSpace(NamedTuple):
    """A box of space below a surface that was never seen, or in which beams ended.

    Attributes
    ----------
    surface
        Id of the surface.
    T_map_space
        float64 (4, 4), pose of its centre; z up.
    size
        float64 (3,), edges along its axes, m.
    """

    surface: int
    T_map_space: Float64
    size: Float64


def unseen_spaces(
    surfaces: Sequence[Surface], views: Sequence[SeenView], floor_z: float
) -> tuple[UnseenSpace, ...]:
    """Return the unseen space between the floor and surfaces, by surface from the lowest up.

    Parameters
    ----------
    surfaces
        Surfaces of the map.
    views
        In order of time.
    floor_z
        Height of the floor in map, m.
    """
    above = sorted((s for s in surfaces if s.label != "floor"), key=lambda s: (s.height, s.id))
    if not above or not views:
        return ()
    hits, found = HitsInMap(views), []
    outlines = [shapely.make_valid(Polygon(s.boundary[:, :2])) for s in above]
    for k, surface in enumerate(above):
        near = hits.near(outlines[k], NEAR_RACK).without_removed()
        T, low, cell, shape = _grid(surface, floor_z)
        passed, hit = seen_cells(T, low, shape, cell, near, views)
        seen = _wide(passed & ~hit)
        middles = transform(T, cell_middles(low, shape, cell).reshape(-1, 3))
        unseen = ~seen & shapely.contains_xy(outlines[k], *middles[:, :2].T).reshape(shape)
        for lower, outline in zip(above[:k], outlines[:k]):
            top = lower.height_at(middles[:, :2])
            is_below = (middles[:, 2] < top) & shapely.contains_xy(outline, *middles[:, :2].T)
            unseen &= ~is_below.reshape(shape)
        for first, count in boxes_of(unseen):
            size = count * cell
            T_box = T.copy()
            T_box[:3, 3] = transform(T, (low + first * cell + 0.5 * size)[None])[0]
            found.append(UnseenSpace(surface.id, T_box, size))
    return tuple(found)


def _wide(seen: Bool) -> Bool:
    """Return the cells of spaces that are at least `HAND` cells wide in each direction."""
    around = HAND // 2
    inner = (slice(around, -around),) * 3
    opened = binary_opening(np.pad(seen, around, mode="edge"), np.ones((HAND,) * 3))
    return np.asarray(opened[inner] & seen)


def _grid(surface: Surface, floor_z: float) -> tuple[Float64, Float64, Float64, Int64]:
    """Return frame, lowest corner, edges of cells and shape of the grid below a surface."""
    x, y, length, width, yaw = rectangle_around(surface.boundary)
    top = float(surface.height_at(np.array([x, y])))
    size = np.array([length, width, max(top - floor_z, CELL)])
    shape = np.ceil(size / CELL).astype(np.int64)
    low = np.array([-0.5 * length, -0.5 * width, -size[2]])
    return spatial([x, y, yaw], top), low, size / shape, shape


def boxes_of(cells: Bool) -> Iterator[tuple[Int64, Int64]]:
    """Yield first cell and number of cells, int64 (3,), of disjoint boxes that fill all cells.

    Parameters
    ----------
    cells
        bool (X, Y, Z).
    """
    rest = cells.copy()
    while rest.any():
        low = np.array(np.unravel_index(int(rest.argmax()), rest.shape))
        high = low + 1
        for axis in (2, 1, 0):
            while high[axis] < rest.shape[axis]:
                ends = low.copy(), high.copy()
                ends[0][axis], ends[1][axis] = high[axis], high[axis] + 1
                if not rest[tuple(map(slice, *ends))].all():
                    break
                high[axis] += 1
        rest[tuple(map(slice, low, high))] = False
        yield low, high - low
