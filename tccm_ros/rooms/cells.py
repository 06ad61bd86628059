"""Cells into which walls cut the plane, once the gaps of doors are closed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import LineString, Polygon

from tccm_ros.arrays import Float64
from tccm_ros.slam.occupancy import OccupancyGrid

DOOR_WIDTH = 1.3
"""Widest gap between walls that is a door, m. Chosen: a double door of an office."""

MIN_WALL_LENGTH = 0.3
"""Shorter walls cut nothing, m. Chosen: what is beside a door in a corner."""

IN_LINE = 0.07
"""Walls whose ends are this near to the line of a longer one are in line with it, m. Chosen: less
than the thickness of a wall."""

TICK = 0.15
"""Length to each side of a tick at the end of an extended wall, m. Chosen: twice `IN_LINE`."""

SNAP = 1e-3
"""Grid of the coordinates of cells, m."""


def aligned(walls: Sequence[Float64]) -> list[Float64]:
    """Return the longer walls, those nearly in line moved into line with the longest of them.

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
    """Return the sides of the rectangle around all walls, in the direction of the longest.

    They close rooms of which a wall was not seen. Walls on one line have no rectangle around them
    but that line: sides shorter than `SNAP` are left out.

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
    """Return a wall that is extended by the width of a door at both ends."""
    beyond = DOOR_WIDTH * (wall[1] - wall[0]) / _length(wall)
    return LineString([wall[0] - beyond, wall[1] + beyond])


def plane_cells(walls: Sequence[Float64]) -> list[Polygon]:
    """Return the cells into which walls cut the plane, each extended by the width of a door.

    Parameters
    ----------
    walls
        float64 (2, 2) each, m.
    """
    lines = [extended(wall) for wall in walls]
    for wall, line in zip(walls, list(lines), strict=True):
        # Pieces of one wall are not quite in line: a tick at the end of one reaches the other.
        across = TICK * _normal(wall)
        lines += [LineString([end - across, end + across]) for end in np.array(line.coords)]
    # Not shapely.node: it gives up where many lines nearly coincide; rounding to a grid does not.
    noded = shapely.union_all(lines, grid_size=SNAP)
    return list(shapely.polygonize([noded]).geoms)


def free_fraction(cell: Polygon, grid: OccupancyGrid) -> float:
    """Return the part of a cell that the level laser saw as free, 0 to 1.

    Parameters
    ----------
    cell
        In map.
    grid
        What the level laser saw.
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
    """Return the radius of the largest circle in an area, m."""
    return float(shapely.maximum_inscribed_circle(shape, tolerance=0.02).length)


def _length(wall: Float64) -> float:
    return float(np.hypot(*(wall[1] - wall[0])))


def _normal(wall: Float64) -> Float64:
    """Return the unit normal of a wall, to its left."""
    x, y = (wall[1] - wall[0]) / _length(wall)
    return np.array([-y, x])
