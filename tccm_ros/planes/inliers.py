"""Assignment of cuboids to planes, and the fit of planes that are not vertical.

All cuboids within a gate are inliers, so that the tails of the noise are not cut off. The fit uses
fewer of them: a cell at an edge holds points of the surface and of others below or beside it.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tccm_ros.arrays import Bool, Float64, Int32, Int64
from tccm_ros.cuboids.inclination import CROSSES_CELLS_ONCE
from tccm_ros.cuboids.intrinsics import lowest_bit
from tccm_ros.cuboids.moments import Moments, plane_of, residuals_of
from tccm_ros.kernels import kernel
from tccm_ros.planes.arrays import PlaneMap
from tccm_ros.planes.blocks import Blocks, queue_around

Words = NDArray[np.uint64]
Plane = tuple[float, float, float, float, float]
"""nx, ny, nz, offset, variance across."""

NOTHING = (0.0,) * 10
"""Moments of no points."""

GATE = 4.0
"""Maximum distance of an inlier from its plane, in standard deviations, and deviations of the
chi-square test for a cuboid deep inside a surface. Chosen: one point in 16,000 is further away, so
that the tails of the noise are not cut off and do not bias the fit."""

NOISE_FLOOR = 0.00025
"""Minimum standard deviation for gates, m: ranges are quantised, tables are not flat. Chosen."""

STRICT = 2.0
"""Deviations of the chi-square test near an edge, where mixed cells are expected. Chosen."""

ROUNDS = 3
"""Maximum number of refits. Chosen."""

REFIT_GROWTH = 1.5
"""Growth of a plane's points at which it is refitted. Chosen: far fewer fits than cuboids."""

MIN_INSIDE = 20.0
"""Minimum number of points for a fit of a surface's inside, and for a refit of any plane. Chosen.
"""


INSIDE_FRACTION = 0.15
"""Minimum fraction of a surface's points in its inside for a fit of its own. Without it,
kitchen_corner has two more planes, and one more surface, which nobody measured."""


@kernel
def max_scatter(n: float, deviations: float) -> float:
    """Return the maximum sum of n squared distances due to noise, in variances.

    The sum of n squares is chi-square distributed: mean n, variance 2 n. The last term allows for
    the tail of few points. `deviations` is at least 2.
    """
    return n + deviations * (math.sqrt(2.0 * n) + deviations - 2.0)


@kernel
def is_mixed(n: float, second: float, variance: float, deviations: float) -> bool:
    """Return whether the scatter of points about a plane is more than its noise.

    The test is symmetric: it treats both sides of the plane alike.

    Parameters
    ----------
    n, second
        Number of points, and the sum of their squared distances from the plane, m2.
    variance
        Variance of the noise across the plane, m2.
    deviations
        As in `max_scatter`.
    """
    return second > variance * max_scatter(n, deviations)


@kernel
def pooled_plane(total: Float64 | Moments) -> Plane:
    """Return the plane of a moment vector, with the noise floor."""
    nx, ny, nz, d, _, _, variance = plane_of(total)
    return nx, ny, nz, d, max(variance, NOISE_FLOOR * NOISE_FLOOR)


@kernel
def add_scaled(total: Moments, m: Float64, weight: float) -> Moments:
    """Return ``total + weight * m`` as a tuple, so that it stays in registers.

    Parameters
    ----------
    total, m
        Moments of points.
    weight
        Weight of `m`.
    """
    return (
        total[0] + weight * m[0], total[1] + weight * m[1], total[2] + weight * m[2],
        total[3] + weight * m[3], total[4] + weight * m[4], total[5] + weight * m[5],
        total[6] + weight * m[6], total[7] + weight * m[7], total[8] + weight * m[8],
        total[9] + weight * m[9],
    )  # fmt: skip


@kernel
def squares_about(plane: Plane) -> Moments:
    """Return the weights with which moments add to the sum of squared distances from a plane."""
    nx, ny, nz, d, _ = plane
    return (
        d * d, -2.0 * d * nx, -2.0 * d * ny, -2.0 * d * nz,
        nx * nx, 2.0 * nx * ny, 2.0 * nx * nz, ny * ny, 2.0 * ny * nz, nz * nz,
    )  # fmt: skip


@kernel
def dot(weights: Moments, m: Float64) -> float:
    """Return the weighted sum of moments."""
    return (
        (weights[0] * m[0] + weights[1] * m[1] + weights[2] * m[2])
        + (weights[3] * m[3] + weights[4] * m[4] + weights[5] * m[5])
        + (weights[6] * m[6] + weights[7] * m[7] + weights[8] * m[8] + weights[9] * m[9])
    )


class Flood(NamedTuple):
    """Work space of a flood fill over blocks.

    Attributes
    ----------
    queue
        int32 (blocks,), blocks to visit.
    stamp
        int32 (blocks,), mark of the last search that queued each block.
    is_inlier
        uint64, a bit for each cuboid; zero before and after a search.
    visits
        int64 (1,), number of cuboids examined by all searches.
    """

    queue: Int32
    stamp: Int32
    is_inlier: Words
    visits: Int64


@kernel
def assign_inliers(
    M: Float64, blocks: Blocks, flood: Flood, queued: int, mark: int, labels: Int32, plane: Plane,
    weight: float,
) -> Int32:  # fmt: skip
    """Return the inliers of a region's plane, by a flood fill from its blocks.

    Parameters
    ----------
    M
        float64 (N, 10), moments.
    blocks
        Blocks of the map.
    flood, queued, mark
        Work space, changed, in which the first `queued` blocks are queued and stamped with `mark`.
    labels
        int32 (N,): only cuboids with -1 are assigned.
    plane, weight
        Plane of the region, and its number of points.

    Returns
    -------
    int32 (M,), indices of the cuboids, rising.
    """
    queue, start, order = flood.queue, blocks.start, blocks.order
    nx, ny, nz, d, variance = plane
    gate = GATE * math.sqrt(variance)
    total = NOTHING
    refit_at = max(REFIT_GROWTH * weight, MIN_INSIDE)
    count, first = 0, 0
    while first < queued:
        b = queue[first]
        first += 1
        before = count
        flood.visits[0] += start[b + 1] - start[b]
        for k in range(start[b], start[b + 1]):
            i = order[k]
            m = M[i]
            # The cheaper test of the mean rejects most cuboids.
            one = abs(nx * m[1] + ny * m[2] + nz * m[3] - m[0] * d)
            if (one > gate * m[0]) | (labels[i] >= 0):
                continue
            _, two = residuals_of(m, nx, ny, nz, d)
            if two > m[0] * gate * gate:
                continue
            flood.is_inlier[i >> 6] |= np.uint64(1) << np.uint64(i & 63)
            count += 1
            total = add_scaled(total, m, 1.0 - is_mixed(m[0], two, variance, GATE))
        if count == before:
            continue
        if total[0] > refit_at:
            nx, ny, nz, d, variance = pooled_plane(total)
            gate = GATE * math.sqrt(variance)
            refit_at = REFIT_GROWTH * total[0]
        queued = queue_around(b, mark, blocks, queue, queued, flood.stamp)
    return drain(flood.is_inlier, count)


@kernel
def drain(is_set: Words, count: int) -> Int32:
    """Return the indices of the `count` set bits, rising, and clear them."""
    members = np.empty(count, np.int32)
    used = 0
    for k in range(len(is_set)):
        word = is_set[k]
        is_set[k] = 0
        while word != 0:
            members[used] = 64 * k + lowest_bit(word)
            used += 1
            word &= word - np.uint64(1)
    return members


@kernel
def sharing_cells(ix: Int32, iy: Int32, members: Int32) -> Bool:
    """Return which members have another member in their cell.

    Parameters
    ----------
    ix, iy
        int32 (N,), cells of the map's cuboids.
    members
        int32 (M,), indices of cuboids, sorted by cell.

    Returns
    -------
    bool (M,)
    """
    is_sharing = np.zeros(len(members), np.bool_)
    for k in range(1, len(members)):
        i, j = members[k], members[k - 1]
        same = (ix[i] == ix[j]) & (iy[i] == iy[j])
        is_sharing[k] = same
        is_sharing[k - 1] |= same
    return is_sharing


@kernel
def fit_horizontal(
    cuboids: PlaneMap, members: Int32, deep: Bool, plane: Plane, total: Float64
) -> Plane:
    """Return the fit of a plane that is not vertical, so that its cells lie side by side.

    It is fitted first to its inside, then with its edges. A plane that rises by less than a cell
    over a cell passes each cell once. If several cuboids of one cell are within the gate, as at the
    front below a small top, the fit uses none of them.

    Parameters
    ----------
    cuboids, members
        The map, and the indices int32 (M,) of its cuboids in one connected set.
    deep
        bool (M,), which members are deep inside the surface.
    plane
        Initial plane.
    total
        float64 (10,), written: pooled moments of the fit.
    """
    n, M = len(members), cuboids.M
    is_flat = abs(plane[2]) > CROSSES_CELLS_ONCE
    is_sharing = sharing_cells(cuboids.ix, cuboids.iy, members)
    # The maximum scatter of a cuboid's points, in variances, does not depend on the plane.
    max_scatters = np.empty(n)
    inside, everything = NOTHING, 0.0
    squares = squares_about(plane)
    for k in range(n):
        m = M[members[k]]
        everything += m[0]
        max_scatters[k] = max_scatter(m[0], GATE if deep[k] else STRICT)
        if is_flat & is_sharing[k]:
            max_scatters[k] = -1.0
        takes = deep[k] & (dot(squares, m) <= plane[4] * max_scatters[k])
        inside = add_scaled(inside, m, 1.0 * takes)
    # The inside of a small surface is too small for a fit; then the initial plane is kept.
    if inside[0] > max(MIN_INSIDE, INSIDE_FRACTION * everything):
        plane = pooled_plane(inside)
    # A tilted initial plane rejects much of the surface; a fit to the rest is a better start.
    for _ in range(ROUNDS):
        pooled = NOTHING
        squares = squares_about(plane)
        for k in range(n):
            m = M[members[k]]
            pooled = add_scaled(pooled, m, 1.0 * (dot(squares, m) <= plane[4] * max_scatters[k]))
        for c in range(10):
            total[c] = pooled[c]
        if pooled[0] < 3.0:
            return plane
        plane = pooled_plane(pooled)
    return plane
