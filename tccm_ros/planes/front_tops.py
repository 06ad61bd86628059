"""Points of a horizontal surface in the cuboids of the front below its edge.

The cell in which a block's top meets its front has one tall cuboid, which is of the front's plane:
without its topmost points the top would end up to a cell before its edge.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int32, Int64
from tccm_ros.cuboids.cuboids import TICKS_PER_M
from tccm_ros.cuboids.inclination import FITTED_AS_VERTICAL
from tccm_ros.planes.fits import PlaneFit, PlaneFits

ABOVE = 0.03
"""A front ends at most this above the top, m: a wall behind the top goes on. Chosen: the depth of a
cuboid."""

SIGMAS = 3.0
"""Standard deviations across a horizontal plane within which a point of a front is on it. Chosen:
further down a front's points are not of the top."""

AROUND = (np.arange(-1, 2)[:, None] * (1 << 32) + np.arange(-1, 2)).ravel()
"""Differences of the numbers of a cell and of its neighbours from that of the cell."""


def top_planes(
    points: Float64,
    cuboids: Int64,
    labels: Int32,
    surface: Int64,
    tops: Sequence[PlaneFit],
    fits: PlaneFits,
) -> Int64:
    """Return the horizontal plane of the topmost points of fronts, -1 for all other points.

    Parameters
    ----------
    points
        float64 (M, 3), m, in the map's frame.
    cuboids
        int64 (M,), the map's cuboid of each point.
    labels
        int32 (M,), plane of each point, -1 for none.
    surface
        int64 (M,), the horizontal plane that each point is known to be on, -1 for none.
    tops
        The horizontal planes.
    fits
        All planes of the map.

    Returns
    -------
    int64 (M,): where a point's front ends at the height of a horizontal plane that has a point of
    its own in the same cell or one beside it, that plane.
    """
    found = np.full(len(points), -1, np.int64)
    is_front = np.array([abs(f.normal[2]) < FITTED_AS_VERTICAL for f in fits] + [False])
    on_front = np.flatnonzero(is_front[labels] & (surface < 0))
    cells = _cells(cuboids, fits)
    for fit in tops:
        distance = points[on_front] @ fit.normal - fit.offset
        near = on_front[np.abs(distance) <= SIGMAS * fit.rms]
        own = np.unique(cells[surface == fit.index])
        found[near[np.isin(cells[near, None] + AROUND, own).any(axis=1)]] = fit.index
    rows = np.flatnonzero(found >= 0)
    goes_on = _highest_front(cells[rows], fits, is_front) > points[rows, 2] + ABOVE
    found[rows[goes_on]] = -1
    return found


def _highest_front(cells: Int64, fits: PlaneFits, is_front: Bool) -> Float64:
    """Return the highest top of vertical planes in cells and around them, float64 (N,), m."""
    fronts = np.flatnonzero(is_front[fits.labels])
    known, of_cell = np.unique(_cells(fronts, fits), return_inverse=True)
    highest = np.full(len(known) + 1, -np.inf)  # the last is for cells without a front
    np.maximum.at(highest, of_cell.ravel(), fits.cuboids.top[fronts] / TICKS_PER_M)
    around = cells[:, None] + AROUND
    place = np.minimum(np.searchsorted(known, around), max(len(known) - 1, 0))
    found = np.where(np.isin(around, known), highest[place], -np.inf)
    return np.asarray(found.max(axis=1, initial=-np.inf), np.float64)


def _cells(cuboids: Int64, fits: PlaneFits) -> Int64:
    """Return a number of the cell of each cuboid, int64 (N,)."""
    c = fits.cuboids
    return (c.ix[cuboids].astype(np.int64) << 32) + c.iy[cuboids]
