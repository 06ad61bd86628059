"""Which cuboids belong to a plane, and which of them may shape its fit.

Belonging is generous: whatever is within the gate, so that the noise's tails are not cut off.
Shaping is careful: a cell at an edge mixes the surface with what is below or beside it.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tccm_ros.mapping.moments import plane_of, residuals_of

__all__ = ["Plane", "claim", "fit_lying", "fit_standing", "link_standing"]

Array = NDArray[np.float64]
Int = NDArray[np.int32]
Flags = NDArray[np.bool_]
Plane = tuple[float, float, float, float, float]
"""nx, ny, nz, offset, variance across."""

GATE = 4.0
"""A cuboid whose mean is within this many standard deviations of a plane belongs to it: one point
in 16,000 is further away, so that the noise's tails are not cut off and do not pull."""

NOISE_FLOOR = 0.00025
"""Least standard deviation for gates, m: ranges are quantised, tables are not perfect."""

LENIENT = 4.0
"""Deviations of the chi-square test for a cuboid deep inside a surface: hardly any is refused."""

STRICT = 2.0
"""The same near an edge, where mixed cells are to be expected."""


LAYER = 0.25
"""Height, m, of the places in which a standing plane is judged: what is above a drawer, and what is
below, may lie in different planes."""

WARP = 0.001
"""A place may be this far off its plane, m, beyond what noise explains: no board is flat."""


@njit(nogil=True, cache=True)
def is_mixed(n: float, second: float, variance: float, deviations: float) -> bool:
    """Tell whether points scatter more about a plane than its noise explains.

    The sum of squares of n normal distances is chi-square: mean n, variance 2 n; the last term
    allows a few points their tail. The test is even: it refuses both sides of the plane alike.
    """
    return second > variance * (n + deviations * (math.sqrt(2.0 * n) + deviations - 2.0))


@njit(nogil=True, cache=True)
def pooled_plane(total: Array) -> Plane:
    """Return the plane of a moment vector, with the noise floor."""
    nx, ny, nz, d, _, _, variance = plane_of(total)
    return nx, ny, nz, d, max(variance, NOISE_FLOOR * NOISE_FLOOR)


@njit(nogil=True, cache=True)
def claim(
    M: Array,
    start: Int,
    order: Int,
    rows: int,
    wide: int,
    queue: Int,
    queued: int,
    stamp: Int,
    mark: int,
    labels: Int,
    flags: Int,
    plane: Plane,
    weight: float,
) -> Int:
    """Flood from a region's blocks over all blocks that hold cuboids of its plane.

    Parameters
    ----------
    M
        float64 (N, 10), moments.
    start, order, rows, wide
        Of `sort_into_blocks`.
    queue, queued
        Blocks to begin with; work space for all blocks.
    stamp, mark
        Blocks queued before have ``stamp == mark``.
    labels
        int32 (N,): only cuboids with -1 are claimed.
    flags
        int32 (N,), work space.
    plane, weight
        Plane of the region, and its points.

    Returns
    -------
    int32 (M,): the cuboids, in order.
    """
    nx, ny, nz, d, variance = plane
    gate = GATE * math.sqrt(variance)
    total = np.zeros(10)
    refit_at = max(1.5 * weight, 30.0)
    low, high, count, first = len(M), -1, 0, 0
    while first < queued:
        b = queue[first]
        first += 1
        hit = False
        for k in range(start[b], start[b + 1]):
            i = order[k]
            if labels[i] >= 0:
                continue
            m = M[i]
            one, two = residuals_of(m, nx, ny, nz, d)
            if abs(one) > gate * m[0] or two > m[0] * gate * gate:
                continue
            hit = True
            flags[i] = mark
            low, high = min(low, i), max(high, i)
            count += 1
            if not is_mixed(m[0], two, variance, LENIENT):
                for c in range(10):
                    total[c] += m[c]
        if not hit:
            continue
        if total[0] > refit_at:
            nx, ny, nz, d, variance = pooled_plane(total)
            gate = GATE * math.sqrt(variance)
            refit_at = 1.5 * total[0]
        bx, by = b // wide, b % wide
        for x in range(max(bx - 1, 0), min(bx + 2, rows)):
            for y in range(max(by - 1, 0), min(by + 2, wide)):
                if stamp[x * wide + y] != mark:
                    stamp[x * wide + y] = mark
                    queue[queued] = x * wide + y
                    queued += 1
    members = np.empty(count, np.int32)
    used = 0
    for i in range(low, high + 1):
        if flags[i] == mark:
            members[used] = i
            used += 1
    return members


@njit(nogil=True, cache=True)
def fit_lying(M: Array, members: Int, deep: Flags, plane: Plane, total: Array) -> Plane:
    """Fit a plane whose cells lie side by side: first to its inside, then with its edges.

    Parameters
    ----------
    M, members
        Moments, and the cuboids of one connected set.
    deep
        bool (M,), of `is_deep`.
    plane
        A first guess.
    total
        float64 (10,), written: pooled moments of the fit.
    """
    inside, everything = np.zeros(10), 0.0
    for k in range(len(members)):
        m = M[members[k]]
        everything += m[0]
        if deep[k] and fits(m, plane, LENIENT):
            for c in range(10):
                inside[c] += m[c]
    # A small surface has no inside to speak of; then the first guess has to do.
    if inside[0] > max(20.0, 0.15 * everything):
        plane = pooled_plane(inside)
    total[:] = 0.0
    for k in range(len(members)):
        m = M[members[k]]
        if fits(m, plane, LENIENT if deep[k] else STRICT):
            for c in range(10):
                total[c] += m[c]
    return pooled_plane(total) if total[0] >= 3.0 else plane


@njit(nogil=True, cache=True)
def fits(m: Array, plane: Plane, deviations: float) -> bool:
    """Tell whether a cuboid's scatter about a plane is explained by its noise."""
    _, two = residuals_of(m, plane[0], plane[1], plane[2], plane[3])
    return not is_mixed(m[0], two, plane[4], deviations)


@njit(nogil=True, cache=True)
def bins_along(M: Array, members: Int, plane: Plane, cell: float) -> tuple[Int, int]:
    """Return each cuboid's cell along the level direction of a standing plane, and how many."""
    nx, ny = plane[0], plane[1]
    slope = math.hypot(nx, ny)
    along = np.empty(len(members))
    for k in range(len(members)):
        m = M[members[k]]
        along[k] = (nx * m[2] - ny * m[1]) / (m[0] * slope)
    low = along.min()
    result = np.empty(len(members), np.int32)
    for k in range(len(members)):
        result[k] = int((along[k] - low) / cell)
    return result, result.max() + 1


@njit(nogil=True, cache=True)
def link_standing(M: Array, members: Int, plane: Plane, cell: float) -> Int:
    """Return the connected sets of a standing plane's cuboids: runs along its level direction.

    As in `linking.link`, the smallest index of each set; a gap of twice the usual step ends a run.
    """
    place, bins = bins_along(M, members, plane, cell)
    run = np.full(bins, -1, np.int32)
    for k in range(len(place)):
        run[place[k]] = 0
    steps, count, last = 0, 0, -1
    for b in range(bins):
        if run[b] == 0:
            if last >= 0:
                steps += min(b - last, 8)
                count += 1
            last = b
    limit = max(2.0 * steps / max(count, 1), 2.5)
    runs, last = 0, 0
    for b in range(bins):
        if run[b] == 0:
            runs += b - last >= limit
            run[b] = runs
            last = b
    first = np.full(runs + 1, -1, np.int32)
    root = np.empty(len(place), np.int32)
    for k in range(len(place)):
        r = run[place[k]]
        if first[r] < 0:
            first[r] = k
        root[k] = first[r]
    return root


@njit(nogil=True, cache=True)
def fit_standing(M: Array, members: Int, plane: Plane, cell: float, total: Array) -> Plane:
    """Fit a standing plane, whose noise is cut by the cells' walls.

    The points of one place along the plane fall in two cells, before and behind the wall between
    them. To refuse one cell and keep the other would shift the plane, so places are judged whole,
    and so are layers: a drawer's back may lie 10 mm behind the front above it.
    """
    low = np.inf
    for i in members:
        low = min(low, M[i, 3] / M[i, 0])
    place, bins = bins_along(M, members, plane, cell)
    layers = 1
    for k in range(len(members)):
        layer = int((M[members[k], 3] / M[members[k], 0] - low) / LAYER)
        layers = max(layers, layer + 1)
        place[k] += layer * bins
    pooled = np.zeros((layers * bins, 10))
    everything = np.zeros(10)
    for k in range(len(members)):
        m, into = M[members[k]], pooled[place[k]]
        for c in range(10):
            into[c] += m[c]
            everything[c] += m[c]
    for _ in range(3):
        choose_places(pooled, layers, plane, total)
        if total[0] < 0.5 * everything[0]:
            # Every place is mixed, as where a shelf's top meets its front all along.
            total[:] = everything
        plane = pooled_plane(total)
    return plane


@njit(nogil=True, cache=True)
def choose_places(pooled: Array, layers: int, plane: Plane, total: Array) -> None:
    """Add up the moments of the places that a plane explains: (layers * bins, 10) into (10,)."""
    nx, ny, nz, d, noise = plane
    bins = len(pooled) // layers
    sums = np.empty((bins, 2))
    total[:] = 0.0
    for layer in range(layers):
        n, one, two = 0.0, 0.0, 0.0
        for b in range(bins):
            m = pooled[layer * bins + b]
            if m[0] == 0.0:
                continue
            sums[b, 0], sums[b, 1] = residuals_of(m, nx, ny, nz, d)
            n += m[0]
            one += sums[b, 0]
            two += sums[b, 1]
        if n == 0.0 or is_shifted(n, one, noise):
            continue
        # The noise across the plane depends on the beams' incidence, so on the height.
        variance = max(noise, two / n)
        for b in range(bins):
            m = pooled[layer * bins + b]
            if m[0] == 0.0 or is_shifted(m[0], sums[b, 0], variance):
                continue
            if not is_mixed(m[0], sums[b, 1], variance, STRICT):
                for c in range(10):
                    total[c] += m[c]


@njit(nogil=True, cache=True)
def is_shifted(n: float, first: float, variance: float) -> bool:
    """Tell whether points lie further off a plane, on the mean, than noise and warp explain."""
    return abs(first) > 3.0 * math.sqrt(n * variance) + n * WARP
