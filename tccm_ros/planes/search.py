"""All planes of a map, from its cuboids' moments: the one kernel behind `find_planes`."""

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tccm_ros.cuboids.linking import link_in_plane
from tccm_ros.cuboids.moments import plane_of, residuals_of
from tccm_ros.planes.blocks import BLOCK_BITS, find_patches, sort_into_blocks
from tccm_ros.planes.edges import drop_edges
from tccm_ros.planes.growth import grow_regions
from tccm_ros.planes.inliers import (
    GATE,
    GENTLE,
    Plane,
    claim,
    fit_lying,
    pooled_plane,
    sharing_cells,
)
from tccm_ros.planes.plane_map import PlaneMap, plane_map
from tccm_ros.planes.plane_table import PLANE_COLUMNS
from tccm_ros.planes.reassignment import give_back
from tccm_ros.planes.vertical_patches import link_standing
from tccm_ros.planes.vertical_planes import fit_standing

__all__ = ["planes_of", "segment"]

Array = NDArray[np.float64]
Int = NDArray[np.int32]
Flags = NDArray[np.bool_]

STEEP = 0.20
"""Planes with a smaller vertical component of the normal stand: their cells form a line."""

PATCH_POINTS = 6
"""Least points of a flat patch: a plane has three parameters, and needs as many to judge it."""


@njit(nogil=True, cache=True)
def planes_of(
    arrays: tuple[Any, ...], view: Array, limits: tuple[float, float, float, float, float]
) -> tuple[Int, Array]:
    """Find all planes in what `plane_map` takes: it and `segment` in one compiled call."""
    return segment(plane_map(*arrays), view, limits)


@njit(nogil=True, cache=True)
def segment(
    cuboids: PlaneMap,
    view: Array,
    limits: tuple[float, float, float, float, float],
) -> tuple[Int, Array]:
    """Find all planes of a map.

    Parameters
    ----------
    cuboids
        Those of the map, N > 0.
    view
        float64 (3,), m: where the laser was.
    limits
        Largest standard deviation across, m; least points; least area, m2; largest ratio of the
        standard deviations across and along the narrower side; least vertical component of a level
        plane's normal.

    Returns
    -------
    labels : int32 (N,)
    planes : float64 (P, PLANE_COLUMNS)
        Normals of level planes point up, others towards the laser.
    """
    M, ix, iy, bottom, top = cuboids[:5]
    cell, tick = cuboids.cell, cuboids.tick
    n = len(ix)
    low_x, low_y = ix[0], iy.min()
    rows = ((ix[n - 1] - low_x) >> BLOCK_BITS) + 1
    wide = ((iy.max() - low_y) >> BLOCK_BITS) + 1
    start, order = sort_into_blocks(ix, iy, low_x, low_y, wide, rows * wide)
    moments, patches, place = find_patches(
        M, start, order, bottom, top, rows, wide, cell * tick, cell, limits[0], PATCH_POINTS
    )
    region, pooled = grow_regions(moments, patches, place, rows, wide, limits[0])
    first, by_region = patches_by_region(region, len(pooled))

    labels, is_taken = np.full(n, -1, np.int32), np.zeros((n >> 6) + 1, np.uint64)
    stamp, queue = np.full(rows * wide, -1, np.int32), np.empty(rows * wide, np.int32)
    planes = np.empty((n // 2 + 1, PLANE_COLUMNS))
    found = 0
    for r in np.argsort(-pooled[:, 0]):
        # Regions leave out what is sparse; a third of the points is the least to begin with.
        if pooled[r, 0] < limits[1] / 3.0:
            break
        queued = blocks_of(by_region[first[r] : first[r + 1]], place, rows, wide, queue, stamp, r)
        plane = pooled_plane(pooled[r])
        members = claim(
            M, start, order, rows, wide, queue, queued, stamp, r, labels, is_taken,
            plane, pooled[r, 0],
        )  # fmt: skip
        if len(members) > 2:
            found = split_and_fit(cuboids, members, plane, limits, labels, planes, found)
    planes = planes[:found]
    is_standing = np.abs(planes[:, 2]) < STEEP
    planes = give_back(M, start, order, rows, wide, labels, planes, is_standing)
    is_standing = np.abs(planes[:, 2]) < STEEP
    planes = drop_edges(cuboids, start, order, (low_x, low_y), wide, labels, planes, is_standing)
    for row in planes:
        orient(row, view, cuboids.origin * tick, limits[4])
    return labels, planes


@njit(nogil=True, cache=True)
def orient(row: Array, view: Array, start: Array, level: float) -> None:
    """Turn a plane's normal up or towards the laser, and bring its offset from `start` to the map.

    Normals whose vertical component is `level` at least belong to level planes.
    """
    nx, ny, nz, d = row[0], row[1], row[2], row[3]
    height = nz
    row[18] = abs(nz) >= level
    if abs(nz) < level:
        height = nx * (view[0] - start[0]) + ny * (view[1] - start[1]) + nz * (view[2] - start[2])
        height -= d
    sign = math.copysign(1.0, height)
    d += nx * start[0] + ny * start[1] + nz * start[2]
    row[0], row[1], row[2], row[3] = sign * nx, sign * ny, sign * nz, sign * d


@njit(nogil=True, cache=True)
def patches_by_region(region: Int, regions: int) -> tuple[Int, Int]:
    """Return where each region's patches begin in the second array, and the patches by region."""
    first = np.zeros(regions + 2, np.int32)
    for r in region:
        first[r + 2] += 1
    for r in range(regions):
        first[r + 2] += first[r + 1]
    ordered = np.empty(len(region), np.int32)
    for p in range(len(region)):
        ordered[first[region[p] + 1]] = p
        first[region[p] + 1] += 1
    return first, ordered


@njit(nogil=True, cache=True)
def blocks_of(
    patches: Int, place: Int, rows: int, wide: int, queue: Int, stamp: Int, mark: int
) -> int:
    """Queue the blocks of a region's patches, and around patches of higher levels as far again."""
    queued = 0
    for p in patches:
        size = 1 << place[p, 0]
        margin = size if size > 1 else 0
        x0, y0 = place[p, 1] * size, place[p, 2] * size
        for bx in range(max(x0 - margin, 0), min(x0 + size + margin, rows)):
            for by in range(max(y0 - margin, 0), min(y0 + size + margin, wide)):
                b = bx * wide + by
                if stamp[b] != mark:
                    stamp[b] = mark
                    queue[queued] = b
                    queued += 1
    return queued


@njit(nogil=True, cache=True)
def split_and_fit(
    cuboids: PlaneMap,
    members: Int,
    plane: Plane,
    limits: tuple[float, float, float, float, float],
    labels: Int,
    planes: Array,
    found: int,
) -> int:
    """Split a plane's cuboids where they do not hang together, fit and label each set.

    Returns the number of planes found so far.
    """
    M, ix, iy = cuboids.M, cuboids.ix, cuboids.iy
    n = len(members)
    is_standing = abs(plane[2]) < STEEP
    if is_standing:
        root = link_standing(ix, iy, members, plane)
        deep = np.ones(n, np.bool_)
    else:
        root, deep = link_in_plane(ix[members], iy[members])
    support, size = sizes_of_sets(M, members, root)
    for k in range(n):
        if support[k] < limits[1]:
            continue
        one, its_deep = take_set(members, deep, root, k, size[k])
        row = planes[found]
        if is_standing:
            fitted = fit_standing(cuboids, one, plane, row[8:18])
        else:
            fitted = fit_lying(cuboids, one, its_deep, plane, row[8:18])
        if is_plane(row, limits):
            if is_standing:
                # Its rims are in the moments, but not as points of the plane.
                row[0], row[1], row[2], row[3], row[6] = fitted
            row[7] = label_members(cuboids, one, fitted, labels, found)
            found += 1
    return found


@njit(nogil=True, cache=True)
def sizes_of_sets(M: Array, members: Int, root: Int) -> tuple[Array, Int]:
    """Return the points and the cuboids of each set, at its smallest index."""
    support, size = np.zeros(len(root)), np.zeros(len(root), np.int32)
    # Sums go on in registers for as long as the set is the same.
    k = 0
    while k < len(root):
        r, first, points = root[k], k, 0.0
        while k < len(root) and root[k] == r:
            points += M[members[k], 0]
            k += 1
        support[r] += points
        size[r] += k - first
    return support, size


@njit(nogil=True, cache=True)
def take_set(members: Int, deep: Flags, root: Int, k: int, size: int) -> tuple[Int, Flags]:
    """Return the members of the set whose smallest index is k, and which of them are deep."""
    one, its_deep = np.empty(size, np.int32), np.empty(size, np.bool_)
    used = 0
    for j in range(k, len(members)):
        if root[j] == k:
            one[used], its_deep[used] = members[j], deep[j]
            used += 1
    return one, its_deep


@njit(nogil=True, cache=True)
def is_plane(row: Array, limits: tuple[float, float, float, float, float]) -> bool:
    """Fill in a plane's row from its moments, and tell whether it is large and flat enough."""
    max_rms, min_points, min_area, flatness, _ = limits
    m = row[8:18]
    if m[0] < 0.5 * min_points:
        return False
    row[0], row[1], row[2], row[3], row[4], row[5], row[6] = plane_of(m)
    if row[6] > min(max_rms * max_rms, flatness * flatness * row[5]):
        return False
    # 12 sqrt(l1 l2) is the area of an evenly filled rectangle.
    return 12.0 * math.sqrt(row[4] * row[5]) >= min_area


@njit(nogil=True, cache=True)
def label_members(cuboids: PlaneMap, members: Int, plane: Plane, labels: Int, label: int) -> float:
    """Label the members that are within the gate of the final plane, and return their points."""
    M, is_flat = cuboids.M, abs(plane[2]) > GENTLE
    is_sharing = sharing_cells(cuboids.ix, cuboids.iy, members)
    nx, ny, nz, d, variance = plane
    points, squares, support = 0.0, 0.0, 0.0
    sums = np.empty((len(members), 2))
    for k in range(len(members)):
        m = M[members[k]]
        sums[k, 0], sums[k, 1] = residuals_of(m, nx, ny, nz, d)
        counts = not (is_flat and is_sharing[k])
        points += m[0] * counts
        squares += sums[k, 1] * counts
    # A warped table scatters more as a whole than where the fit was allowed to look.
    if points > 0.0:
        variance = max(variance, squares / points)
    gate = GATE * math.sqrt(variance)
    for k in range(len(members)):
        i = members[k]
        n = M[i, 0]
        if (abs(sums[k, 0]) <= gate * n) & (sums[k, 1] <= n * gate * gate):
            labels[i] = label
            support += n
    return support
