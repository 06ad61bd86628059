"""What the plane kernels read of a map, as one argument."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tccm_ros.cuboids.moments import Moments, gather, moved

__all__ = ["PlaneMap", "cap_of", "plane_map"]

Array = NDArray[np.float64]
Int = NDArray[np.int32]


class PlaneMap(NamedTuple):
    """The cuboids of a map, with moments in m about one origin.

    Attributes
    ----------
    M
        float64 (N, 10), moments about `origin`, m.
    ix, iy, bottom, top
        As in `Cuboids`.
    cap_rows, cap_sums
        As in `Caps`: of length 0 where caps are not known.
    cell, tick
        Edge of a cell in ticks, and a tick in m.
    origin
        float64 (3,), ticks.
    """

    M: Array
    ix: Int
    iy: Int
    bottom: Int
    top: Int
    cap_rows: Int
    cap_sums: Array
    cell: float
    tick: float
    origin: Array


@njit(nogil=True, cache=True)
def plane_map(
    ix: Int,
    iy: Int,
    bottom: Int,
    top: Int,
    count: Array,
    s: Array,
    S: Array,
    cap_rows: Int,
    cap_sums: Array,
    cell: float,
    tick: float,
    origin: Array,
) -> PlaneMap:
    """Return a map's cuboids with their moments about one origin; arguments as in `PlaneMap`."""
    M = np.empty((len(ix), 10))
    gather(ix, iy, count, s, S, cell, tick, origin, M)
    return PlaneMap(M, ix, iy, bottom, top, cap_rows, cap_sums, cell, tick, origin)


@njit(nogil=True, cache=True)
def cap_of(of: PlaneMap, i: int) -> Moments:
    """Return the moments of the cap of cuboid i of a map with caps, about the map's origin.

    Few caps are asked for, those of rims, so they are moved one by one.
    """
    r = of.cap_rows[i]
    if r < 0:
        M = of.M
        return (
            M[i, 0], M[i, 1], M[i, 2], M[i, 3], M[i, 4],
            M[i, 5], M[i, 6], M[i, 7], M[i, 8], M[i, 9],
        )  # fmt: skip
    m = of.cap_sums
    return moved(
        of.ix[i], of.iy[i], m[r, 0], m[r, 1], m[r, 2], m[r, 3],
        m[r, 4], m[r, 5], m[r, 6], m[r, 7], m[r, 8], m[r, 9], of.cell, of.tick, of.origin,
    )  # fmt: skip
