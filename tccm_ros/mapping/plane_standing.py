"""Standing planes: boards and walls, whose cells form a line and whose noise the cells' walls cut.

The points of one spot on a board fall in two cells, before and behind the wall between them. To
refuse one cell and keep the other would shift the plane, so *places* are judged whole: the cuboids
of one step along the board that overlap in height.

Where a board ends in a level surface, as a shelf's front in its top, the highest place of a step
is a *rim*: it may hold points of that surface, all at the rim's height, up to a cell behind the
board. A part map knows the moments of its cuboids' caps, and a rim's are taken off. An integration
map does not; there moments cannot tell which points they are, but they can be weighed by their
depth below the rim: the sum of (z_rim - z) e, with e the distance from the plane, knows nothing of
what lies at z_rim. So a rim gives this one equation instead of its mean, with three quarters of the
information.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tccm_ros.mapping.caps import CAP_DEPTH
from tccm_ros.mapping.moments import residuals_of
from tccm_ros.mapping.plane_members import NOISE_FLOOR, Plane, is_mixed

__all__ = ["NO_RIM", "bins_along", "fit_standing", "link_standing", "pool_places", "rim_moments"]

Array = NDArray[np.float64]
Int = NDArray[np.int32]

LAYER = 0.25
"""Height, m, of the layers in which noise is estimated, as it depends on the beams' incidence, and
which are refused whole: a drawer's back may lie 10 mm behind the front above it."""

WARP = 0.001
"""A place may be this far off its plane, m, beyond what noise explains: no board is flat."""

DEVIATIONS = 3.0
"""Of the tests for a place: shifted off the plane, or of more scatter than noise explains."""

PRIOR = 20.0
"""Points that the noise of the whole plane counts for in the noise of a layer."""

RIM_REACH = 40
"""A highest place is a rim unless it ends this far, ticks, below the usual height: a level surface
reaches its own height in each cell that it is in."""

NO_RIM = -(1 << 31)

ROUNDS = 3

LEAST_POINTS = 10.0
"""With fewer points left after the tests the guess has to do."""

LEAST_DEPTH = 0.01
"""A rim of less rms depth, m, is one scan line, and says nothing."""

SINGULAR = 1e-9


@njit(nogil=True, cache=True)
def bins_along(ix: Int, iy: Int, members: Int, plane: Plane) -> tuple[Int, int]:
    """Return the step of each cuboid along the level direction of a standing plane, and how many.

    A step is as wide as a cell. Cells count by their middle, so that noise does not decide.
    """
    slope = math.hypot(plane[0], plane[1])
    ux, uy = -plane[1] / slope, plane[0] / slope
    along = np.empty(len(members))
    low = np.inf
    for k in range(len(members)):
        along[k] = ux * ix[members[k]] + uy * iy[members[k]]
        low = min(low, along[k])
    bins = np.empty(len(members), np.int32)
    count = 0
    for k in range(len(members)):
        bins[k] = int(along[k] - low + 0.5)
        count = max(count, bins[k] + 1)
    return bins, count


@njit(nogil=True, cache=True)
def link_standing(ix: Int, iy: Int, members: Int, plane: Plane) -> Int:
    """Return the connected sets of a standing plane's cuboids: runs along its level direction.

    As in `linking.link`, the smallest index of each set; a gap of twice the usual step ends a run.
    """
    place, bins = bins_along(ix, iy, members, plane)
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
def pool_places(
    M: Array,
    ix: Int,
    iy: Int,
    bottom: Int,
    top: Int,
    cap_of: Int,
    caps: Array,
    members: Int,
    plane: Plane,
) -> tuple[Array, Int]:
    """Pool the cuboids of each step along a standing plane that overlap in height.

    Where caps are known those of rims are left out, and no rim remains.

    Parameters
    ----------
    M, ix, iy, bottom, top
        Moments, cells and heights of the map's cuboids.
    cap_of, caps
        Row of each cuboid's cap, and the caps' moments, see `Caps`; of length 0 if not known.
    members, plane
        The plane's cuboids, and the plane.

    Returns
    -------
    pooled : float64 (P, 10)
        Moments of the places, by step and rising.
    rim : int32 (P,)
        Top of a rim, ticks; `NO_RIM` for the other places.
    """
    order, start = sort_into_steps(ix, iy, bottom, members, plane)
    pooled = np.zeros((len(members), 10))
    rim = np.full(len(members), NO_RIM, np.int32)
    tops = np.empty(len(start) - 1)
    begins = np.empty(len(members) + 1, np.int32)
    places, steps = 0, 0
    for b in range(len(start) - 1):
        if start[b] == start[b + 1]:
            continue
        high = NO_RIM
        for j in range(start[b], start[b + 1]):
            i = order[j]
            if high < bottom[i]:
                begins[places] = j
                places += 1
            high = max(high, top[i])
            m, into = M[i], pooled[places - 1]
            for c in range(10):
                into[c] += m[c]
        rim[places - 1] = high
        tops[steps] = high
        steps += 1
    begins[places] = len(members)
    least = np.median(tops[:steps]) - RIM_REACH
    for p in range(places):
        if rim[p] < least:
            rim[p] = NO_RIM
    if len(cap_of) == 0:
        return pooled[:places], rim[:places]
    kept = 0
    for p in range(places):
        if rim[p] != NO_RIM:
            for i in order[begins[p] : begins[p + 1]]:
                if top[i] >= rim[p] - CAP_DEPTH:
                    pooled[p] -= M[i] if cap_of[i] < 0 else caps[cap_of[i]]
            if pooled[p, 0] < 0.5:
                continue
        pooled[kept] = pooled[p]
        kept += 1
    return pooled[:kept], np.full(kept, NO_RIM, np.int32)


@njit(nogil=True, cache=True)
def sort_into_steps(ix: Int, iy: Int, bottom: Int, members: Int, plane: Plane) -> tuple[Int, Int]:
    """Return a standing plane's cuboids by step and rising, and where each step begins in them."""
    bins, count = bins_along(ix, iy, members, plane)
    start = np.zeros(count + 1, np.int32)
    for b in bins:
        start[b + 1] += 1
    for b in range(count):
        start[b + 1] += start[b]
    fill = start.copy()
    order = np.empty(len(members), np.int32)
    for k in range(len(members)):
        i, b = members[k], bins[k]
        j = fill[b]
        fill[b] += 1
        while j > start[b] and bottom[order[j - 1]] > bottom[i]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = i
    return order, start


@njit(nogil=True, cache=True)
def fit_standing(
    M: Array,
    ix: Int,
    iy: Int,
    bottom: Int,
    top: Int,
    cap_of: Int,
    caps: Array,
    members: Int,
    plane: Plane,
    tick: float,
    ground: float,
    total: Array,
) -> Plane:
    """Fit a standing plane by weighted least squares over its places.

    Parameters
    ----------
    M, ix, iy, bottom, top, cap_of, caps, members
        As in `pool_places`; the cuboids of one connected set.
    plane
        A first guess.
    tick, ground
        A tick, and the height of the moments' origin, m.
    total
        float64 (10,), written: pooled moments of the places that shaped the fit; a rim counts for
        as many points as its equation is worth.
    """
    pooled, rim = pool_places(M, ix, iy, bottom, top, cap_of, caps, members, plane)
    low = np.inf
    for p in range(len(pooled)):
        low = min(low, pooled[p, 3] / pooled[p, 0])
    layer = np.empty(len(pooled), np.int32)
    for p in range(len(pooled)):
        layer[p] = int((pooled[p, 3] / pooled[p, 0] - low) / LAYER)
    plane = through_median(pooled, plane)
    for _ in range(ROUNDS):
        plane = improve(pooled, rim, layer, plane, tick, ground, total)
    return plane


@njit(nogil=True, cache=True)
def through_median(pooled: Array, plane: Plane) -> Plane:
    """Shift a plane to the median place, by points.

    A guess through all members lies between a board and what stands a centimetre behind its foot;
    tested against it, the board itself could be refused.
    """
    nx, ny, nz, d, noise = plane
    off = np.empty(len(pooled))
    for p in range(len(pooled)):
        off[p] = residuals_of(pooled[p], nx, ny, nz, d)[0] / pooled[p, 0]
    half = 0.5 * pooled[:, 0].sum()
    for p in np.argsort(off):
        half -= pooled[p, 0]
        if half <= 0.0:
            return nx, ny, nz, d + off[p], noise
    return plane


@njit(nogil=True, cache=True)
def improve(
    pooled: Array, rim: Int, layer: Int, plane: Plane, tick: float, ground: float, total: Array
) -> Plane:
    """Refit a standing plane to the places that it explains; `total` is written."""
    nx, ny, nz, d, noise = plane
    slope = math.hypot(nx, ny)
    ux, uy = -ny / slope, nx / slope
    # Per layer: points and squares of all places, then points and sum of those that are no rims.
    layers = np.zeros((layer.max() + 1, 4))
    sums = np.empty((len(pooled), 2))
    for p in range(len(pooled)):
        n = pooled[p, 0]
        sums[p, 0], sums[p, 1] = residuals_of(pooled[p], nx, ny, nz, d)
        into = layers[layer[p]]
        into[0] += n
        into[1] += sums[p, 1]
        if rim[p] == NO_RIM:
            into[2] += n
            into[3] += sums[p, 0]
    equations = np.zeros((3, 4))
    total[:] = 0.0
    squares, points = 0.0, 0.0
    for p in range(len(pooled)):
        m = pooled[p]
        every, two, rest, one = layers[layer[p]]
        usual = (two + PRIOR * noise) / (every + PRIOR)
        lenient, share = max(noise, usual), 1.0
        if rim[p] == NO_RIM:
            if is_shifted(rest, rest, one, noise):
                continue
            if is_shifted(m[0], m[0], sums[p, 0], lenient):
                continue
            if is_mixed(m[0], sums[p, 1], lenient, DEVIATIONS):
                continue
            add_place(equations, m, plane, ux, uy, 1.0 / usual)
            squares += sums[p, 1]
            points += m[0]
        else:
            w, ws, wz, we, w2 = rim_moments(m, plane, ux, uy, rim[p] * tick - ground)
            if w2 <= LEAST_DEPTH * LEAST_DEPTH * m[0] or is_shifted(w2, w, we, lenient):
                continue
            k = 1.0 / (usual * w2)
            add(equations, k, w * w, w * ws, w * wz, ws * ws, ws * wz, wz * wz)
            add_right(equations, k, w * we, ws * we, wz * we)
            share = w * w / (w2 * m[0])
        for c in range(10):
            total[c] += share * m[c]
    if total[0] < LEAST_POINTS:
        return plane
    a, b, g = solve(equations)
    # What was e = n p - d is now e - a - b s - g z.
    nx, ny, nz, d = nx - b * ux, ny - b * uy, nz - g, d + a
    k = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    if points > 0.0:
        noise = max(squares / points, NOISE_FLOOR * NOISE_FLOOR)
    return nx * k, ny * k, nz * k, d * k, noise


@njit(nogil=True, cache=True)
def is_shifted(spread: float, weight: float, first: float, variance: float) -> bool:
    """Tell whether a weighted sum of distances is more than noise and warp explain.

    `spread` is the sum of the weights' squares, `weight` that of the weights.
    """
    return abs(first) > DEVIATIONS * math.sqrt(spread * variance) + weight * WARP


@njit(nogil=True, cache=True)
def rim_moments(
    m: Array, plane: Plane, ux: float, uy: float, z_rim: float
) -> tuple[float, float, float, float, float]:
    """Return the sums of w, w s, w z, w e and w w over a place's points, for w = z_rim - z.

    Here s is the distance along (ux, uy), z the height and e the distance from the plane.
    """
    nx, ny, nz, d, _ = plane
    s, sz = ux * m[1] + uy * m[2], ux * m[6] + uy * m[8]
    e = nx * m[1] + ny * m[2] + nz * m[3] - d * m[0]
    ez = nx * m[6] + ny * m[8] + nz * m[9] - d * m[3]
    return (
        z_rim * m[0] - m[3],
        z_rim * s - sz,
        z_rim * m[3] - m[9],
        z_rim * e - ez,
        z_rim * (z_rim * m[0] - 2.0 * m[3]) + m[9],
    )


@njit(nogil=True, cache=True)
def add_place(N: Array, m: Array, plane: Plane, ux: float, uy: float, k: float) -> None:
    """Add a place's points to the normal equations of ``e = a + b s + g z``, with weight k."""
    nx, ny, nz, d, _ = plane
    s, sx, sy = ux * m[1] + uy * m[2], ux * m[4] + uy * m[5], ux * m[5] + uy * m[7]
    sz = ux * m[6] + uy * m[8]
    add(N, k, m[0], s, m[3], ux * sx + uy * sy, sz, m[9])
    add_right(
        N, k,
        nx * m[1] + ny * m[2] + nz * m[3] - d * m[0],
        nx * sx + ny * sy + nz * sz - d * s,
        nx * m[6] + ny * m[8] + nz * m[9] - d * m[3],
    )  # fmt: skip


@njit(nogil=True, cache=True)
def add(
    N: Array, k: float, aa: float, ab: float, ag: float, bb: float, bg: float, gg: float
) -> None:
    """Add to the left side of normal equations for (a, b, g), float64 (3, 4), upper triangle."""
    N[0, 0] += k * aa
    N[0, 1] += k * ab
    N[0, 2] += k * ag
    N[1, 1] += k * bb
    N[1, 2] += k * bg
    N[2, 2] += k * gg


@njit(nogil=True, cache=True)
def add_right(N: Array, k: float, a: float, b: float, g: float) -> None:
    """Add to the right side of normal equations."""
    N[0, 3] += k * a
    N[1, 3] += k * b
    N[2, 3] += k * g


@njit(nogil=True, cache=True)
def solve(N: Array) -> tuple[float, float, float]:
    """Return the solution (a, b, g) of normal equations; b = g = 0 where they do not tell."""
    b, g = N[0, 1] / N[0, 0], N[0, 2] / N[0, 0]
    bb, bg, gg = N[1, 1] - b * N[0, 1], N[1, 2] - b * N[0, 2], N[2, 2] - g * N[0, 2]
    right_b, right_g = N[1, 3] - b * N[0, 3], N[2, 3] - g * N[0, 3]
    det = bb * gg - bg * bg
    if det <= SINGULAR * bb * gg:
        return N[0, 3] / N[0, 0], 0.0, 0.0
    b, g = (right_b * gg - right_g * bg) / det, (bb * right_g - bg * right_b) / det
    return (N[0, 3] - N[0, 1] * b - N[0, 2] * g) / N[0, 0], b, g
