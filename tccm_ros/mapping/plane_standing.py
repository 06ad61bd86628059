"""Standing planes: boards and walls, whose cells form a line and whose noise the cells' walls cut.

They are fitted by weighted least squares over their places (`plane_places`), each of which is
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

from tccm_ros.mapping.moments import residuals_of
from tccm_ros.mapping.plane_equations import add_place, add_rim, rim_moments, solve
from tccm_ros.mapping.plane_members import NOISE_FLOOR, Plane, is_mixed
from tccm_ros.mapping.plane_places import NO_RIM, pool_places

__all__ = ["fit_standing"]

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

ROUNDS = 3

LEAST_POINTS = 10.0
"""With fewer points left after the tests the guess has to do."""

LEAST_DEPTH = 0.01
"""A rim of less rms depth, m, is one scan line, and says nothing."""


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
    usual, is_refused = np.empty(len(layers)), np.empty(len(layers), np.bool_)
    for j in range(len(layers)):
        every, two, rest, one = layers[j]
        usual[j] = (two + PRIOR * noise) / (every + PRIOR)
        is_refused[j] = is_shifted(rest, rest, one, noise)
    equations = np.zeros((3, 4))
    total[:] = 0.0
    # The places of a layer have one weight: their moments are added up, and make one equation.
    taken, squares = np.zeros((len(layers), 10)), 0.0
    for p in range(len(pooled)):
        m, j = pooled[p], layer[p]
        lenient = max(noise, usual[j])
        if rim[p] == NO_RIM:
            if is_refused[j] or is_shifted(m[0], m[0], sums[p, 0], lenient):
                continue
            if is_mixed(m[0], sums[p, 1], lenient, DEVIATIONS):
                continue
            into = taken[j]
            for c in range(10):
                into[c] += m[c]
            squares += sums[p, 1]
        else:
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
