"""Total-least-squares fit of one segment, with its covariance in (phi, rho)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["fit_segment"]

Float64 = NDArray[np.float64]

MIN_INCIDENCE = 0.15
"""Least |cos| of the angle between beam and normal: beyond, bearing noise takes over."""


@njit(nogil=True, cache=True)
def fit_segment(
    points: Float64, origin: Float64, sigma: float, row: Float64
) -> None:  # pragma: no cover - compiled
    """Fit a line to points and write phi, rho, v_phi, c, v_rho, x0, y0, x1, y1, count to `row`.

    The noise of a range moves a point along its beam: across the line it counts with the cosine
    of the incidence. With yc the offset of the points' centre along the tangent, v_phi the
    variance of the angle and v_perp that of the offset at the centre, the covariance of
    (phi, rho) is [[v_phi, yc v_phi], [yc v_phi, v_perp + yc^2 v_phi]] (DESIGN section 7).

    Parameters
    ----------
    points
        float64 (N, 2), N >= 2.
    origin
        float64 (2,), the laser; phi points away from it.
    sigma
        Noise of a range, m.
    row
        float64 (10,), receives the result.
    """
    n = len(points)
    mx, my = 0.0, 0.0
    for i in range(n):
        mx, my = mx + points[i, 0], my + points[i, 1]
    mx, my = mx / n, my / n
    sxx, sxy, syy = 0.0, 0.0, 0.0
    for i in range(n):
        x, y = points[i, 0] - mx, points[i, 1] - my
        sxx, sxy, syy = sxx + x * x, sxy + x * y, syy + y * y
    phi = 0.5 * np.arctan2(2.0 * sxy, sxx - syy) + 0.5 * np.pi
    if np.cos(phi) * (mx - origin[0]) + np.sin(phi) * (my - origin[1]) < 0.0:
        phi += np.pi
    phi = -((-phi + np.pi) % (2.0 * np.pi) - np.pi)
    nx, ny = np.cos(phi), np.sin(phi)
    rho = nx * mx + ny * my
    low, high, spread = np.inf, -np.inf, 0.0
    noise, turning = 0.0, 0.0
    for i in range(n):
        t = -ny * (points[i, 0] - mx) + nx * (points[i, 1] - my)
        bx, by = points[i, 0] - origin[0], points[i, 1] - origin[1]
        across = nx * bx + ny * by
        incidence2 = across * across / max(bx * bx + by * by, 1e-18)
        v = sigma * sigma * max(incidence2, MIN_INCIDENCE * MIN_INCIDENCE)
        noise, turning, spread = noise + v, turning + v * t * t, spread + t * t
        low, high = min(low, t), max(high, t)
    v_perp = noise / (n * n)
    v_phi = turning / max(spread * spread, 1e-12)
    yc = -ny * mx + nx * my
    row[0], row[1] = phi, rho
    row[2], row[3], row[4] = v_phi, yc * v_phi, v_perp + yc * yc * v_phi
    row[5], row[6] = rho * nx - (yc + low) * ny, rho * ny + (yc + low) * nx
    row[7], row[8] = rho * nx - (yc + high) * ny, rho * ny + (yc + high) * nx
    row[9] = n
