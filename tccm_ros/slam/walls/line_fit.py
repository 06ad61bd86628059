"""Total-least-squares fit of segments, with covariance of (phi, rho)."""

from __future__ import annotations

from typing import Any

import numpy as np

from tccm_ros.arrays import Float64, Int32, Int64
from tccm_ros.kernels import kernel

SEGMENT = np.dtype(
    [
        ("phi", np.float64),
        ("rho", np.float64),
        ("cov", np.float64, (2, 2)),
        ("endpoints", np.float64, (2, 2)),
        ("count", np.int64),
    ]
)
"""A fitted segment, with the fields of `Lines`."""

MIN_INCIDENCE = 0.15
"""Minimum |cos| of the angle between beam and normal: at grazing incidence, bearing noise dominates
(chosen)."""


@kernel
def fit_segments(
    beams: Float64, labels: Int32, origin: Float64, sigma: float, min_points: int, min_length: float
) -> Any:
    """Fit a segment to the points of each label, if it has enough points and length.

    Parameters
    ----------
    beams
        float64 (B, 2), m.
    labels
        int32 (B,), the segment of each beam, or -1.
    origin, sigma
        As in `fit_segment`.
    min_points, min_length
        Minimum number of points and length (m) of a segment.

    Returns
    -------
    Segments of dtype `SEGMENT`, in the order of their labels
    """
    points, starts = group_by_segment(beams, labels, 0)
    total = len(starts) - 1
    segments = np.zeros(total, SEGMENT)
    count = 0
    for k in range(total):
        if starts[k + 1] - starts[k] < min_points:
            continue
        segment = segments[count]
        fit_segment(points[starts[k] : starts[k + 1]], origin, sigma, segment)
        ends = segment.endpoints
        if np.hypot(ends[1, 0] - ends[0, 0], ends[1, 1] - ends[0, 1]) >= min_length:
            count += 1
    return segments[:count]


@kernel
def group_by_segment(beams: Float64, labels: Int32, first: int) -> tuple[Float64, Int64]:
    """Return the points of all segments, concatenated, and the start of each.

    Parameters
    ----------
    beams
        float64 (B, 2), m.
    labels
        int32 (B,), the segment of each beam, or -1.
    first
        Beam at which the points begin; those before it come last.
    """
    order = np.roll(np.arange(len(labels)), -first)
    order = order[labels[order] >= 0]
    order = order[np.argsort(labels[order], kind="mergesort")]
    count = labels[order[-1]] + 1 if len(order) else 0
    return beams[order], np.searchsorted(labels[order], np.arange(count + 1))


@kernel
def fit_segment(points: Float64, origin: Float64, sigma: float, segment: Any) -> None:
    """Fit a line to points and write it to `segment`.

    Range noise moves a point along its beam; its component across the line is multiplied by the
    cosine of the incidence. With yc the offset of the points' centre along the tangent, v_phi the
    variance of the angle and v_perp that of the offset at the centre, the covariance of (phi, rho)
    is [[v_phi, yc v_phi], [yc v_phi, v_perp + yc^2 v_phi]] (docs/design/wall_slam.md, "Noise of a
    line").

    Parameters
    ----------
    points
        float64 (N, 2), N >= 2.
    origin
        float64 (2,), position of the laser; phi points away from it.
    sigma
        Noise of a range, m.
    segment
        Element of an array of dtype `SEGMENT`; written.
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
    segment.phi, segment.rho, segment.count = phi, rho, n
    cov, ends = segment.cov, segment.endpoints
    cov[0, 0], cov[1, 1] = v_phi, v_perp + yc * yc * v_phi
    cov[0, 1] = cov[1, 0] = yc * v_phi
    ends[0, 0], ends[0, 1] = rho * nx - (yc + low) * ny, rho * ny + (yc + low) * nx
    ends[1, 0], ends[1, 1] = rho * nx - (yc + high) * ny, rho * ny + (yc + high) * nx
