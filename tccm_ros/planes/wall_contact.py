"""Wall points among the inliers of a horizontal surface that ends at the wall.

Where a wall is seen from the front, a scan line on it is horizontal, and its cuboids at the height
of an adjacent board cannot be distinguished from the board. But there are no points of the board
before the wall there, whereas a board that ends at a wall has its rear before it. Both sides are
tested, since the rail of a chair is seen over its seat.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int32, Int64
from tccm_ros.cuboids.cuboids import TICKS_PER_M
from tccm_ros.kernels import kernel
from tccm_ros.planes import PlaneFits

MAX_DISTANCE = 0.010
"""Maximum distance of a point on a vertical plane, m, plus `SIGMAS` standard deviations of at most
the same value. Chosen."""

SIGMAS = 3.0
"""Maximum distance of a point on a vertical plane, in standard deviations across it. Chosen."""

ABOVE = 0.03
"""Minimum height of a wall above a point on it, m: the front of a block ends lower. Chosen."""

SAME_HEIGHT = 0.02
"""Maximum difference in height of points of one board, m: its rear may be a surface of its own.
Chosen."""

BEFORE = 0.30
"""Maximum distance of the board's points before the wall, m: that of the lines in strips,
`horizontal_strips.MAX_DISTANCE`."""


def lie_on_walls(points: Float64, surface: Int64, fits: PlaneFits, is_wall: Bool) -> Bool:
    """Return which points of horizontal surfaces are wall points, where no surface ends.

    Parameters
    ----------
    points
        float64 (M, 3), m, in the map's frame.
    surface
        int64 (M,), surface of each point, -1 for none.
    fits
        The planes of the map.
    is_wall
        bool (F + 1,), which planes are walls; the last entry, for cuboids of no plane, is False.

    Returns
    -------
    bool (M,)
    """
    c = fits.cuboids
    chosen = np.flatnonzero(is_wall[fits.labels])
    if len(points) == 0 or len(chosen) == 0:
        return np.zeros(len(points), np.bool_)
    within = [min(SIGMAS * f.rms, MAX_DISTANCE) + MAX_DISTANCE for f in fits]
    planes = np.array([(*f.normal, f.offset, d) for f, d in zip(fits, within, strict=True)])
    cells = np.floor(points[:, :2] / c.cell_size).astype(np.int64)
    low = cells.min(axis=0) - 1
    shape = cells.max(axis=0) + 2 - low
    walls = (
        c.ix[chosen] - low[0], c.iy[chosen] - low[1], c.top[chosen] / TICKS_PER_M,
        fits.labels[chosen],
    )  # fmt: skip
    board = np.full((shape[0], shape[1]), np.inf)
    return mark_points(points, surface, cells - low, walls, planes, c.cell_size, board)


@kernel
def mark_points(
    points: Float64, surface: Int64, cells: Int64,
    walls: tuple[Int64, Int64, Float64, Int32], planes: Float64, size: float,
    board: Float64,
) -> Bool:  # fmt: skip
    """Return which points are on the plane of the highest wall cuboid in or beside their cell.

    Points with surface points before the wall are not among them.

    Parameters
    ----------
    points, surface
        As in `lie_on_walls`.
    cells
        int64 (M, 2), cells of the points in a raster.
    walls
        Cells in the raster (ix and iy), tops, m, and planes of the walls' cuboids, (K,) each.
    planes
        float64 (F, 5), normal, offset and maximum distance, m.
    size
        Edge of a cell, m.
    board
        float64, the raster, initially inf; the heights of the surfaces' own points are written.

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
            before = has_surface_before(board, a, b, nx, ny, size, z)
            marked[i] = not (before or has_surface_before(board, a, b, -nx, -ny, size, z))
    return marked


@kernel
def has_surface_before(
    board: Float64, a: int, b: int, nx: float, ny: float, size: float, height: float
) -> bool:
    """Return whether there are surface points of a height before a cell of a wall.

    Parameters
    ----------
    board
        float64, raster of the heights of the surfaces' own points, m; inf without points.
    a, b
        The cell.
    nx, ny
        Normal of the wall, towards the searched side.
    size
        Edge of a cell, m.
    height
        m.
    """
    rows, columns = board.shape
    for step in range(1, int(BEFORE / size) + 1):
        x, y = a + round(nx * step), b + round(ny * step)
        for p in range(max(x - 1, 0), min(x + 2, rows)):
            for q in range(max(y - 1, 0), min(y + 2, columns)):
                if abs(board[p, q] - height) <= SAME_HEIGHT:
                    return True
    return False
