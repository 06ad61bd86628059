"""Standing planes: boards and walls, whose cells form a line and whose noise the cells' walls cut.

They are fitted by weighted least squares over their places (`planes.places`), each of which is
accepted or refused whole: for its own mean and scatter, and as part of its layer.

Where the caps of rims are not known, moments cannot tell which points of a rim are the board's, but
they can be weighed by their depth below it: the sum of (z_rim - z) e, with e the distance from the
plane, knows nothing of what lies at z_rim. So a rim gives this one equation instead of its mean,
with three quarters of the information (`plane_equations.rim_moments`).
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tccm_ros.cuboids.moments import residuals_of
from tccm_ros.planes.equations import add_place, add_rim, rim_moments, solve
from tccm_ros.planes.inliers import NOISE_FLOOR, Plane, is_mixed
from tccm_ros.planes.plane_map import PlaneMap
from tccm_ros.planes.vertical_patches import NO_RIM, pool_places

__all__ = ["fit_standing"]

Array = NDArray[np.float64]
Int = NDArray[np.int32]
Flags = NDArray[np.bool_]

LAYER = 0.25
"""Height, m, of the layers in which noise is estimated, as it depends on the beams' incidence, and
which are refused whole: a drawer's back may lie 10 mm behind the front above it."""

WARP = 0.001
"""A place may be this far off its plane, m, beyond what noise explains: no board is flat."""

DEVIATIONS = 3.0
"""Of the tests for a place: shifted off the plane, or of more scatter than noise explains."""

PRIOR = 20.0
"""Points that the noise of the whole plane counts for in the noise of a layer."""

ROUNDS = 3
SETTLED = 0.9
"""A round that takes what the last one took is the last, unless it finds this much less variance:
then the next one may refuse more."""

SLICES = 256
"""Slices of the places' distances in which their median is looked for."""

LEAST_POINTS = 10.0
"""With fewer points left after the tests the guess has to do."""

LEAST_DEPTH = 0.01
"""A rim of less rms depth, m, is one scan line, and says nothing."""


@njit(nogil=True, cache=True)
def fit_standing(cuboids: PlaneMap, members: Int, plane: Plane, total: Array) -> Plane:
    """Fit a standing plane by weighted least squares over its places.

    Parameters
    ----------
    cuboids, members
        The map, and its cuboids in one connected set.
    plane
        A first guess.
    total
        float64 (10,), written: pooled moments of the places that shaped the fit; a rim counts for
        as many points as its equation is worth.
    """
    pooled, rim = pool_places(cuboids, members, plane)
    total[:] = 0.0
    if len(pooled) == 0:
        return plane
    low = np.inf
    for p in range(len(pooled)):
        low = min(low, pooled[p, 3] / pooled[p, 0])
    layer = np.empty(len(pooled), np.int32)
    for p in range(len(pooled)):
        layer[p] = int((pooled[p, 3] / pooled[p, 0] - low) / LAYER)
    plane = through_median(pooled, plane)
    ground = cuboids.origin[2] * cuboids.tick
    is_taken = np.zeros(len(pooled), np.bool_)
    taken = np.zeros((layer.max() + 1, 10))
    for _ in range(ROUNDS):
        before = plane[4]
        plane, changes = improve(
            pooled, rim, layer, plane, cuboids.tick, ground, is_taken, taken, total
        )
        if changes == 0 and plane[4] > SETTLED * before:
            break
    return plane


@njit(nogil=True, cache=True)
def through_median(pooled: Array, plane: Plane) -> Plane:
    """Shift a plane to the median place, by points.

    A guess through all members lies between a board and what stands a centimetre behind its foot;
    tested against it, the board itself could be refused.
    """
    nx, ny, nz, d, noise = plane
    off = np.empty(len(pooled))
    low, high, half = np.inf, -np.inf, 0.0
    for p in range(len(pooled)):
        m = pooled[p]
        off[p] = (nx * m[1] + ny * m[2] + nz * m[3]) / m[0] - d
        low, high = min(low, off[p]), max(high, off[p])
        half += 0.5 * m[0]
    # A guess needs no sorting: the middle of the slice in which the median is.
    slices = np.zeros(SLICES + 1)
    width = max((high - low) / SLICES, 1e-12)
    for p in range(len(pooled)):
        slices[int((off[p] - low) / width)] += pooled[p, 0]
    k = 0
    while k < SLICES and half > slices[k]:
        half -= slices[k]
        k += 1
    return nx, ny, nz, d + low + (k + 0.5) * width, noise


@njit(nogil=True, cache=True)
def improve(
    pooled: Array,
    rim: Int,
    layer: Int,
    plane: Plane,
    tick: float,
    ground: float,
    is_taken: Flags,
    taken: Array,
    total: Array,
) -> tuple[Plane, int]:
    """Refit a standing plane to the places that it explains.

    Parameters
    ----------
    pooled, rim
        Of `pool_places`.
    layer
        int32 (P,), of each place.
    plane, tick, ground
        The last one, a tick, and the height of the moments' origin, m.
    is_taken, taken
        bool (P,) and float64 (L, 10), changed: the places that the last round took, and their
        moments by layer.
    total
        float64 (10,), written.

    Returns
    -------
    The plane, and how many places are taken or left other than in the last round.
    """
    nx, ny, nz, d, noise = plane
    slope = math.hypot(nx, ny)
    ux, uy = -ny / slope, nx / slope
    # Per layer: points and squares of all places, then points and sum of those that are no rims.
    layers = np.zeros((len(taken), 4))
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
    usual, is_refused = np.empty(len(layers)), np.empty(len(layers), np.bool_)
    for j in range(len(layers)):
        every, two, rest, one = layers[j]
        usual[j] = (two + PRIOR * noise) / (every + PRIOR)
        is_refused[j] = is_shifted(rest, rest, one, noise)
    equations = np.zeros((3, 4))
    total[:] = 0.0
    # The places of a layer have one weight: their moments are added up, and make one equation.
    squares, changes = 0.0, 0
    for p in range(len(pooled)):
        n, j = pooled[p, 0], layer[p]
        lenient = max(noise, usual[j])
        if rim[p] == NO_RIM:
            takes = not (
                is_refused[j]
                or is_shifted(n, n, sums[p, 0], lenient)
                or is_mixed(n, sums[p, 1], lenient, DEVIATIONS)
            )
            squares += sums[p, 1] * takes
            if takes != is_taken[p]:
                is_taken[p] = takes
                changes += 1
                sign = 1.0 if takes else -1.0
                for c in range(10):
                    taken[j, c] += sign * pooled[p, c]
        else:
            m = pooled[p]
            sides = rim_moments(m, plane, ux, uy, rim[p] * tick - ground)
            w, _, _, we, w2 = sides
            if w2 <= LEAST_DEPTH * LEAST_DEPTH * m[0] or is_shifted(w2, w, we, lenient):
                continue
            add_rim(equations, sides, 1.0 / usual[j])
            share = w * w / (w2 * m[0])
            for c in range(10):
                total[c] += share * m[c]
    points = 0.0
    for j in range(len(layers)):
        add_place(equations, taken[j], plane, ux, uy, 1.0 / usual[j])
        points += taken[j, 0]
        for c in range(10):
            total[c] += taken[j, c]
    if total[0] < LEAST_POINTS:
        return plane, changes
    a, b, g = solve(equations)
    # What was e = n p - d is now e - a - b s - g z.
    nx, ny, nz, d = nx - b * ux, ny - b * uy, nz - g, d + a
    k = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    if points > 0.0:
        noise = max(squares / points, NOISE_FLOOR * NOISE_FLOOR)
    return (nx * k, ny * k, nz * k, d * k, noise), changes


@njit(nogil=True, cache=True)
def is_shifted(spread: float, weight: float, first: float, variance: float) -> bool:
    """Tell whether a weighted sum of distances is more than noise and warp explain.

    `spread` is the sum of the weights' squares, `weight` that of the weights.
    """
    return abs(first) > DEVIATIONS * math.sqrt(spread * variance) + weight * WARP
