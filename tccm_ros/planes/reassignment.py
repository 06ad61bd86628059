"""Reassignment of inliers from vertical planes to the horizontal planes that fit them better.

Inliers are assigned plane by plane, the largest first, within a gate. As a result, a wall takes the
rear points of shelf boards that touch it, and a plane through the rears of several boards above
each other may be found where there is no surface. A cuboid of a vertical plane is reassigned to a
horizontal plane beside it if its distance from the vertical plane is more than three times the
horizontal plane's noise, and more than twice its distance from the horizontal plane. Here
"horizontal" means "not vertical".
"""

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int32
from tccm_ros.cuboids.moments import residuals_of
from tccm_ros.kernels import kernel
from tccm_ros.planes.arrays import PlaneTable, keep_planes
from tccm_ros.planes.blocks import Blocks
from tccm_ros.planes.edge_planes import MIN_VARIANCE_RATIO
from tccm_ros.planes.inliers import GATE as INLIER_GATE
from tccm_ros.planes.inliers import NOISE_FLOOR
from tccm_ros.robust import GATE, MAJORITY


@kernel
def reassign_inliers(
    M: Float64, blocks: Blocks, labels: Int32, planes: PlaneTable, is_vertical: Bool
) -> PlaneTable:
    """Reassign inliers from vertical to horizontal planes; drop vertical planes with too few.

    Parameters
    ----------
    M
        float64 (N, 10), moments.
    blocks
        Blocks of the map.
    labels
        int32 (N,), changed: rows of `planes`, -1 for none.
    planes
        (P,), changed: their support.
    is_vertical
        bool (P,), which planes are vertical.

    Returns
    -------
    (Q,), the remaining planes, in their order; labels are rows of these.
    """
    if is_vertical.all() or not is_vertical.any():
        return planes
    start, order = blocks.start, blocks.order
    before = planes["support"].copy()
    first, horizontal, is_held = horizontal_planes_by_block(blocks, labels, is_vertical)
    near = np.empty(len(planes), np.int32)
    for b in range(len(is_held)):
        if is_held[b]:
            count = horizontal_planes_around(b, blocks, first, horizontal, near)
            if count > 0:
                members = order[start[b] : start[b + 1]]
                reassign_block(M, members, near[:count], labels, planes, is_vertical)
    return keep_planes(labels, planes, ~is_vertical | (planes["support"] >= MAJORITY * before))


@kernel
def horizontal_planes_by_block(
    blocks: Blocks, labels: Int32, is_vertical: Bool
) -> tuple[Int32, Int32, Bool]:
    """Return the horizontal planes of each block.

    Parameters
    ----------
    blocks
        Blocks of the map.
    labels
        int32 (N,), plane of each cuboid, -1 for none.
    is_vertical
        bool (P,), which planes are vertical.

    Returns
    -------
    first, horizontal : int32 (blocks + 1,) and int32
        Index of each block's first horizontal plane in the second array, and the planes.
    is_held : bool (blocks,)
        Which blocks have cuboids of vertical planes.
    """
    start, order = blocks.start, blocks.order
    count = len(start) - 1
    is_held = np.zeros(count, np.bool_)
    first, horizontal = np.empty(count + 1, np.int32), np.empty(len(order), np.int32)
    used = 0
    for b in range(count):
        first[b] = used
        last = -1
        for k in range(start[b], start[b + 1]):
            p = labels[order[k]]
            if p == last or p < 0:
                continue
            last = p
            if is_vertical[p]:
                is_held[b] = True
                continue
            j = first[b]
            while j < used and horizontal[j] != p:
                j += 1
            if j == used:
                horizontal[used] = p
                used += 1
    first[count] = used
    return first, horizontal, is_held


@kernel
def horizontal_planes_around(
    b: int, blocks: Blocks, first: Int32, horizontal: Int32, near: Int32
) -> int:
    """Write the horizontal planes in and around a block to `near`.

    Parameters
    ----------
    b, blocks
        The block, and all blocks of the map.
    first, horizontal
        Results of `horizontal_planes_by_block`.
    near
        int32 (>= P,), receives the planes, rising.

    Returns
    -------
    int
        Number of planes written.
    """
    rows, wide = blocks.rows, blocks.wide
    bx, by = b // wide, b % wide
    count = 0
    for x in range(max(bx - 1, 0), min(bx + 2, rows)):
        low, high = x * wide + max(by - 1, 0), x * wide + min(by + 2, wide)
        for q in horizontal[first[low] : first[high]]:
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


@kernel
def reassign_block(
    M: Float64, block: Int32, near: Int32, labels: Int32, planes: PlaneTable, is_vertical: Bool
) -> None:
    """Reassign the cuboids of a block that fit a horizontal plane better than their vertical one.

    A cuboid that fits several horizontal planes is assigned to the first, in the order of `near`.

    Parameters
    ----------
    M
        float64 (N, 10), moments.
    block
        int32, indices of the block's cuboids.
    near
        int32, the horizontal planes in and around the block.
    labels, planes, is_vertical
        As in `reassign_inliers`; labels and support are changed.
    """
    for q in near:
        normal = planes[q].normal
        nx, ny, nz = normal[0], normal[1], normal[2]
        d, variance = planes[q].offset, planes[q].variances[2]
        variance = max(variance, NOISE_FLOOR * NOISE_FLOOR)
        max_variance = INLIER_GATE * INLIER_GATE * variance
        for i in block:
            n = M[i, 0]
            # The cheaper test of the mean rejects nearly all cuboids.
            residual = nx * M[i, 1] + ny * M[i, 2] + nz * M[i, 3] - n * d
            if residual * residual > max_variance * n * n:
                continue
            p = labels[i]
            if p < 0 or not is_vertical[p]:
                continue
            _, squares = residuals_of(M[i], nx, ny, nz, d)
            if squares > max_variance * n:
                continue
            other = planes[p].normal
            _, old_squares = residuals_of(M[i], other[0], other[1], other[2], planes[p].offset)
            if old_squares > max(GATE * GATE * variance * n, MIN_VARIANCE_RATIO * squares):
                labels[i] = q
                planes[p].support -= n
                planes[q].support += n
