"""Cells of the plane between walls, with the gaps of doors closed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import LineString, Polygon

from tccm_ros.arrays import Float64
from tccm_ros.slam.occupancy import OccupancyGrid

DOOR_WIDTH = 1.3
"""Maximum width of a door between walls, m. Chosen: a double door of an office."""

MIN_WALL_LENGTH = 0.3
"""Minimum length of a wall that separates cells, m. Chosen: the wall beside a door in a corner."""

IN_LINE = 0.07
"""Maximum distance of a wall's ends from the line of a longer wall to be aligned with it, m.
Chosen: less than the thickness of a wall."""

TICK = 0.15
"""Length of the cross lines at the ends of an extended wall to each side, m. Chosen: twice
`IN_LINE`."""

SNAP = 1e-3
"""Grid size of the cells' coordinates, m."""


def aligned(walls: Sequence[Float64]) -> list[Float64]:
    """Return the walls that are long enough, aligned with the longest nearly collinear one.

    Parameters
    ----------
    walls
        float64 (2, 2) each, ends of the observed extent, m.
    """
    done: list[Float64] = []
    longer = [wall for wall in walls if _length(wall) >= MIN_WALL_LENGTH]
    for ends in sorted(longer, key=lambda wall: -_length(wall)):
        moved = ends
        for other in done:
            normal = _normal(other)
            offsets = (ends - other[0]) @ normal
            if np.abs(offsets).max() < IN_LINE:
                moved = ends - offsets[:, None] * normal
                break
        done.append(moved)
    return done


def frame(walls: Sequence[Float64]) -> list[Float64]:
    """Return the sides of the bounding rectangle of all walls, aligned with the longest wall.

    They close rooms with a wall that was not observed. Sides shorter than `SNAP`, as of collinear
    walls, are dropped.

    Parameters
    ----------
    walls
        float64 (2, 2) each, at least one.
    """
    normal = _normal(max(walls, key=_length))
    R = np.column_stack([[normal[1], -normal[0]], normal])
    ends = np.concatenate(walls) @ R
    (left, low), (right, high) = ends.min(axis=0), ends.max(axis=0)
    corners = [(left, low), (right, low), (right, high), (left, high), (left, low)]
    ring = np.array(corners) @ R.T
    sides = [ring[k : k + 2] for k in range(4)]
    return [side for side in sides if _length(side) > SNAP]


def extended(wall: Float64) -> LineString:
    """Return a wall extended by the width of a door at both ends."""
    beyond = DOOR_WIDTH * (wall[1] - wall[0]) / _length(wall)
    return LineString([wall[0] - beyond, wall[1] + beyond])


def plane_cells(walls: Sequence[Float64]) -> list[Polygon]:
    """Return the cells of the plane between walls, each extended by the width of a door.

    Parameters
    ----------
    walls
        float64 (2, 2) each, m.
    """
    lines = [extended(wall) for wall in walls]
    for wall, line in zip(walls, list(lines), strict=True):
        # Pieces of a wall are not exactly collinear: a cross line at the end of one meets the
        # other.
        across = TICK * _normal(wall)
        lines += [LineString([end - across, end + across]) for end in np.array(line.coords)]
    # Not shapely.node, which fails for many nearly coincident lines; a grid makes it robust.
    noded = shapely.union_all(lines, grid_size=SNAP)
    return list(shapely.polygonize([noded]).geoms)


def free_fraction(cell: Polygon, grid: OccupancyGrid) -> float:
    """Return the fraction of a cell observed as free by the level laser.

    Parameters
    ----------
    cell
        Cell in map.
    grid
        Grid of the level scans.
    """
    low, high = np.array(cell.bounds).reshape(2, 2)
    first = np.floor((low - grid.origin) / grid.resolution).astype(int)
    last = np.ceil((high - grid.origin) / grid.resolution).astype(int)
    columns, rows = np.arange(first[0], last[0] + 1), np.arange(first[1], last[1] + 1)
    x, y = np.meshgrid(
        grid.origin[0] + (columns + 0.5) * grid.resolution,
        grid.origin[1] + (rows + 0.5) * grid.resolution,
    )
    inside = shapely.contains_xy(cell, x, y)
    if not inside.any():
        return 0.0
    height, width = grid.cells.shape
    known = np.full(inside.shape, -1)
    is_row, is_column = (rows >= 0) & (rows < height), (columns >= 0) & (columns < width)
    known[np.ix_(is_row, is_column)] = grid.cells[np.ix_(rows[is_row], columns[is_column])]
    return float((known[inside] == 0).mean())


def half_width(shape: shapely.Geometry) -> float:
    """Return the radius of the largest inscribed circle of an area, m."""
    return float(shapely.maximum_inscribed_circle(shape, tolerance=0.02).length)


def _length(wall: Float64) -> float:
    return float(np.hypot(*(wall[1] - wall[0])))


def _normal(wall: Float64) -> Float64:
    """Return the unit normal of a wall, to its left."""
    x, y = (wall[1] - wall[0]) / _length(wall)
    return np.array([-y, x])
