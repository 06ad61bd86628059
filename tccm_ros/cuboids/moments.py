"""Pooled moments: moments of cuboids add up, and give the least-squares plane of any set.

A moment vector is float64 (10,): N, the sums of x y z, and the sums of xx xy xz yy yz zz, in m
about an origin near the points (the laser), so that differences of sums lose no precision.
"""

import math

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.cuboids.cuboids import CuboidArrays
from tccm_ros.kernels import kernel

Moments = tuple[float, float, float, float, float, float, float, float, float, float]
"""Count, sums of x y z and of xx xy xz yy yz zz."""

FLAT = 1e-9
"""Variance of 0.1 mm quantisation (m2, rounded up): the lower limit of a plane's flatness."""


FIRST_STEPS = 3
"""Unconditional steps of the eigenvalue iteration: enough for most planes."""

MORE_STEPS = 30
"""Maximum number of further steps: enough for a double root, where a step divides the error by
3."""


@kernel
def shift_moments(
    ix: int, iy: int, sums: Moments | Float64, cell: float, tick: float, origin: Float64
) -> Moments:
    """Return the moments of a cuboid about an origin, m.

    Parameters
    ----------
    ix, iy
        Cell of the cuboid.
    sums
        Count, sums and products of the cuboid as in `Cuboids`, ticks.
    cell, tick
        Edge of a cell in ticks, and length of a tick in m.
    origin
        float64 (3,), ticks.
    """
    n, sx, sy, sz, xx, xy, xz, yy, yz, zz = sums
    tick2 = tick * tick
    ox, oy, oz = np.rint(ix * cell) - origin[0], np.rint(iy * cell) - origin[1], -origin[2]
    return (
        n,
        (sx + n * ox) * tick,
        (sy + n * oy) * tick,
        (sz + n * oz) * tick,
        (xx + ox * (2.0 * sx + n * ox)) * tick2,
        (xy + ox * sy + oy * sx + n * ox * oy) * tick2,
        (xz + ox * sz + oz * sx + n * ox * oz) * tick2,
        (yy + oy * (2.0 * sy + n * oy)) * tick2,
        (yz + oy * sz + oz * sy + n * oy * oz) * tick2,
        (zz + oz * (2.0 * sz + n * oz)) * tick2,
    )


@kernel
def moments_about(cuboids: CuboidArrays, origin: Float64) -> Float64:
    """Return the moments of all cuboids about one origin, float64 (N, 10), m.

    Parameters
    ----------
    cuboids
        Cuboids of a map.
    origin
        float64 (3,), ticks.
    """
    s, S = cuboids.s, cuboids.S
    out = np.empty((len(cuboids.ix), 10))
    for i in range(len(out)):
        sums = (
            cuboids.counts[i], s[i, 0], s[i, 1], s[i, 2],
            S[i, 0], S[i, 1], S[i, 2], S[i, 3], S[i, 4], S[i, 5],
        )  # fmt: skip
        m = shift_moments(cuboids.ix[i], cuboids.iy[i], sums, cuboids.cell, cuboids.tick, origin)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4] = m[0], m[1], m[2], m[3], m[4]
        out[i, 5], out[i, 6], out[i, 7], out[i, 8], out[i, 9] = m[5], m[6], m[7], m[8], m[9]
    return out


@kernel(error_model="numpy")
def root_step(trace: float, minors: float, det: float, x: float) -> float:
    """Return a Halley step towards the smallest eigenvalue, 0 if x is beyond it.

    Parameters
    ----------
    trace, minors, det
        Coefficients of the characteristic polynomial.
    x
        Current estimate.
    """
    value = det - x * (minors - x * (trace - x))
    slope = minors - x * (2.0 * trace - 3.0 * x)
    step = value * slope / (slope * slope - value * (trace - 3.0 * x))
    return step if (value > 0.0) & (slope > 0.0) else 0.0


@kernel
def eigenvalues(
    xx: float, xy: float, xz: float, yy: float, yz: float, zz: float
) -> tuple[float, float, float]:
    """Return the eigenvalues of a covariance, descending.

    Halley's method on the characteristic polynomial, from 0: below the smallest root it converges
    without overshoot, in a few steps if that root is well separated, as for every plane. It is
    several times faster than the trigonometric form. The first steps are unconditional, so that the
    processor can work on several planes at once.

    Parameters
    ----------
    xx, xy, xz, yy, yz, zz
        Elements of the covariance.
    """
    trace = xx + yy + zz
    minors = xx * yy - xy * xy + xx * zz - xz * xz + yy * zz - yz * yz
    det = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    l3 = 0.0
    for _ in range(FIRST_STEPS):
        step = root_step(trace, minors, det, l3)
        l3 += step
    for _ in range(MORE_STEPS):
        if step <= 1e-9 * l3:
            break
        step = root_step(trace, minors, det, l3)
        l3 += step
    rest = trace - l3
    root = math.sqrt(max(0.25 * rest * rest - (minors - l3 * rest), 0.0))
    return 0.5 * rest + root, 0.5 * rest - root, l3


@kernel
def plane_of(
    m: Float64 | tuple[float, ...],
) -> tuple[float, float, float, float, float, float, float]:
    """Return the least-squares plane of a moment vector.

    Returns
    -------
    nx, ny, nz, d : float
        Unit normal of arbitrary sign and offset, ``n . p = d``.
    l1, l2, l3 : float
        Eigenvalues of the points' covariance, m2, descending.
    """
    n = m[0]
    px, py, pz = m[1] / n, m[2] / n, m[3] / n
    xx, xy, xz = m[4] / n - px * px, m[5] / n - px * py, m[6] / n - px * pz
    yy, yz, zz = m[7] / n - py * py, m[8] / n - py * pz, m[9] / n - pz * pz
    l1, l2, l3 = eigenvalues(xx, xy, xz, yy, yz, zz)
    # The normal is the longest cross product of two rows of C - l3 I.
    a, b, c = xx - l3, yy - l3, zz - l3
    ux, uy, uz = xy * yz - xz * b, xz * xy - a * yz, a * b - xy * xy
    vx, vy, vz = xy * c - xz * yz, xz * xz - a * c, a * yz - xy * xz
    wx, wy, wz = b * c - yz * yz, yz * xz - xy * c, xy * yz - b * xz
    u2 = ux * ux + uy * uy + uz * uz
    v2 = vx * vx + vy * vy + vz * vz
    w2 = wx * wx + wy * wy + wz * wz
    if v2 > u2 and v2 >= w2:
        ux, uy, uz, u2 = vx, vy, vz, v2
    elif w2 > u2:
        ux, uy, uz, u2 = wx, wy, wz, w2
    if u2 < 1e-60:
        return 0.0, 0.0, 1.0, pz, l1, l2, l3
    k = 1.0 / math.sqrt(u2)
    ux, uy, uz = ux * k, uy * k, uz * k
    return ux, uy, uz, ux * px + uy * py + uz * pz, l1, l2, l3


@kernel
def residuals_of(m: Float64, nx: float, ny: float, nz: float, d: float) -> tuple[float, float]:
    """Return the sum and the sum of squares of the signed distances of points from a plane, m, m2.

    Parameters
    ----------
    m
        float64 (10,), moments of the points.
    nx, ny, nz, d
        The plane, ``n . p = d``: distances are positive on the side of the normal.
    """
    n = m[0]
    first = nx * m[1] + ny * m[2] + nz * m[3]
    second = nx * (nx * m[4] + 2.0 * (ny * m[5] + nz * m[6])) + ny * (ny * m[7] + 2.0 * nz * m[8])
    second += nz * nz * m[9]
    return first - n * d, max(second - d * (2.0 * first - n * d), 0.0)


@kernel
def tangents(normal: Float64) -> tuple[Float64, Float64]:
    """Return the tangent directions of a plane: u horizontal, v up the slope, u x v = normal.

    Parameters
    ----------
    normal
        float64 (3,), unit. For a horizontal plane u is x and v is y (-y if the normal points down).
    """
    nx, ny, nz = normal[0], normal[1], normal[2]
    slope = math.hypot(nx, ny)
    u = np.empty(3)
    if slope < 1e-6:
        u[0], u[1], u[2] = 1.0 - nx * nx, -nx * ny, -nx * nz
        u /= math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    else:
        u[0], u[1], u[2] = -ny / slope, nx / slope, 0.0
    v = np.empty(3)
    v[0], v[1], v[2] = ny * u[2] - nz * u[1], nz * u[0] - nx * u[2], nx * u[1] - ny * u[0]
    return u, v


@kernel
def uncertainty_of(m: Float64, normal: Float64, variance: float) -> tuple[Float64, float]:
    """Return the covariance of a plane fitted to a moment vector, and its quality.

    Parameters
    ----------
    m
        float64 (10,).
    normal
        float64 (3,), unit normal of the plane.
    variance
        Noise variance of each point perpendicular to the plane, m2.

    Returns
    -------
    cov : float64 (3, 3)
        Of (rotation about u, rotation about v, offset at the mean) with u, v of `tangents`; in rad
        and m.
    quality : float
        Val of Eq. (8), l1 l2 / l3, m2.
    """
    n = m[0]
    p = m[1:4] / n
    xx, xy, xz = m[4] / n - p[0] * p[0], m[5] / n - p[0] * p[1], m[6] / n - p[0] * p[2]
    yy, yz, zz = m[7] / n - p[1] * p[1], m[8] / n - p[1] * p[2], m[9] / n - p[2] * p[2]
    u, v = tangents(normal)
    ux, uy = xx * u[0] + xy * u[1] + xz * u[2], xy * u[0] + yy * u[1] + yz * u[2]
    uz = xz * u[0] + yz * u[1] + zz * u[2]
    vx, vy = xx * v[0] + xy * v[1] + xz * v[2], xy * v[0] + yy * v[1] + yz * v[2]
    vz = xz * v[0] + yz * v[1] + zz * v[2]
    a = u[0] * ux + u[1] * uy + u[2] * uz
    b = v[0] * ux + v[1] * uy + v[2] * uz
    c = v[0] * vx + v[1] * vy + v[2] * vz
    # The inverse of n [[c, -b, 0], [-b, a, 0], [0, 0, 1]].
    scale = variance / n
    det = a * c - b * b
    cov = np.zeros((3, 3))
    cov[0, 0], cov[1, 1], cov[2, 2] = scale * a / det, scale * c / det, scale
    cov[0, 1] = cov[1, 0] = scale * b / det
    l1, l2, l3 = eigenvalues(xx, xy, xz, yy, yz, zz)
    return cov, l1 * l2 / max(l3, FLAT)
