"""Cuboids that an upright plane took from a level one: they go to the plane that explains them.

Planes claim in the order of their size, and whatever is within the gate. A wall so takes the rear
of the shelf boards that stand against it, and a plane through the rears of several boards, one
above the other, may be found where nothing stands. A cuboid of an upright plane that lies in a
level one beside it goes there if its points are further from the upright one than the level one's
noise explains, and more than twice as far as from the level one.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tccm_ros.mapping.moments import residuals_of
from tccm_ros.mapping.plane_blocks import queue_around
from tccm_ros.mapping.plane_members import GATE, NOISE_FLOOR

__all__ = ["give_back"]

Array = NDArray[np.float64]
Int = NDArray[np.int32]
Flags = NDArray[np.bool_]

OFF = 2.5
"""Deviations of the level plane by which points must be off the upright one."""

CLOSER = 4.0
"""How much smaller the sum of squared distances to the level plane must be."""

KEPT = 0.5
"""An upright plane that loses more of its points was none."""


@njit(nogil=True, cache=True)
def give_back(
    M: Array,
    start: Int,
    order: Int,
    rows: int,
    wide: int,
    queue: Int,
    stamp: Int,
    labels: Int,
    planes: Array,
    is_standing: Flags,
) -> Array:
    """Give level planes the cuboids that upright ones hold, and drop what is left with too few.

    Parameters
    ----------
    M
        float64 (N, 10), moments.
    start, order, rows, wide
        Of `sort_into_blocks`.
    queue, stamp
        int32, work space for all blocks.
    labels
        int32 (N,), changed: rows of `planes`, -1 for none.
    planes
        float64 (P, PLANE_COLUMNS), changed: the points of all cuboids, in column 7.
    is_standing
        bool (P,), which planes are upright.

    Returns
    -------
    float64 (Q, PLANE_COLUMNS): the planes that remain, in their order; labels are theirs.
    """
    if is_standing.all() or not is_standing.any():
        return planes
    before = planes[:, 7].copy()
    stamp[:] = -1
    first, blocks, is_held = blocks_by_plane(start, order, labels, is_standing)
    for q in range(len(planes)):
        if is_standing[q]:
            continue
        queued = 0
        for b in blocks[first[q] : first[q + 1]]:
            if stamp[b] != q:
                stamp[b] = q
                queue[queued] = b
                queued += 1
        own = queued
        for b in queue[:own]:
            queued = queue_around(b, q, rows, wide, queue, queued, stamp)
        for b in queue[:queued]:
            if is_held[b]:
                take_disputed(M, start, order, b, q, labels, planes, is_standing)
    return drop_robbed(labels, planes, before, is_standing)


@njit(nogil=True, cache=True)
def blocks_by_plane(
    start: Int, order: Int, labels: Int, is_standing: Flags
) -> tuple[Int, Int, Flags]:
    """Sort blocks by the planes of their cuboids.

    Returns
    -------
    first, blocks : int32 (P + 1,) and int32
        Where each plane's blocks begin, and the blocks: one for each run of its cuboids in it.
    is_held : bool
        Which blocks have cuboids of upright planes.
    """
    planes = len(is_standing)
    is_held = np.zeros(len(start) - 1, np.bool_)
    first = np.zeros(planes + 2, np.int32)
    for b in range(len(start) - 1):
        last = -1
        for k in range(start[b], start[b + 1]):
            p = labels[order[k]]
            if p != last and p >= 0:
                first[p + 2] += 1
                is_held[b] |= is_standing[p]
            last = p
    first[1] = 0
    for p in range(planes):
        first[p + 2] += first[p + 1]
    blocks = np.empty(first[planes + 1], np.int32)
    for b in range(len(start) - 1):
        last = -1
        for k in range(start[b], start[b + 1]):
            p = labels[order[k]]
            if p != last and p >= 0:
                blocks[first[p + 1]] = b
                first[p + 1] += 1
            last = p
    return first, blocks, is_held


@njit(nogil=True, cache=True)
def take_disputed(
    M: Array,
    start: Int,
    order: Int,
    b: int,
    q: int,
    labels: Int,
    planes: Array,
    is_standing: Flags,
) -> None:
    """Label as q the cuboids of block b that an upright plane explains less well."""
    variance = max(planes[q, 6], NOISE_FLOOR * NOISE_FLOOR)
    gate = GATE * np.sqrt(variance)
    for k in range(start[b], start[b + 1]):
        i = order[k]
        p = labels[i]
        if p < 0 or not is_standing[p]:
            continue
        m = M[i]
        one, two = residuals_of(m, planes[q, 0], planes[q, 1], planes[q, 2], planes[q, 3])
        if abs(one) > gate * m[0] or two > gate * gate * m[0]:
            continue
        _, held = residuals_of(m, planes[p, 0], planes[p, 1], planes[p, 2], planes[p, 3])
        if held > max(OFF * OFF * variance * m[0], CLOSER * two):
            labels[i] = q
            planes[p, 7] -= m[0]
            planes[q, 7] += m[0]


@njit(nogil=True, cache=True)
def drop_robbed(labels: Int, planes: Array, before: Array, is_standing: Flags) -> Array:
    """Drop the upright planes that lost most of their points, and number the rest anew."""
    number = np.empty(len(planes), np.int32)
    kept = 0
    for p in range(len(planes)):
        number[p] = -1
        if not is_standing[p] or planes[p, 7] >= KEPT * before[p]:
            number[p] = kept
            planes[kept] = planes[p]
            kept += 1
    if kept < len(planes):
        for i in range(len(labels)):
            if labels[i] >= 0:
                labels[i] = number[labels[i]]
    return planes[:kept]
