"""Normals of a local map, averaged over all scans, and the variances of their directions.

A normal fitted to a few beams of one scan has an error of some hundredths of a radian. The mean
over several scans is more accurate. Its remaining variance matters along a corridor: there, the
noise of the normals is the only information of walls on the position along it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.kernels import kernel
from tccm_ros.slam.matching.buckets import BUCKET, Buckets
from tccm_ros.slam.matching.level_scan import FLATNESS, principal_axes, write_normal

RADIUS = 0.2
"""Radius of the neighbourhood, over all scans, for a missing normal, m (chosen)."""

MIN_POINTS = 4
"""Minimum number of points for a missing normal. Chosen: two more than the parameters of a line."""

PRIOR_SIGMA, PRIOR_FREEDOM = 0.08, 20.0
"""Prior standard deviation (rad) of single normals, and its degrees of freedom relative to the
observed scatter: in a map of one scan, hardly any point has two normals (chosen: ordinary
lasers)."""

MOMENTS = np.dtype([(name, np.float64) for name in ("n", "x", "y", "xx", "xy", "yy")])
"""Number of points, sums of their coordinates, and sums of products of coordinates."""


@kernel
def mean_normals(normals: Float64, owner: Int64) -> tuple[Float64, Float64]:
    """Return the mean normal of each group of points, and the variance of its direction.

    The scatter of single normals about the means of their groups is assumed equal in the whole map,
    because many groups have one member.

    Parameters
    ----------
    normals
        float64 (N, 2), unit normals or zero.
    owner
        int64 (N,), index of the point that represents each point's group.

    Returns
    -------
    Unit normals float64 (N, 2) at the owners, zero where the owner has none, and variances float64
    (N,), rad^2
    """
    total, count = np.zeros_like(normals), np.zeros(len(normals))
    for i in range(len(normals)):
        j = owner[i]
        if _is_zero(normals, i) or _is_zero(normals, j):
            continue
        total[j, 0] += normals[i, 0]
        total[j, 1] += normals[i, 1]
        count[j] += 1.0
    squares, freedom = 0.0, 0.0
    for j in range(len(normals)):
        if count[j] > 0.0:
            length = np.hypot(total[j, 0], total[j, 1])
            # For small angles a, n - sum(cos a) is half the sum of a^2.
            squares += 2.0 * (count[j] - length)
            freedom += count[j] - 1.0
            total[j, 0] /= length
            total[j, 1] /= length
    squares += PRIOR_FREEDOM * PRIOR_SIGMA**2
    scatter = squares / (freedom + PRIOR_FREEDOM)
    return total, np.where(count > 0.0, scatter / np.maximum(count, 1.0), 0.0)


@kernel
def fit_missing_normals(
    points: Float64,
    normals: Float64,
    variances: Float64,
    lasers: Float64,
    buckets: Buckets,
    all_points: Float64,
) -> None:
    """Fit normals to points without one, from the points of all scans, where these are flat.

    Beams far along a corridor are too sparse for a normal in a single scan; several scans fill the
    gaps. Corners and small objects get no normal.

    Parameters
    ----------
    points, normals, variances
        float64 (N, 2), (N, 2) and (N,) of a map, sorted into buckets; normals and variances are
        updated.
    lasers
        float64 (N, 2), position of the laser for each point; normals point to it.
    buckets
        Buckets of the map.
    all_points
        float64 (M, 2), points of all scans.
    """
    origin, starts = buckets.origin, buckets.starts
    missing, wanted = np.zeros(len(points), np.bool_), np.zeros(starts.shape[:2], np.bool_)
    for k in range(len(points)):
        if _is_zero(normals, k):
            missing[k] = True
            x, y = points[k, 0] - origin[0], points[k, 1] - origin[1]
            wanted[int(x / BUCKET), int(y / BUCKET)] = True
    moments = np.zeros(len(points), MOMENTS)
    for i in range(len(all_points)):
        x, y = all_points[i, 0] - origin[0], all_points[i, 1] - origin[1]
        for gx in range(int((x - RADIUS) / BUCKET), int((x + RADIUS) / BUCKET) + 1):
            for gy in range(int((y - RADIUS) / BUCKET), int((y + RADIUS) / BUCKET) + 1):
                if not wanted[gx, gy]:
                    continue
                for k in range(starts[gx, gy, 0], starts[gx, gy, 1]):
                    if missing[k]:
                        dx = all_points[i, 0] - points[k, 0]
                        dy = all_points[i, 1] - points[k, 1]
                        if dx * dx + dy * dy < RADIUS * RADIUS:
                            _count_in(moments[k], dx, dy)
    for k in range(len(points)):
        m = moments[k]
        if not missing[k] or m.n < MIN_POINTS:
            continue
        thick, long, nx, ny = principal_axes(m.n, m.x, m.y, m.xx, m.xy, m.yy)
        if thick < long and thick <= FLATNESS * FLATNESS * long:
            write_normal(points, k, lasers[k], nx, ny, normals)
            # Variance of a line's direction: variance across over variance along.
            variances[k] = max(thick, 0.0) / ((m.n - 2.0) * long)


@kernel
def _count_in(m: Any, dx: float, dy: float) -> None:
    """Add a point to the moments."""
    m.n += 1.0
    m.x += dx
    m.y += dy
    m.xx += dx * dx
    m.xy += dx * dy
    m.yy += dy * dy


@kernel
def _is_zero(normals: Float64, i: int) -> bool:
    return bool(normals[i, 0] == 0.0 and normals[i, 1] == 0.0)
