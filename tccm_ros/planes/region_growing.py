"""Regions: neighbouring patches that lie in one plane, grown over the pyramid's blocks."""

import math

import numpy as np

from tccm_ros.arrays import Float64, Int32
from tccm_ros.cuboids.moments import FLAT, plane_of, residuals_of
from tccm_ros.kernels import kernel
from tccm_ros.planes.blocks import Blocks, flatness_order

JOIN_FACTOR = 2.5
"""Maximum rms residual of a patch about the plane of a region that it joins, in the region's noise,
plus `SLACK`. Chosen."""

REFIT_GROWTH = 1.3
"""Growth of a region's points at which its plane is refitted. Chosen: far fewer fits than patches.
"""

SLACK = 0.002
"""Tolerance of surfaces that are not flat, and of the uncertain noise of small patches, m. Chosen.
"""


@kernel
def cover(place: Int32, rows: int, wide: int) -> tuple[Int32, Int32, Int32]:
    """Return linked lists of the patches that cover each block of the lowest level.

    Parameters
    ----------
    place
        int32 (K, 3), result of `find_patches`.
    rows, wide
        Blocks of the lowest level in x and y.

    Returns
    -------
    head : int32 (rows * wide,)
        First node of each block, -1 for none.
    node_patch, node_next : int32 (L,)
        Patch of each node, and the next node of its list.
    """
    total = 0
    for p in range(len(place)):
        total += 1 << (2 * place[p, 0])
    head = np.full(rows * wide, -1, np.int32)
    node_patch, node_next = np.empty(total, np.int32), np.empty(total, np.int32)
    used = 0
    for p in range(len(place)):
        level = place[p, 0]
        size = 1 << level
        x0, y0 = place[p, 1] << level, place[p, 2] << level
        for bx in range(x0, min(x0 + size, rows)):
            for by in range(y0, min(y0 + size, wide)):
                b = bx * wide + by
                node_patch[used], node_next[used] = p, head[b]
                head[b] = used
                used += 1
    return head, node_patch, node_next


@kernel
def grow_regions(
    moments: Float64, planes: Float64, place: Int32, blocks: Blocks, max_rms: float
) -> tuple[Int32, Float64]:
    """Return regions of patches, grown from the flattest patches.

    Parameters
    ----------
    moments, planes, place
        Results of `find_patches`.
    blocks, max_rms
        As in `find_patches`.

    Returns
    -------
    region : int32 (K,)
        Region of each patch.
    pooled : float64 (R, 10)
        Moments of each region.
    """
    n, rows, wide = len(moments), blocks.rows, blocks.wide
    head, node_patch, node_next = cover(place, rows, wide)
    region = np.full(n, -1, np.int32)
    seen = np.full(n, -1, np.int32)
    queue = np.empty(n, np.int32)
    pooled = np.empty((n, 10))
    regions = 0
    for seed in flatness_order(planes):
        if region[seed] >= 0:
            continue
        m = pooled[regions]
        m[:] = moments[seed]
        nx, ny, nz, d, variance = planes[seed]
        region[seed], seen[seed] = regions, regions
        queue[0] = seed
        first, end = 0, 1
        refit_at = REFIT_GROWTH * m[0]
        while first < end:
            level = place[queue[first], 0]
            size = 1 << level
            x0, y0 = place[queue[first], 1] << level, place[queue[first], 2] << level
            first += 1
            for bx in range(max(x0 - 1, 0), min(x0 + size + 1, rows)):
                inside = x0 <= bx < x0 + size
                for by in range(max(y0 - 1, 0), min(y0 + size + 1, wide)):
                    if inside and size > 2 and y0 < by < y0 + size - 1:
                        continue
                    b = bx * wide + by
                    node, kept = head[b], -1
                    while node >= 0:
                        p = node_patch[node]
                        node, this = node_next[node], node
                        if region[p] >= 0:
                            # Remove the assigned patch from the list.
                            if kept < 0:
                                head[b] = node
                            else:
                                node_next[kept] = node
                            continue
                        kept = this
                        if seen[p] == regions:
                            continue
                        seen[p] = regions
                        _, second = residuals_of(moments[p], nx, ny, nz, d)
                        noise = math.sqrt(variance + FLAT)
                        if second > moments[p, 0] * min(JOIN_FACTOR * noise + SLACK, max_rms) ** 2:
                            continue
                        region[p] = regions
                        queue[end] = p
                        end += 1
                        for k in range(10):
                            m[k] += moments[p, k]
                        if m[0] > refit_at:
                            nx, ny, nz, d, _, _, variance = plane_of(m)
                            refit_at = REFIT_GROWTH * m[0]
        regions += 1
    return region, pooled[:regions]
