"""The fit of vertical planes: boards and walls, whose cells form a line.

They are fitted by weighted least squares over their patches (`vertical_patches`). Each patch is
accepted or rejected as a whole, by its mean and scatter and with its layer. The normal equations
are those of ``e = a + b s + g z``: s is the distance along the plane's horizontal direction
(ux, uy), z the height, and e the distance from an initial plane; unknown are the initial plane's
errors in offset (a) and direction (b, g).

Without the caps of rims, moments cannot separate the points of the board from those of the surface
at its rim. But points can be weighted by their depth below the rim: a point at z_rim contributes
nothing to the sum of (z_rim - z) e. A rim therefore gives this equation instead of that of its
mean, with three quarters of the information (`rim_moments`).
"""

import math
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int32
from tccm_ros.cuboids.moments import residuals_of
from tccm_ros.kernels import kernel
from tccm_ros.planes.arrays import PlaneMap
from tccm_ros.planes.inliers import MIN_INSIDE, NOISE_FLOOR, ROUNDS, Plane, is_mixed
from tccm_ros.planes.vertical_patches import NO_RIM, pool_patches
from tccm_ros.robust import GATE

LAYER = 0.25
"""Height of layers, m. Noise is estimated for each layer, since it depends on the incidence angle,
and a layer may be rejected as a whole: a drawer's back may be 10 mm behind the front above it.
Chosen."""

WARP = 0.001
"""Tolerance of a patch's mean beyond its noise, m: no board is flat. With `plane_noise.FLATNESS`,
tops of objects are a surface of a random flat (103)."""

PRIOR = 20.0
"""Weight of the whole plane's noise in the noise of a layer, in points. Chosen."""

CONVERGED = 0.9
"""A round that accepts the same patches as the previous one is the last, unless the variance falls
below this fraction of the previous one: then the next round may reject more. Chosen."""

MIN_DEPTH = 0.01
"""Minimum rms depth of a rim in the fit, m: a lower one is a single scan line. Chosen."""

SINGULAR = 1e-9
"""Minimum ratio of the determinant to its diagonal product for a solvable direction. Chosen."""


class _Patches(NamedTuple):
    """The patches of a vertical plane.

    Attributes
    ----------
    pooled, rim
        Results of `pool_patches`.
    layer
        int32 (P,), layer of each patch.
    tick, ground
        A tick, and the height of the moments' origin, m.
    """

    pooled: Float64
    rim: Int32
    layer: Int32
    tick: float
    ground: float


class _Taken(NamedTuple):
    """Accepted patches of the last round, bool (P,), and their moments by layer (L, 10)."""

    is_taken: Bool
    moments: Float64


@kernel
def fit_vertical(cuboids: PlaneMap, members: Int32, plane: Plane, total: Float64) -> Plane:
    """Return the fit of a vertical plane by weighted least squares over its patches.

    Parameters
    ----------
    cuboids, members
        The map, and the indices of its cuboids in one connected set.
    plane
        Initial plane.
    total
        float64 (10,), written: pooled moments of the patches in the fit; a rim is scaled by the
        information of its equation.
    """
    pooled, rim = pool_patches(cuboids, members, plane)
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
    patches = _Patches(pooled, rim, layer, cuboids.tick, cuboids.origin[2] * cuboids.tick)
    taken = _Taken(np.zeros(len(pooled), np.bool_), np.zeros((layer.max() + 1, 10)))
    for _ in range(ROUNDS):
        before = plane[4]
        plane, changes = improve(patches, plane, taken, total)
        if changes == 0 and plane[4] > CONVERGED * before:
            break
    return plane


@kernel
def through_median(pooled: Float64, plane: Plane) -> Plane:
    """Return a plane shifted to the median of the patches, weighted by points.

    An initial plane through all members is between a board and an object a centimetre behind its
    foot. Tested against it, the board itself could be rejected.
    """
    nx, ny, nz, d, noise = plane
    off, half = np.empty(len(pooled)), 0.0
    for p in range(len(pooled)):
        m = pooled[p]
        off[p] = (nx * m[1] + ny * m[2] + nz * m[3]) / m[0] - d
        half += 0.5 * m[0]
    order = np.argsort(off)
    k = 0
    while half > pooled[order[k], 0]:
        half -= pooled[order[k], 0]
        k += 1
    return nx, ny, nz, d + off[order[k]], noise


@kernel
def improve(patches: _Patches, plane: Plane, taken: _Taken, total: Float64) -> tuple[Plane, int]:
    """Return a vertical plane refitted to the patches within its noise.

    Parameters
    ----------
    patches, plane
        The plane's patches, and the last plane.
    taken
        Accepted patches, changed.
    total
        float64 (10,), written.

    Returns
    -------
    The plane, and the number of patches with another decision than in the last round.
    """
    sums, equations = np.empty((len(patches.pooled), 2)), np.zeros((3, 4))
    usual, is_refused = layer_noise(patches, plane, len(taken.moments), sums)
    squares, changes = accept_patches(patches, plane[4], usual, is_refused, sums, taken)
    total[:] = 0.0
    add_rims(patches, plane, usual, equations, total)
    points = add_layers(taken.moments, plane, usual, equations, total)
    if total[0] < MIN_INSIDE:
        return plane, changes
    noise = max(squares / points, NOISE_FLOOR * NOISE_FLOOR) if points > 0.0 else plane[4]
    return corrected(plane, solve(equations), noise), changes


@kernel
def layer_noise(patches: _Patches, plane: Plane, count: int, sums: Float64) -> tuple[Float64, Bool]:
    """Return the noise of each layer, and which layers are rejected as a whole.

    Parameters
    ----------
    patches, plane
        As in `improve`.
    count
        Number of layers, L.
    sums
        float64 (P, 2), written: sums of the distances of each patch's points, m, and squares, m2.

    Returns
    -------
    usual : float64 (L,)
        Variance across the plane, m2.
    is_refused : bool (L,)
    """
    nx, ny, nz, d, noise = plane
    # Per layer: points and squares of all patches, then points and sum of patches except rims.
    layers = np.zeros((count, 4))
    for p in range(len(patches.pooled)):
        n = patches.pooled[p, 0]
        sums[p, 0], sums[p, 1] = residuals_of(patches.pooled[p], nx, ny, nz, d)
        into = layers[patches.layer[p]]
        into[0] += n
        into[1] += sums[p, 1]
        if patches.rim[p] == NO_RIM:
            into[2] += n
            into[3] += sums[p, 0]
    usual, is_refused = np.empty(count), np.empty(count, np.bool_)
    for j in range(count):
        every, two, rest, one = layers[j]
        usual[j] = (two + PRIOR * noise) / (every + PRIOR)
        is_refused[j] = is_shifted(rest, rest, one, noise)
    return usual, is_refused


@kernel
def accept_patches(
    patches: _Patches, noise: float, usual: Float64, is_refused: Bool, sums: Float64, taken: _Taken
) -> tuple[float, int]:
    """Accept or reject each patch that is no rim.

    Parameters
    ----------
    patches, taken
        As in `improve`.
    noise
        Variance across the plane, m2.
    usual, is_refused, sums
        Results of `layer_noise`.

    Returns
    -------
    The sum of squared distances of accepted points from the plane, m2, and the number of patches
    with another decision than in the last round.
    """
    is_taken, by_layer = taken
    squares, changes = 0.0, 0
    for p in range(len(patches.pooled)):
        if patches.rim[p] != NO_RIM:
            continue
        n, j = patches.pooled[p, 0], patches.layer[p]
        lenient = max(noise, usual[j])
        takes = not (
            is_refused[j]
            or is_shifted(n, n, sums[p, 0], lenient)
            or is_mixed(n, sums[p, 1], lenient, GATE)
        )
        squares += sums[p, 1] * takes
        if takes != is_taken[p]:
            is_taken[p] = takes
            changes += 1
            sign = 1.0 if takes else -1.0
            for c in range(10):
                by_layer[j, c] += sign * patches.pooled[p, c]
    return squares, changes


@kernel
def add_rims(
    patches: _Patches, plane: Plane, usual: Float64, equations: Float64, total: Float64
) -> None:
    """Add the rims within the plane's noise to the normal equations.

    Parameters
    ----------
    patches, plane, total
        As in `improve`.
    usual
        float64 (L,), variance across the plane of each layer, m2.
    equations
        float64 (3, 4), changed.
    """
    ux, uy = horizontal_direction(plane)
    for p in range(len(patches.pooled)):
        if patches.rim[p] == NO_RIM:
            continue
        m, j = patches.pooled[p], patches.layer[p]
        sides = rim_moments(m, plane, ux, uy, patches.rim[p] * patches.tick - patches.ground)
        w, _, _, we, w2 = sides
        lenient = max(plane[4], usual[j])
        if w2 <= MIN_DEPTH * MIN_DEPTH * m[0] or is_shifted(w2, w, we, lenient):
            continue
        add_rim(equations, sides, 1.0 / usual[j])
        fraction = w * w / (w2 * m[0])
        for c in range(10):
            total[c] += fraction * m[c]


@kernel
def add_layers(
    by_layer: Float64, plane: Plane, usual: Float64, equations: Float64, total: Float64
) -> float:
    """Add the accepted patches to the normal equations; return their number of points.

    Patches of a layer have equal weights, so that their summed moments are added at once.

    Parameters
    ----------
    by_layer
        float64 (L, 10), moments of accepted patches by layer.
    plane, usual, equations, total
        As in `add_rims`.
    """
    ux, uy = horizontal_direction(plane)
    points = 0.0
    for j in range(len(by_layer)):
        add_patch(equations, by_layer[j], plane, ux, uy, 1.0 / usual[j])
        points += by_layer[j, 0]
        for c in range(10):
            total[c] += by_layer[j, c]
    return points


@kernel
def horizontal_direction(plane: Plane) -> tuple[float, float]:
    """Return the unit vector (ux, uy) along a vertical plane."""
    slope = math.hypot(plane[0], plane[1])
    return -plane[1] / slope, plane[0] / slope


@kernel
def corrected(plane: Plane, errors: tuple[float, float, float], noise: float) -> Plane:
    """Return a plane corrected by its errors (a, b, g), with a new noise variance, m2."""
    nx, ny, nz, d, _ = plane
    ux, uy = horizontal_direction(plane)
    a, b, g = errors
    # The distance e = n p - d becomes e - a - b s - g z.
    nx, ny, nz, d = nx - b * ux, ny - b * uy, nz - g, d + a
    k = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx * k, ny * k, nz * k, d * k, noise


@kernel
def is_shifted(spread: float, weight: float, first: float, variance: float) -> bool:
    """Return whether a weighted sum of distances is more than noise and warp.

    Parameters
    ----------
    spread, weight
        Sum of the squares of the weights, and of the weights.
    first
        Weighted sum of the distances, m.
    variance
        Variance of the noise across the plane, m2.
    """
    return abs(first) > GATE * math.sqrt(spread * variance) + weight * WARP


@kernel
def add_patch(N: Float64, m: Float64, plane: Plane, ux: float, uy: float, k: float) -> None:
    """Add a patch's points to the normal equations of ``e = a + b s + g z``.

    Parameters
    ----------
    N
        float64 (3, 4), changed.
    m
        float64 (10,), moments of the points.
    plane
        The initial plane, from which e is measured.
    ux, uy
        Its horizontal direction.
    k
        Weight of a point.
    """
    nx, ny, nz, d, _ = plane
    s, sx, sy = ux * m[1] + uy * m[2], ux * m[4] + uy * m[5], ux * m[5] + uy * m[7]
    sz = ux * m[6] + uy * m[8]
    left = m[0], s, m[3], ux * sx + uy * sy, sz, m[9]
    right = (
        nx * m[1] + ny * m[2] + nz * m[3] - d * m[0],
        nx * sx + ny * sy + nz * sz - d * s,
        nx * m[6] + ny * m[8] + nz * m[9] - d * m[3],
    )
    add_equation(N, k, left, right)


@kernel
def add_rim(N: Float64, sides: tuple[float, float, float, float, float], k: float) -> None:
    """Add the one equation of a rim to the normal equations.

    Parameters
    ----------
    N
        float64 (3, 4), changed.
    sides
        Result of `rim_moments`.
    k
        Weight of a point.
    """
    w, ws, wz, we, w2 = sides
    k /= w2
    left = w * w, w * ws, w * wz, ws * ws, ws * wz, wz * wz
    add_equation(N, k, left, (w * we, ws * we, wz * we))


@kernel
def rim_moments(
    m: Float64, plane: Plane, ux: float, uy: float, z_rim: float
) -> tuple[float, float, float, float, float]:
    """Return the sums of w, w s, w z, w e and w w over a patch's points, for w = z_rim - z.

    Here s is the distance along (ux, uy), z the height and e the distance from the plane.

    Parameters
    ----------
    m
        float64 (10,), moments of the points.
    plane, ux, uy
        As in `add_patch`.
    z_rim
        Height of the rim, m, about the moments' origin.
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


@kernel
def add_equation(
    N: Float64,
    k: float,
    left: tuple[float, float, float, float, float, float],
    right: tuple[float, float, float],
) -> None:
    """Add weighted terms to the normal equations for (a, b, g).

    Parameters
    ----------
    N
        float64 (3, 4), changed: the upper triangle and the right side.
    k
        Weight.
    left, right
        The terms: row by row of the upper triangle, and of the right side.
    """
    N[0, 0] += k * left[0]
    N[0, 1] += k * left[1]
    N[0, 2] += k * left[2]
    N[1, 1] += k * left[3]
    N[1, 2] += k * left[4]
    N[2, 2] += k * left[5]
    N[0, 3] += k * right[0]
    N[1, 3] += k * right[1]
    N[2, 3] += k * right[2]


@kernel
def solve(N: Float64) -> tuple[float, float, float]:
    """Return the solution (a, b, g) of normal equations; b = g = 0 where these are singular."""
    b, g = N[0, 1] / N[0, 0], N[0, 2] / N[0, 0]
    bb, bg, gg = N[1, 1] - b * N[0, 1], N[1, 2] - b * N[0, 2], N[2, 2] - g * N[0, 2]
    right_b, right_g = N[1, 3] - b * N[0, 3], N[2, 3] - g * N[0, 3]
    det = bb * gg - bg * bg
    if det <= SINGULAR * bb * gg:
        return N[0, 3] / N[0, 0], 0.0, 0.0
    b, g = (right_b * gg - right_g * bg) / det, (bb * right_g - bg * right_b) / det
    return (N[0, 3] - N[0, 1] * b - N[0, 2] * g) / N[0, 0], b, g
