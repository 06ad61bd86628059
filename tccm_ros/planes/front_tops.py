"""Points of a horizontal surface in the cuboids of the fronts and walls at its edges.

The cell in which a block's top meets its front has one tall cuboid, an inlier of the front's plane,
or of none: the front of a board is too low for a plane. So has the cell in which a board meets a
wall or a side panel. Without the points there the top would end up to a cell before its edge.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int32, Int64
from tccm_ros.cuboids.cuboids import TICKS_PER_M
from tccm_ros.cuboids.inclination import FITTED_AS_VERTICAL
from tccm_ros.planes.fits import PlaneFit, PlaneFits
from tccm_ros.robust import GATE

ABOVE = 0.03
"""Maximum height of a front, and of a point's cuboid, above the top, m: a wall behind the top is
higher. Chosen: the depth of a cuboid."""

BEFORE = 0.3
"""Max distance from a wall of the points of a board that reaches it, m; chosen: three distances of
scan lines."""

AROUND = (np.arange(-1, 2)[:, None] * (1 << 32) + np.arange(-1, 2)).ravel()
"""Differences of the numbers of a cell and its neighbours from the cell's number."""


def top_planes(
    points: Float64,
    cuboids: Int64,
    labels: Int32,
    surface: Int64,
    in_line: Bool,
    tops: Sequence[PlaneFit],
    fits: PlaneFits,
    viewpoint: Float64,
) -> Int64:
    """Assign points in cuboids at fronts and walls to the horizontal plane they lie on; -1: none.

    Parameters
    ----------
    points
        float64 (M, 3), m, in the map's frame.
    cuboids
        int64 (M,), the map's cuboid of each point.
    labels
        int32 (M,), plane of each point, -1 for none.
    surface
        int64 (M,), the horizontal plane to which each point is assigned, -1 for none.
    in_line
        bool (M,), whether a point is one of a scan line.
    tops
        The horizontal planes, by index; at least one.
    fits
        All planes of the map.
    viewpoint
        float64 (3,), position of the sensor in the map's frame, m.

    Returns
    -------
    int64 (M,), a horizontal plane for which these hold:

    - The point is at its height.
    - It has points of its own in the point's cell or in one beside it.
    - The front ends there. Where points are dense, a cuboid on no plane is a front as well, and
      each has to reach up to the plane from below.

    Exceptions: points of scan lines are assigned on the planes of fronts alone, as
    `horizontal_strips` decides on the others; a wall continues above the plane, and its points are
    assigned if they are nearer to the plane than to the wall.
    """
    found = np.full(len(points), -1, np.int64)
    is_front = np.array([abs(f.normal[2]) < FITTED_AS_VERTICAL for f in fits] + [False])
    may_be_front = is_front[labels] | ((labels < 0) & ~in_line)
    on_front = np.flatnonzero(may_be_front & (surface < 0))
    cells = _cells(cuboids, fits)
    fronts = np.flatnonzero(is_front[fits.labels])
    for top in tops:
        own = np.flatnonzero(surface == top.index)
        beside = on_front[_are_near(cells[on_front], cells[own])]
        is_at_top, reaches_up = _at_top(top, points[beside], cuboids[beside], fits)
        near = beside[is_at_top]
        ends_here = in_line[near] | reaches_up[is_at_top]
        is_wall = _continues_above(top, cells[near], in_line[near], fronts, fits)
        walls = near[is_wall & ~in_line[near]]
        is_before = _before_walls(top, walls, own, points, cells, labels, fits, viewpoint)
        of_this = np.concatenate([near[ends_here & ~is_wall], walls[is_before]])
        found[of_this] = np.maximum(found[of_this], top.index)
    return found


def on_walls(points: Float64, cuboids: Int64, surface: Int64, fits: PlaneFits) -> Bool:
    """Return which points of horizontal planes and strips are those of a wall alone, bool (M,).

    A wall has points at the height of a board beside it, whether the board reaches it or not. A
    board that reaches it has points clear of the wall before these; both sides count, as the rail
    of a chair is seen over its seat.

    Parameters
    ----------
    points, cuboids, surface, fits
        As in `top_planes`.
    """
    found = np.zeros(len(points), np.bool_)
    on_planes = np.flatnonzero(surface >= 0)
    points, surface = points[on_planes], surface[on_planes]
    cells, c = _cells(cuboids[on_planes], fits), fits.cuboids
    for k, wall in enumerate(fits):
        if abs(wall.normal[2]) >= FITTED_AS_VERTICAL:
            continue
        is_near = np.abs(points @ wall.normal - wall.offset) <= GATE * wall.rms
        near = np.flatnonzero(is_near)
        own = np.flatnonzero(fits.labels == k)
        steps = np.arange(1, int(BEFORE / c.cell_size) + 1)[:, None] * wall.normal[:2]
        shifts = np.rint(np.concatenate([steps, -steps])).astype(np.int64)
        for index in np.unique(surface[near]).tolist():
            rows = near[surface[near] == index]
            height = float(np.median(points[rows, 2]))
            above = own[c.top[own] / TICKS_PER_M > height + ABOVE]
            rows = rows[_are_near(cells[rows], _cells(above, fits))]
            if not len(rows):
                continue
            is_level = ~is_near & (np.abs(points[:, 2] - height) <= ABOVE)
            before = cells[rows][:, None] + (shifts[:, 0] << 32) + shifts[:, 1]
            is_board = _are_near(before, cells[is_level]).any(axis=1)
            found[on_planes[rows[~is_board]]] = True
    return found


def _at_top(top: PlaneFit, points: Float64, cuboids: Int64, fits: PlaneFits) -> tuple[Bool, Bool]:
    """Return which points are at the height of a top, and whose cuboids reach up to it from below.

    Parameters
    ----------
    top
        A horizontal plane.
    points, cuboids
        float64 (N, 3), m, and int64 (N,), the cuboid of each.

    Returns
    -------
    bool (N,), bool (N,)
    """
    distance, slack = points @ top.normal - top.offset, GATE * top.rms
    bottom, end = (z[cuboids] / TICKS_PER_M for z in (fits.cuboids.bottom, fits.cuboids.top))
    height = points[:, 2] - distance
    reaches_up = (bottom < height - slack) & (end <= height + ABOVE)
    return np.abs(distance) <= slack, reaches_up


def _continues_above(
    top: PlaneFit, cells: Int64, in_line: Bool, fronts: Int64, fits: PlaneFits
) -> Bool:
    """Return in which cells, or beside which, a front continues above a top, bool (N,).

    The front of a board further up, below which it is open, does not count where points are dense.
    Scan lines measure a wall in pieces.

    Parameters
    ----------
    top
        A horizontal plane.
    cells, in_line
        int64 (N,), bool (N,)
    fronts
        int64 (K,), cuboids of vertical planes.
    """
    c = fits.cuboids
    xy = (np.stack([c.ix[fronts], c.iy[fronts]], axis=1) + 0.5) * c.cell_size
    height = (top.offset - xy @ top.normal[:2]) / top.normal[2] + ABOVE
    bottom, end = (z[fronts] / TICKS_PER_M for z in (c.bottom, c.top))
    is_above = end > height
    in_pieces, in_one = (
        _are_near(cells, _cells(fronts[chosen], fits))
        for chosen in (is_above, is_above & (bottom <= height))
    )
    return np.where(in_line, in_pieces, in_one)


def _before_walls(
    top: PlaneFit,
    rows: Int64,
    own: Int64,
    points: Float64,
    cells: Int64,
    labels: Int32,
    fits: PlaneFits,
    viewpoint: Float64,
) -> Bool:
    """Return which points at the height of a top are of it, and not of the walls behind it.

    Their distance towards the sensor from the wall is more standard deviations than that from the
    top. A wall has such points by noise as well, whether the top extends to it or not, so the top
    needs points of its own beside them that are before the noise of the wall.

    Parameters
    ----------
    top
        The horizontal plane.
    rows, own
        int64 (N,), int64 (K,), rows of the points in cuboids of walls, and of the top's own points.
    points, cells, labels, fits, viewpoint
        As in `top_planes`.

    Returns
    -------
    bool (N,)
    """
    is_before = np.zeros(len(rows), np.bool_)
    for wall in np.unique(labels[rows][labels[rows] >= 0]).tolist():
        fit, of_wall = fits[wall], labels[rows] == wall
        towards = np.sign(fit.normal @ viewpoint - fit.offset) / fit.rms
        before, own_before = (
            towards * (points[k] @ fit.normal - fit.offset) for k in (rows[of_wall], own)
        )
        from_top = np.abs(points[rows[of_wall]] @ top.normal - top.offset) / top.rms
        is_beside = _are_near(cells[rows[of_wall]], cells[own[own_before > GATE]])
        is_before[of_wall] = (before > from_top) & is_beside
    return is_before


def _are_near(cells: Int64, others: Int64) -> Bool:
    """Return which cells are among others or beside one of these, bool of the shape of `cells`."""
    return np.isin(cells, np.unique(others)[:, None] + AROUND)


def _cells(cuboids: Int64, fits: PlaneFits) -> Int64:
    """Return the number of each cuboid's cell, int64 (N,)."""
    c = fits.cuboids
    return (c.ix[cuboids].astype(np.int64) << 32) + c.iy[cuboids]
