"""Points of walls that were taken for a horizontal surface which ends there.

A line of the tilt cycle that runs over a wall at the height of a board beside it is horizontal
where the wall is seen from the front, and no cuboid of it tells that it is not of the board. What
does tell is that nothing of the board lies before it: a board that ends at a wall has its rear
there. Both sides are looked at, as the rail of a chair is seen over its seat.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from tccm_ros.arrays import Bool, Float64, Int32, Int64
from tccm_ros.cuboids.cuboids import TICKS_PER_M
from tccm_ros.planes import PlaneFits

__all__ = ["lie_on_walls"]


MAX_DISTANCE = 0.010
"""A point is on a vertical plane within this, and three deviations of it up to as much again, m."""

SIGMAS = 3.0

ABOVE = 0.03
"""... where the plane goes on above the point by this much, m: the front of a block does not."""

SAME_HEIGHT = 0.02
"""The rear of a board may have been found apart from its front: points of this height count, m."""

BEFORE = 0.30
"""How far before the wall the surface's own points may begin, m: as far apart as lines are where
strips are found."""


def lie_on_walls(points: Float64, surface: Int64, fits: PlaneFits, is_wall: Bool) -> Bool:
    """Return which points of horizontal surfaces lie on a wall that they do not reach there.

    Parameters
    ----------
    points
        float64 (M, 3), m, in the map's frame.
    surface
        int64 (M,), surface of each point, -1 for none.
    fits
        The planes of the map.
    is_wall
        bool (F + 1,), which of them are walls; the last, for cuboids of no plane, is False.

    Returns
    -------
    bool (M,)
    """
    c = fits.cuboids
    chosen = np.flatnonzero(is_wall[fits.labels])
    if len(points) == 0 or len(chosen) == 0:
        return np.zeros(len(points), np.bool_)
    reach = [min(SIGMAS * f.rms, MAX_DISTANCE) + MAX_DISTANCE for f in fits]
    planes = np.array([(*f.normal, f.offset, r) for f, r in zip(fits, reach, strict=True)])
    cells = np.floor(points[:, :2] / c.cell_size).astype(np.int64)
    low = cells.min(axis=0) - 1
    shape = cells.max(axis=0) + 2 - low
    walls = (
        c.ix[chosen] - low[0], c.iy[chosen] - low[1], c.top[chosen] / TICKS_PER_M,
        fits.labels[chosen],
    )  # fmt: skip
    board = np.full((shape[0], shape[1]), np.inf)
    return mark_points(points, surface, cells - low, walls, planes, c.cell_size, board)


@njit(nogil=True, cache=True)
def mark_points(
    points: Float64, surface: Int64, cells: Int64,
    walls: tuple[Int64, Int64, Float64, Int32], planes: Float64, size: float,
    board: Float64,
) -> Bool:  # fmt: skip
    """Mark points on the plane of the highest cuboid of a wall in or beside their cell.

    Parameters
    ----------
    points, surface
        As in `lie_on_walls`.
    cells
        int64 (M, 2), of the points within a raster.
    walls
        Cells in the raster (ix and iy), tops, m, and planes of the walls' cuboids, (K,) each.
    planes
        float64 (F, 5), normal, offset and largest distance, m.
    size
        Edge of a cell, m.
    board
        float64, the raster, inf: receives the heights of the surfaces' own points.

    Returns
    -------
    bool (M,)
    """
    ix, iy, top, labels = walls
    rows, columns = board.shape
    highest = np.full((rows, columns), -np.inf)
    owner = np.full((rows, columns), -1, np.int32)
    for k in range(len(ix)):
        for a in range(max(ix[k] - 1, 0), min(ix[k] + 2, rows)):
            for b in range(max(iy[k] - 1, 0), min(iy[k] + 2, columns)):
                if top[k] > highest[a, b]:
                    highest[a, b], owner[a, b] = top[k], labels[k]
    marked = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        a, b = cells[i]
        if surface[i] < 0:
            continue
        if owner[a, b] >= 0 and highest[a, b] >= points[i, 2] + ABOVE:
            p = planes[owner[a, b]]
            side = p[0] * points[i, 0] + p[1] * points[i, 1] + p[2] * points[i, 2] - p[3]
            marked[i] = abs(side) <= p[4]
        if not marked[i]:
            board[a, b] = points[i, 2]
    for i in range(len(points)):
        if marked[i]:
            a, b = cells[i]
            nx, ny, z = planes[owner[a, b], 0], planes[owner[a, b], 1], points[i, 2]
            before = has_before(board, a, b, nx, ny, size, z)
            marked[i] = not (before or has_before(board, a, b, -nx, -ny, size, z))
    return marked


@njit(nogil=True, cache=True)
def has_before(
    board: Float64, a: int, b: int, nx: float, ny: float, size: float, height: float
) -> bool:
    """Return whether surface points of a height lie before a place on a wall of a normal."""
    rows, columns = board.shape
    for step in range(1, int(BEFORE / size) + 1):
        x, y = a + round(nx * step), b + round(ny * step)
        for p in range(max(x - 1, 0), min(x + 2, rows)):
            for q in range(max(y - 1, 0), min(y + 2, columns)):
                if abs(board[p, q] - height) <= SAME_HEIGHT:
                    return True
    return False
