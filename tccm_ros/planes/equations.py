"""Normal equations of a standing plane: ``e = a + b s + g z`` from moments.

Here s is the distance along the plane's level direction (ux, uy), z the height, and e the distance
from a first guess; what is looked for is how far the guess is off (a) and turned (b, g).
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tccm_ros.planes.inliers import Plane

__all__ = ["add_place", "add_rim", "rim_moments", "solve"]

Array = NDArray[np.float64]

SINGULAR = 1e-9
"""Share of the determinant below which a direction is not told."""


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
def add_rim(N: Array, sides: tuple[float, float, float, float, float], k: float) -> None:
    """Add the one equation of a rim, from `rim_moments`, with weight k for a point."""
    w, ws, wz, we, w2 = sides
    k /= w2
    add(N, k, w * w, w * ws, w * wz, ws * ws, ws * wz, wz * wz)
    add_right(N, k, w * we, ws * we, wz * we)


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
