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

from tccm_ros.cuboids.moments import residuals_of
from tccm_ros.planes.inliers import GATE, NOISE_FLOOR
from tccm_ros.planes.plane_table import keep_planes

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
    first, level, is_held = level_planes_by_block(start, order, labels, is_standing)
    near = np.empty(len(planes), np.int32)
    for b in range(len(is_held)):
        if is_held[b]:
            count = level_planes_around(b, rows, wide, first, level, near)
            if count > 0:
                take_disputed(M, order[start[b] : start[b + 1]], near[:count], labels, planes,
                              is_standing)  # fmt: skip
    return keep_planes(labels, planes, ~is_standing | (planes[:, 7] >= KEPT * before))


@njit(nogil=True, cache=True)
def level_planes_by_block(
    start: Int, order: Int, labels: Int, is_standing: Flags
) -> tuple[Int, Int, Flags]:
    """List the level planes of each block.

    Returns
    -------
    first, level : int32 (blocks + 1,) and int32
        Where each block's level planes begin, and the planes.
    is_held : bool (blocks,)
        Which blocks have cuboids of upright planes.
    """
    blocks = len(start) - 1
    is_held = np.zeros(blocks, np.bool_)
    first, level = np.empty(blocks + 1, np.int32), np.empty(len(order), np.int32)
    used = 0
    for b in range(blocks):
        first[b] = used
        last = -1
        for k in range(start[b], start[b + 1]):
            p = labels[order[k]]
            if p == last or p < 0:
                continue
            last = p
            if is_standing[p]:
                is_held[b] = True
                continue
            j = first[b]
            while j < used and level[j] != p:
                j += 1
            if j == used:
                level[used] = p
                used += 1
    first[blocks] = used
    return first, level, is_held


@njit(nogil=True, cache=True)
def level_planes_around(b: int, rows: int, wide: int, first: Int, level: Int, near: Int) -> int:
    """Write the level planes in and around block b to `near`, rising, and return how many."""
    bx, by = b // wide, b % wide
    count = 0
    for x in range(max(bx - 1, 0), min(bx + 2, rows)):
        low, high = x * wide + max(by - 1, 0), x * wide + min(by + 2, wide)
        for q in level[first[low] : first[high]]:
            j = count
            while j > 0 and near[j - 1] > q:
                j -= 1
            if j > 0 and near[j - 1] == q:
                continue
            for k in range(count, j, -1):
                near[k] = near[k - 1]
            near[j] = q
            count += 1
    return count


@njit(nogil=True, cache=True)
def take_disputed(
    M: Array, block: Int, near: Int, labels: Int, planes: Array, is_standing: Flags
) -> None:
    """Label the cuboids of a block that an upright plane explains less well than one of `near`.

    Of several level planes the first takes a cuboid, as planes claim in the order of their size.
    """
    for q in near:
        nx, ny, nz, d = planes[q, 0], planes[q, 1], planes[q, 2], planes[q, 3]
        variance = max(planes[q, 6], NOISE_FLOOR * NOISE_FLOOR)
        most = GATE * GATE * variance
        for i in block:
            n = M[i, 0]
            # Nearly all are told by their mean, for a third of the work.
            one = nx * M[i, 1] + ny * M[i, 2] + nz * M[i, 3] - n * d
            if one * one > most * n * n:
                continue
            p = labels[i]
            if p < 0 or not is_standing[p]:
                continue
            _, two = residuals_of(M[i], nx, ny, nz, d)
            if two > most * n:
                continue
            _, held = residuals_of(M[i], planes[p, 0], planes[p, 1], planes[p, 2], planes[p, 3])
            if held > max(OFF * OFF * variance * n, CLOSER * two):
                labels[i] = q
                planes[p, 7] -= n
                planes[q, 7] += n
