"""Arrays of the plane kernels: the cuboids of a map (input) and the table of planes (output)."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Bool, Float64, Int32
from tccm_ros.cuboids.cuboids import CuboidArrays
from tccm_ros.cuboids.moments import Moments, moments_about, shift_moments
from tccm_ros.kernels import kernel

PLANE = np.dtype(
    [
        ("normal", np.float64, 3),  # unit
        ("offset", np.float64),  # m: normal . p = offset
        ("variances", np.float64, 3),  # along and across the plane, falling, m2
        ("support", np.float64),  # points of all its cuboids
        ("moments", np.float64, 10),  # of the points used in the fit
        ("is_horizontal", np.bool_),
    ],
    align=True,
)
"""A row of the table of planes; labels of cuboids are indices of rows."""

PlaneTable = NDArray[Any]
"""An array of `PLANE`."""


class PlaneMap(NamedTuple):
    """The cuboids of a map, with moments in m about one origin.

    Attributes
    ----------
    M
        float64 (N, 10), moments about `origin`, m.
    ix, iy, bottom, top
        As in `Cuboids`.
    cap_rows, cap_sums
        As in `Caps`; of length 0 where caps are unknown.
    cell, tick
        Edge of a cell in ticks, and a tick in m.
    origin
        float64 (3,), ticks.
    """

    M: Float64
    ix: Int32
    iy: Int32
    bottom: Int32
    top: Int32
    cap_rows: Int32
    cap_sums: Float64
    cell: float
    tick: float
    origin: Float64


@kernel
def plane_map(
    cuboids: CuboidArrays, cap_rows: Int32, cap_sums: Float64, origin: Float64
) -> PlaneMap:
    """Return a map's cuboids with their moments about one origin.

    Parameters
    ----------
    cuboids
        Cuboids of the map.
    cap_rows, cap_sums
        As in `PlaneMap`.
    origin
        float64 (3,), ticks.
    """
    c, M = cuboids, moments_about(cuboids, origin)
    return PlaneMap(M, c.ix, c.iy, c.bottom, c.top, cap_rows, cap_sums, c.cell, c.tick, origin)


@kernel
def cap_of(of: PlaneMap, i: int) -> Moments:
    """Return the moments of the cap of cuboid i of a map with caps, about the map's origin.

    Only the caps of rims are needed, so they are shifted one by one.
    """
    r = of.cap_rows[i]
    m = of.M[i] if r < 0 else of.cap_sums[r]
    sums = m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8], m[9]
    return sums if r < 0 else shift_moments(of.ix[i], of.iy[i], sums, of.cell, of.tick, of.origin)


@kernel
def keep_planes(labels: Int32, planes: PlaneTable, is_kept: Bool) -> PlaneTable:
    """Remove planes and renumber the labels.

    Parameters
    ----------
    labels
        int32 (N,), changed: rows of the remaining planes, -1 for none and for removed ones.
    planes
        (P,), changed.
    is_kept
        bool (P,), the planes that remain.

    Returns
    -------
    (Q,), the remaining planes, in their order.
    """
    number = np.full(len(planes), -1, np.int32)
    kept = 0
    for p in range(len(planes)):
        if is_kept[p]:
            number[p] = kept
            planes[kept] = planes[p]
            kept += 1
    if kept < len(planes):
        for i in range(len(labels)):
            if labels[i] >= 0:
                labels[i] = number[labels[i]]
    return planes[:kept]
