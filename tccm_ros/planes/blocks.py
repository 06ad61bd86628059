"""Flat patches: cuboids pooled in blocks, and in larger blocks where samples are sparse.

Cells are grouped in square blocks. In each block cuboids that overlap in height are pooled, tall
ones (walls) separately from flat ones. A pool whose points span an area and lie in a plane is a
*patch*. A pool that is only a line, as where one scan line crosses the block, is passed to a block
of twice the size, and so on: the level of the pyramid adapts to the sample spacing.
"""

import math
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int32
from tccm_ros.cuboids.moments import plane_of
from tccm_ros.kernels import kernel
from tccm_ros.planes.arrays import PlaneMap

BLOCK_BITS = 2
"""A block of the lowest level is 2**2 cells wide. Chosen: 8 cm at cells of 20 mm."""

LEVELS = 5
"""Levels of the pyramid: the largest block is 16 times as wide as the smallest. Chosen."""

MIN_SPREAD = 0.15
"""A pool spans an area if its second standard deviation exceeds this fraction of the block's width.
Chosen: about half that of a filled block, 0.29."""


class Blocks(NamedTuple):
    """The cuboids of a map by block of the lowest level.

    Attributes
    ----------
    start
        int32 (blocks + 1,), index in `order` of the first cuboid of block ``bx * wide + by``.
    order
        int32 (N,), cuboids by block, in their own order within it.
    rows, wide
        Blocks in x and y.
    low_x, low_y
        Indices of the first block's first cell.
    """

    start: Int32
    order: Int32
    rows: int
    wide: int
    low_x: int
    low_y: int


@kernel
def sort_into_blocks(ix: Int32, iy: Int32) -> Blocks:
    """Return cuboids, whose cells are sorted by (ix, iy), grouped in blocks of the lowest level."""
    n = len(ix)
    low_x, low_y = ix[0], iy.min()
    rows = ((ix[n - 1] - low_x) >> BLOCK_BITS) + 1
    wide = ((iy.max() - low_y) >> BLOCK_BITS) + 1
    blocks = rows * wide
    block = np.empty(n, np.int32)
    start = np.zeros(blocks + 1, np.int32)
    for i in range(n):
        b = ((ix[i] - low_x) >> BLOCK_BITS) * wide + ((iy[i] - low_y) >> BLOCK_BITS)
        block[i] = b
        start[b + 1] += 1
    for b in range(blocks):
        start[b + 1] += start[b]
    fill = start.copy()
    order = np.empty(n, np.int32)
    for i in range(n):
        b = block[i]
        order[fill[b]] = i
        fill[b] += 1
    return Blocks(start, order, rows, wide, low_x, low_y)


@kernel
def queue_around(b: int, mark: int, blocks: Blocks, queue: Int32, queued: int, stamp: Int32) -> int:
    """Queue the blocks in and around a block that have not been queued yet.

    Parameters
    ----------
    b
        The block.
    mark
        Number of the search.
    blocks
        Blocks of the map.
    queue, queued
        int32 (blocks,), the queue, changed, and its length.
    stamp
        int32 (blocks,), changed: the last search that queued each block.

    Returns
    -------
    int
        The new length of the queue.
    """
    rows, wide = blocks.rows, blocks.wide
    bx, by = b // wide, b % wide
    for x in range(max(bx - 1, 0), min(bx + 2, rows)):
        for y in range(max(by - 1, 0), min(by + 2, wide)):
            if stamp[x * wide + y] != mark:
                stamp[x * wide + y] = mark
                queue[queued] = x * wide + y
                queued += 1
    return queued


class _Pools(NamedTuple):
    """Pools of cuboids that overlap in height in one block.

    Attributes
    ----------
    low, high
        int32, lowest bottom and highest top, ticks.
    tall
        bool, whether it is of tall cuboids.
    moments
        float64 (.., 10).
    block
        int32, block of the level.
    """

    low: Int32
    high: Int32
    tall: Bool
    moments: Float64
    block: Int32


class _Patches(NamedTuple):
    """Arrays of patches, as returned by `find_patches`."""

    moments: Float64
    planes: Float64
    place: Int32


@kernel
def pool_cuboids(cuboids: PlaneMap, blocks: Blocks, pools: _Pools) -> int:
    """Pool the cuboids of each block of the lowest level; return the number of pools.

    Parameters
    ----------
    cuboids, blocks
        As in `find_patches`.
    pools
        Written; their length is at least the number of cuboids.
    """
    low, high, tall, moments, block = pools
    width = cuboids.cell * cuboids.tick
    tall_variance = width * width
    used = 0
    for b in range(blocks.rows * blocks.wide):
        begin = used
        for k in range(blocks.start[b], blocks.start[b + 1]):
            i = blocks.order[k]
            m, lo, hi = cuboids.M[i], cuboids.bottom[i], cuboids.top[i]
            is_tall = m[9] * m[0] - m[3] * m[3] > tall_variance * m[0] * m[0]
            # Search from the newest pool: cuboids are sorted, so that it matches most often.
            g = used - 1
            while g >= begin and (tall[g] != is_tall or lo > high[g] or hi < low[g]):
                g -= 1
            if g >= begin:
                low[g], high[g] = min(low[g], lo), max(high[g], hi)
                for c in range(10):
                    moments[g, c] += m[c]
            else:
                block[used], low[used], high[used], tall[used] = b, lo, hi, is_tall
                for c in range(10):
                    moments[used, c] = m[c]
                used += 1
    return used


@kernel
def take_patches(
    pools: _Pools, used: int, level: tuple[int, int, float], max_rms: float, min_count: float,
    patches: _Patches, found: int,
) -> tuple[int, int]:  # fmt: skip
    """Remove the pools that span an area from a level; planar ones become patches.

    Parameters
    ----------
    pools, used
        The pools of a level, and their number; the remaining pools are moved to the front.
    level
        The level, its blocks in y, and their width, m.
    max_rms, min_count
        As in `find_patches`.
    patches, found
        The patches, written, and their number.

    Returns
    -------
    The numbers of pools that remain and of patches.
    """
    low, high, tall, moments, block = pools
    number, wide, width = level
    min_spread = MIN_SPREAD * width * MIN_SPREAD * width
    kept = 0
    for g in range(used):
        m = moments[g]
        spans = m[0] >= min_count and may_have_spread(m, min_spread)
        if spans:
            nx, ny, nz, d, _, l2, l3 = plane_of(m)
            spans = l2 >= min_spread
            if spans and l3 <= max_rms * max_rms:
                for k in range(10):
                    patches.moments[found, k] = m[k]
                plane, place = patches.planes[found], patches.place[found]
                plane[0], plane[1], plane[2], plane[3], plane[4] = nx, ny, nz, d, l3
                place[0], place[1], place[2] = number, block[g] // wide, block[g] % wide
                found += 1
        if not spans:
            for k in range(10):
                moments[kept, k] = m[k]
            low[kept], high[kept], tall[kept], block[kept] = low[g], high[g], tall[g], block[g]
            kept += 1
    return kept, found


@kernel
def pass_to_larger(pools: _Pools, used: int, rows: int, wide: int, gap: int) -> int:
    """Merge the remaining pools of a level in blocks of twice the size.

    Pools are compacted in place, since the write index never overtakes the read index.

    Parameters
    ----------
    pools, used
        Changed: the pools, and their number.
    rows, wide
        Blocks of their level in x and y.
    gap
        Ticks; pools across a smaller gap are merged. Sparse samples are sparse in height too: scan
        lines climb a wall in steps.

    Returns
    -------
    int
        The new number of pools.
    """
    next_wide, next_rows = (wide + 1) >> 1, (rows + 1) >> 1
    head, following = np.full(next_rows * next_wide, -1, np.int32), np.empty(used, np.int32)
    left = 0
    for g in range(used):
        b = (pools.block[g] // wide >> 1) * next_wide + (pools.block[g] % wide >> 1)
        left = _pool(head, following, pools, left, b, g, gap)
    return left


@kernel
def _pool(
    head: Int32, following: Int32, pools: _Pools, used: int, b: int, of: int, gap: int
) -> int:
    """Merge pool `of` into a pool of block `b` that overlaps it in height up to a gap.

    Without such a pool it becomes a new one. Returns the new number of pools, at most ``of + 1``.
    """
    low, high, tall, moments, block = pools
    lo, hi, is_tall = low[of], high[of], tall[of]
    g = head[b]
    while g >= 0:
        if tall[g] == is_tall and lo <= high[g] + gap and hi >= low[g] - gap:
            low[g], high[g] = min(low[g], lo), max(high[g], hi)
            for k in range(10):
                moments[g, k] += moments[of, k]
            return used
        g = following[g]
    following[used] = head[b]
    head[b] = used
    low[used], high[used], tall[used], block[used] = lo, hi, is_tall, b
    for k in range(10):
        moments[used, k] = moments[of, k]
    return used + 1


@kernel
def may_have_spread(m: Float64, min_variance: float) -> bool:
    """Return whether the second eigenvalue l2 of the points' covariance may be a minimum, m2.

    This rejects lines fast: the sum of minors is l1 l2 + l1 l3 + l2 l3 and l1 is at least a third
    of the trace, so that l2 is at most three times the ratio of minors and trace.
    """
    k = 1.0 / m[0]
    px, py, pz = m[1] * k, m[2] * k, m[3] * k
    xx, xy, xz = m[4] * k - px * px, m[5] * k - px * py, m[6] * k - px * pz
    yy, yz, zz = m[7] * k - py * py, m[8] * k - py * pz, m[9] * k - pz * pz
    minors = xx * yy - xy * xy + xx * zz - xz * xz + yy * zz - yz * yz
    return 3.0 * minors >= min_variance * (xx + yy + zz)


@kernel
def find_patches(
    cuboids: PlaneMap, blocks: Blocks, max_rms: float, min_count: float
) -> tuple[Float64, Float64, Int32]:
    """Return the flat patches of all levels.

    Parameters
    ----------
    cuboids, blocks
        Cuboids and blocks of the map.
    max_rms
        Largest standard deviation across a patch, m.
    min_count
        Minimum number of points of a patch.

    Returns
    -------
    moments : float64 (K, 10)
    planes : float64 (K, 5)
        nx, ny, nz, d, variance across.
    place : int32 (K, 3)
        Level, and block (bx, by) of that level.
    """
    n = len(blocks.order)
    pools = _Pools(
        np.empty(n, np.int32),
        np.empty(n, np.int32),
        np.empty(n, np.bool_),
        np.empty((n, 10)),
        np.empty(n, np.int32),
    )
    used, found = pool_cuboids(cuboids, blocks, pools), 0
    patches = _Patches(np.empty((used, 10)), np.empty((used, 5)), np.empty((used, 3), np.int32))
    rows, wide, cell = blocks.rows, blocks.wide, cuboids.cell * cuboids.tick
    for number in range(LEVELS):
        level = number, wide, cell * (1 << (BLOCK_BITS + number))
        used, found = take_patches(pools, used, level, max_rms, min_count, patches, found)
        if used == 0 or number == LEVELS - 1:
            break
        used = pass_to_larger(pools, used, rows, wide, int(cuboids.cell * (1 << number)))
        rows, wide = (rows + 1) >> 1, (wide + 1) >> 1
    return patches.moments[:found], patches.planes[:found], patches.place[:found]


@kernel
def flatness_order(planes: Float64) -> Int32:
    """Return the indices of patches by rising thickness in powers of two; the sort is stable."""
    classes = 24
    n = len(planes)
    key = np.empty(n, np.int32)
    start = np.zeros(classes + 1, np.int32)
    for i in range(n):
        # 2**-34 m2 is (7.6 um)2, below which thickness is quantisation.
        key[i] = min(classes - 1, max(0, int(math.log2(planes[i, 4] + 1e-12)) + 34))
        start[key[i] + 1] += 1
    for k in range(classes):
        start[k + 1] += start[k]
    order = np.empty(n, np.int32)
    for i in range(n):
        order[start[key[i]]] = i
        start[key[i]] += 1
    return order
