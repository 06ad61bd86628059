"""Removal of planes that consist of the edge cells of flatter planes.

Where a stove stands on a counter, the cells along its rim hold points of its top, of its low front
and of the counter. They are inliers of neither plane. They form a connected band around the stove,
whose scatter is the height of the front, and would join the two surfaces. In such a band nearly all
cuboids are beside cuboids of a plane that is at least twice as flat.
"""

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int32
from tccm_ros.kernels import kernel
from tccm_ros.planes.arrays import PlaneMap, PlaneTable, keep_planes
from tccm_ros.planes.blocks import BLOCK_BITS, Blocks

MIN_VARIANCE_RATIO = 4.0
"""Minimum ratio of the variances across two planes for one to be the flatter one. Chosen: half the
standard deviation."""

MAX_CELLS = 2
"""Maximum number of cells between neighbouring cuboids; less than a block's width. Chosen."""

MIN_EDGE_FRACTION = 0.8
"""Minimum fraction of an edge plane's cuboids that are beside flatter planes. Chosen."""


@kernel
def drop_edge_planes(
    cuboids: PlaneMap, blocks: Blocks, labels: Int32, planes: PlaneTable, is_vertical: Bool
) -> PlaneTable:
    """Remove the planes that are edges of flatter ones; return the remaining planes.

    Parameters
    ----------
    cuboids, blocks
        Cuboids and blocks of the map.
    labels
        int32 (N,), changed: rows of `planes`, -1 for none.
    planes
        (P,), changed.
    is_vertical
        bool (P,), whether a plane is vertical: vertical planes neither are nor have edge planes.

    Returns
    -------
    (Q,), the remaining planes, in their order; labels are rows of these.
    """
    if is_vertical.all():
        return planes
    variance = np.where(is_vertical, np.inf, planes["variances"][:, 2])
    suspect = (variance > MIN_VARIANCE_RATIO * variance.min()) & ~is_vertical
    if not suspect.any():
        return planes
    inliers = np.zeros(len(planes), np.int32)
    not_beside = np.zeros(len(planes), np.int32)
    for p in labels:
        if p >= 0:
            inliers[p] += 1
    flattest = flattest_by_block(blocks, labels, variance)
    for i in range(len(labels)):
        p = labels[i]
        if p >= 0 and suspect[p]:
            max_variance = variance[p] / MIN_VARIANCE_RATIO
            if not is_beside(cuboids, i, blocks, labels, variance, flattest, max_variance):
                not_beside[p] += 1
                # Most planes are no edge planes, which a few of their cuboids decide.
                suspect[p] = not_beside[p] <= (1.0 - MIN_EDGE_FRACTION) * inliers[p]
    return keep_planes(labels, planes, ~suspect)


@kernel
def flattest_by_block(blocks: Blocks, labels: Int32, variance: Float64) -> Float64:
    """Return the smallest variance of the planes of each block's cuboids.

    Parameters
    ----------
    blocks
        Blocks of the map.
    labels
        int32 (N,), plane of each cuboid, -1 for none.
    variance
        float64 (P,), across each plane, m2.

    Returns
    -------
    float64 (blocks,), m2, inf where there are no planes.
    """
    start, order = blocks.start, blocks.order
    flattest = np.full(len(start) - 1, np.inf)
    for block in range(len(flattest)):
        for k in range(start[block], start[block + 1]):
            p = labels[order[k]]
            if p >= 0:
                flattest[block] = min(flattest[block], variance[p])
    return flattest


@kernel
def is_beside(
    cuboids: PlaneMap, i: int, blocks: Blocks, labels: Int32, variance: Float64, flattest: Float64,
    max_variance: float,
) -> bool:  # fmt: skip
    """Return whether a cuboid lies beside a cuboid of a flat plane.

    Parameters
    ----------
    cuboids, i
        The map, and the index of the cuboid.
    blocks, labels, variance
        As in `flattest_by_block`.
    flattest
        Result of `flattest_by_block`.
    max_variance
        Maximum variance across a flat plane, m2.
    """
    _, ix, iy, bottom, top = cuboids[:5]
    start, order, rows, wide, low_x, low_y = blocks
    x, y = ix[i], iy[i]
    first_x, last_x = (x - MAX_CELLS - low_x) >> BLOCK_BITS, (x + MAX_CELLS - low_x) >> BLOCK_BITS
    first_y, last_y = (y - MAX_CELLS - low_y) >> BLOCK_BITS, (y + MAX_CELLS - low_y) >> BLOCK_BITS
    for bx in range(max(first_x, 0), min(last_x + 1, rows)):
        for by in range(max(first_y, 0), min(last_y + 1, wide)):
            block = bx * wide + by
            if flattest[block] > max_variance:
                continue
            for k in range(start[block], start[block + 1]):
                j = order[k]
                q = labels[j]
                if (
                    q >= 0
                    and variance[q] <= max_variance
                    and abs(ix[j] - x) <= MAX_CELLS
                    and abs(iy[j] - y) <= MAX_CELLS
                    and bottom[j] <= top[i]
                    and top[j] >= bottom[i]
                ):
                    return True
    return False
