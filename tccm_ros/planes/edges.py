"""Planes that are nothing but the edge of flatter ones.

Where a stove stands on a counter, the cells along its rim hold points of its top, of its low front
and of the counter. Neither plane takes them, and what is left hangs together around the stove: a
band that scatters by as much as the front is high, and joins the two levels if it is taken for a
surface. Its cuboids tell: nearly each lies beside one of a plane that is at least twice as flat.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tccm_ros.planes.blocks import BLOCK_BITS
from tccm_ros.planes.plane_map import PlaneMap
from tccm_ros.planes.plane_table import keep_planes

__all__ = ["drop_edges"]

Array = NDArray[np.float64]
Int = NDArray[np.int32]
Flags = NDArray[np.bool_]

FLATTER = 4.0
"""A plane is flatter than another if its variance across is this many times smaller."""

REACH = 2
"""Cells between cuboids that are beside each other, at most; less than a block's width."""

EDGE = 0.8
"""Share of a plane's cuboids beside flatter planes from which on it is their edge."""


@njit(nogil=True, cache=True)
def drop_edges(
    cuboids: PlaneMap,
    start: Int,
    order: Int,
    low: tuple[int, int],
    wide: int,
    labels: Int,
    planes: Array,
    is_standing: Flags,
) -> Array:
    """Drop the lying planes that are edges of flatter ones.

    Parameters
    ----------
    cuboids
        Those of the map.
    start, order
        Of `sort_into_blocks`.
    low, wide
        Indices of the first block's first cell, and blocks along y.
    labels
        int32 (N,), changed: rows of `planes`, -1 for none.
    planes
        float64 (P, PLANE_COLUMNS): the variance across in column 6.
    is_standing
        bool (P,), which planes are upright: these are no edges, and have none.

    Returns
    -------
    float64 (Q, PLANE_COLUMNS): the planes that remain, in their order; labels are theirs.
    """
    if is_standing.all():
        return planes
    variance = np.where(is_standing, np.inf, planes[:, 6])
    suspect = (variance > FLATTER * variance.min()) & ~is_standing
    if not suspect.any():
        return planes
    own, off = np.zeros(len(planes), np.int32), np.zeros(len(planes), np.int32)
    for p in labels:
        if p >= 0:
            own[p] += 1
    flattest = flattest_by_block(start, order, labels, variance)
    for i in range(len(labels)):
        p = labels[i]
        if p >= 0 and suspect[p]:
            most = variance[p] / FLATTER
            if not is_beside(cuboids, i, start, order, low, wide, labels, variance, flattest, most):
                off[p] += 1
                # Most planes are none's edge, which their first cuboids tell.
                suspect[p] = off[p] <= (1.0 - EDGE) * own[p]
    return keep_planes(labels, planes, ~suspect)


@njit(nogil=True, cache=True)
def flattest_by_block(start: Int, order: Int, labels: Int, variance: Array) -> Array:
    """Return the least variance of the planes of each block's cuboids, inf where there are none."""
    flattest = np.full(len(start) - 1, np.inf)
    for block in range(len(flattest)):
        for k in range(start[block], start[block + 1]):
            p = labels[order[k]]
            if p >= 0:
                flattest[block] = min(flattest[block], variance[p])
    return flattest


@njit(nogil=True, cache=True)
def is_beside(
    cuboids: PlaneMap,
    i: int,
    start: Int,
    order: Int,
    low: tuple[int, int],
    wide: int,
    labels: Int,
    variance: Array,
    flattest: Array,
    most: float,
) -> bool:
    """Tell whether cuboid i is beside one of a plane whose variance is `most` at most."""
    _, ix, iy, bottom, top = cuboids[:5]
    x, y, rows = ix[i], iy[i], (len(start) - 1) // wide
    first_x, last_x = (x - REACH - low[0]) >> BLOCK_BITS, (x + REACH - low[0]) >> BLOCK_BITS
    first_y, last_y = (y - REACH - low[1]) >> BLOCK_BITS, (y + REACH - low[1]) >> BLOCK_BITS
    for bx in range(max(first_x, 0), min(last_x + 1, rows)):
        for by in range(max(first_y, 0), min(last_y + 1, wide)):
            block = bx * wide + by
            if flattest[block] > most:
                continue
            for k in range(start[block], start[block + 1]):
                j = order[k]
                q = labels[j]
                if (
                    q >= 0
                    and variance[q] <= most
                    and abs(ix[j] - x) <= REACH
                    and abs(iy[j] - y) <= REACH
                    and bottom[j] <= top[i]
                    and top[j] >= bottom[i]
                ):
                    return True
    return False
