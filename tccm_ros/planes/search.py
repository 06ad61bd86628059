"""The kernel of `find_planes`: all planes of a map, from the moments of its cuboids."""

import math
from typing import Any, NamedTuple

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int32
from tccm_ros.cuboids.cuboids import CuboidArrays
from tccm_ros.cuboids.inclination import CROSSES_CELLS_ONCE, FITTED_AS_VERTICAL
from tccm_ros.cuboids.linking import link_in_plane
from tccm_ros.cuboids.moments import plane_of, residuals_of
from tccm_ros.kernels import kernel
from tccm_ros.planes.arrays import PLANE, PlaneMap, PlaneTable, plane_map
from tccm_ros.planes.blocks import Blocks, find_patches, sort_into_blocks
from tccm_ros.planes.edge_planes import drop_edge_planes
from tccm_ros.planes.inliers import (
    GATE,
    Flood,
    Plane,
    assign_inliers,
    fit_horizontal,
    pooled_plane,
    sharing_cells,
)
from tccm_ros.planes.reassignment import reassign_inliers
from tccm_ros.planes.region_growing import grow_regions
from tccm_ros.planes.vertical_patches import link_vertical
from tccm_ros.planes.vertical_planes import fit_vertical
from tccm_ros.robust import UNIFORM_WIDTH

PATCH_POINTS = 6
"""Minimum number of points of a flat patch: three define a plane, three more test it. Chosen."""

MAX_VISITS = 200
"""Upper bound of the mean number of searches that examine a cuboid: the time of a search is
proportional to the cuboids, whatever is in a map. 2 to 12 in the tilt cycles of bags/flat and
bags/upside_down; more than 50 only in maps of thousands of small sheets at random.
"""


class PlaneLimits(NamedTuple):
    """Limits that a plane must meet.

    Attributes
    ----------
    max_rms
        Maximum standard deviation across it, m.
    min_points, min_area
        Minimum number of points, and minimum area, m2.
    flatness
        Maximum ratio of the standard deviations across and along the narrower side.
    horizontal
        Minimum vertical component of a horizontal plane's normal.
    """

    max_rms: float
    min_points: float
    min_area: float
    flatness: float
    horizontal: float


@kernel
def planes_of(
    arrays: tuple[Any, ...], caps: tuple[Int32, Float64], origin: Float64, view: Float64,
    limits: tuple[float, float, float, float, float],
) -> tuple[Int32, PlaneTable]:  # fmt: skip
    """Return all planes of a map: `segment` with plain tuples, in one compiled call.

    Parameters
    ----------
    arrays, caps
        The fields of `CuboidArrays` and `Caps`.
    origin
        float64 (3,), origin of the moments, ticks.
    view, limits
        As in `segment`.
    """
    cuboids = plane_map(CuboidArrays(*arrays), caps[0], caps[1], origin)
    return segment(cuboids, view, PlaneLimits(*limits))


@kernel
def segment(cuboids: PlaneMap, view: Float64, limits: PlaneLimits) -> tuple[Int32, PlaneTable]:
    """Return the label of each cuboid and all planes of a map.

    Parameters
    ----------
    cuboids
        Cuboids of the map, N > 0.
    view
        float64 (3,), position of the laser, m.
    limits
        Limits that a plane must meet.

    Returns
    -------
    labels : int32 (N,)
    planes : (P,), `PLANE`
        Normals of horizontal planes point up, others towards the laser.
    """
    n = len(cuboids.ix)
    blocks = sort_into_blocks(cuboids.ix, cuboids.iy)
    moments, patches, place = find_patches(cuboids, blocks, limits.max_rms, PATCH_POINTS)
    region, pooled = grow_regions(moments, patches, place, blocks, limits.max_rms)
    count = blocks.rows * blocks.wide
    labels = np.full(n, -1, np.int32)
    flood = Flood(
        np.empty(count, np.int32),
        np.full(count, -1, np.int32),
        np.zeros((n >> 6) + 1, np.uint64),
        np.zeros(1, np.int64),
    )
    planes = planes_of_regions(cuboids, blocks, region, pooled, place, flood, limits, labels)
    planes = reassign_inliers(cuboids.M, blocks, labels, planes, are_vertical(planes))
    planes = drop_edge_planes(cuboids, blocks, labels, planes, are_vertical(planes))
    for p in range(len(planes)):
        orient(planes[p], view, cuboids.origin * cuboids.tick, limits.horizontal)
    return labels, planes


@kernel
def planes_of_regions(
    cuboids: PlaneMap,
    blocks: Blocks,
    region: Int32,
    pooled: Float64,
    place: Int32,
    flood: Flood,
    limits: PlaneLimits,
    labels: Int32,
) -> PlaneTable:
    """Return the planes of regions, the largest first, until `MAX_VISITS` is used up.

    Parameters
    ----------
    cuboids, blocks
        The map and its blocks.
    region, pooled, place
        Results of `grow_regions` and `find_patches`.
    flood
        Work space, changed.
    limits
        Limits that a plane must meet.
    labels
        int32 (N,), -1, changed: the plane of each cuboid.
    """
    n = len(cuboids.ix)
    first, by_region = patches_by_region(region, len(pooled))
    planes = np.empty(n // 2 + 1, PLANE)
    found = 0
    for r in np.argsort(-pooled[:, 0]):
        # Regions miss sparse parts of a surface: a third of a plane's points is enough.
        if pooled[r, 0] < limits.min_points / 3.0 or flood.visits[0] > MAX_VISITS * n:
            break
        queued = queue_region(by_region[first[r] : first[r + 1]], place, blocks, flood, r)
        plane = pooled_plane(pooled[r])
        members = assign_inliers(cuboids.M, blocks, flood, queued, r, labels, plane, pooled[r, 0])
        if len(members) > 2:
            found = split_and_fit(cuboids, members, plane, limits, labels, planes, found)
    return planes[:found]


@kernel
def are_vertical(planes: PlaneTable) -> Bool:
    """Return which planes are fitted as vertical planes, bool (P,)."""
    return np.abs(planes["normal"][:, 2]) < FITTED_AS_VERTICAL


@kernel
def orient(row: Any, view: Float64, start: Float64, horizontal: float) -> None:
    """Orient a plane's normal up or towards the laser, and express its offset in the map's frame.

    Parameters
    ----------
    row
        `PLANE`, changed: its offset is relative to `start` before, to the map's origin after.
    view
        float64 (3,), position of the laser, m.
    start
        float64 (3,), origin of the moments, m.
    horizontal
        Minimum vertical component of a horizontal plane's normal.
    """
    nx, ny, nz, d = row.normal[0], row.normal[1], row.normal[2], row.offset
    height = nz
    row.is_horizontal = abs(nz) >= horizontal
    if abs(nz) < horizontal:
        height = nx * (view[0] - start[0]) + ny * (view[1] - start[1]) + nz * (view[2] - start[2])
        height -= d
    sign = math.copysign(1.0, height)
    d += nx * start[0] + ny * start[1] + nz * start[2]
    row.normal[0], row.normal[1], row.normal[2] = sign * nx, sign * ny, sign * nz
    row.offset = sign * d


@kernel
def patches_by_region(region: Int32, regions: int) -> tuple[Int32, Int32]:
    """Return the index of each region's first patch in the second array, and patches by region."""
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


@kernel
def queue_region(patches: Int32, place: Int32, blocks: Blocks, flood: Flood, mark: int) -> int:
    """Queue the blocks of a region's patches, with a margin of their width at higher levels.

    Parameters
    ----------
    patches
        int32, the patches of the region.
    place
        int32 (K, 3), result of `find_patches`.
    blocks
        Blocks of the map.
    flood, mark
        Work space, changed, and the number of the search.

    Returns
    -------
    int
        Number of blocks queued.
    """
    rows, wide, queue, stamp = blocks.rows, blocks.wide, flood.queue, flood.stamp
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


@kernel
def split_and_fit(
    cuboids: PlaneMap,
    members: Int32,
    plane: Plane,
    limits: PlaneLimits,
    labels: Int32,
    planes: PlaneTable,
    found: int,
) -> int:
    """Split a plane's cuboids into connected sets, fit and label each set; return the plane count.

    Parameters
    ----------
    cuboids, members
        The map, and the indices int32 (M,) of the plane's cuboids.
    plane
        Initial plane.
    limits
        Limits that a plane must meet.
    labels, planes
        int32 (N,) and (P,), changed: the found planes are written to them.
    found
        Number of planes before.

    Returns
    -------
    int
        Number of planes after.
    """
    M, ix, iy = cuboids.M, cuboids.ix, cuboids.iy
    n = len(members)
    is_vertical = abs(plane[2]) < FITTED_AS_VERTICAL
    if is_vertical:
        root = link_vertical(ix, iy, members, plane)
        deep = np.ones(n, np.bool_)
    else:
        root, deep = link_in_plane(ix[members], iy[members])
    support, size = sizes_of_sets(M, members, root)
    for k in range(n):
        if support[k] < limits.min_points:
            continue
        one, its_deep = take_set(members, deep, root, k, size[k])
        row = planes[found]
        if is_vertical:
            fitted = fit_vertical(cuboids, one, plane, row.moments)
        else:
            fitted = fit_horizontal(cuboids, one, its_deep, plane, row.moments)
        if is_plane(row, limits):
            if is_vertical:
                # The moments contain rims, which are no points of the plane.
                row.normal[0], row.normal[1], row.normal[2] = fitted[0], fitted[1], fitted[2]
                row.offset, row.variances[2] = fitted[3], fitted[4]
            row.support = label_members(cuboids, one, fitted, labels, found)
            found += 1
    return found


@kernel
def sizes_of_sets(M: Float64, members: Int32, root: Int32) -> tuple[Float64, Int32]:
    """Return the number of points and of cuboids of each set.

    Parameters
    ----------
    M
        float64 (N, 10), moments.
    members
        int32 (M,), indices of cuboids.
    root
        int32 (M,), the smallest index of each member's set.

    Returns
    -------
    support, size : float64 (M,), int32 (M,)
        At the smallest index of each set.
    """
    support, size = np.zeros(len(root)), np.zeros(len(root), np.int32)
    # Sums stay in registers while the set is the same.
    k = 0
    while k < len(root):
        r, first, points = root[k], k, 0.0
        while k < len(root) and root[k] == r:
            points += M[members[k], 0]
            k += 1
        support[r] += points
        size[r] += k - first
    return support, size


@kernel
def take_set(members: Int32, deep: Bool, root: Int32, k: int, size: int) -> tuple[Int32, Bool]:
    """Return the members of one set, and their values of `deep`.

    Parameters
    ----------
    members, deep, root
        int32 (M,), bool (M,) and int32 (M,), of all sets.
    k, size
        Smallest index of the set, and its number of members.
    """
    one, its_deep = np.empty(size, np.int32), np.empty(size, np.bool_)
    used = 0
    for j in range(k, len(members)):
        if root[j] == k:
            one[used], its_deep[used] = members[j], deep[j]
            used += 1
    return one, its_deep


@kernel
def is_plane(row: Any, limits: PlaneLimits) -> bool:
    """Compute a plane's row from its moments, and return whether it meets the limits."""
    if row.moments[0] < 0.5 * limits.min_points:
        return False
    nx, ny, nz, d, l1, l2, l3 = plane_of(row.moments)
    row.normal[0], row.normal[1], row.normal[2], row.offset = nx, ny, nz, d
    row.variances[0], row.variances[1], row.variances[2] = l1, l2, l3
    if l3 > min(limits.max_rms * limits.max_rms, limits.flatness * limits.flatness * l2):
        return False
    # The area of an evenly filled rectangle.
    return UNIFORM_WIDTH**2 * math.sqrt(l1 * l2) >= limits.min_area


@kernel
def label_members(
    cuboids: PlaneMap, members: Int32, plane: Plane, labels: Int32, label: int
) -> float:
    """Label the members within the gate of the final plane; return their number of points.

    Parameters
    ----------
    cuboids, members
        The map, and the indices int32 (M,) of the plane's cuboids.
    plane
        The fitted plane.
    labels, label
        int32 (N,), changed, and the number of the plane.

    Returns
    -------
    float
        Number of points of the labelled cuboids.
    """
    M, is_flat = cuboids.M, abs(plane[2]) > CROSSES_CELLS_ONCE
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
    # The scatter of a warped table is larger than that of the cuboids in the fit.
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
