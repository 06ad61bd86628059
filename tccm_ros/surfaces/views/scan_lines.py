"""Scan lines in the points of a patch: their direction, and the distance of beams along them.

A laser measures a surface in lines whose distance is larger than that of the beams along them. A
line that crosses an edge ends within one beam of it, at any distance of the lines.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from tccm_ros.arrays import Float64

MAX_QUERIES = 200
"""Number of points at which directions and distances are computed; chosen."""

NEIGHBOURS = 9
"""Number of nearest points, including itself, that are compared with a point; chosen: a few of them
are on its line despite noise."""

NEIGHBOURHOOD = 0.6
"""Max distance of points on the same line, as a fraction of the distance of scan lines; chosen:
more than half, less than one."""

NEAREST = 1.5
"""Lower limit of that distance, as a multiple of the median distance of nearest points: beams may
be as far from each other as lines; chosen."""

MIN_POINTS = 12
"""Min number of points that define a direction; chosen."""

MAX_SCATTER = 0.6
"""Max ratio of the scatter across to that along the lines; chosen."""

CONE, MIN_ASIDE = 0.3, 0.008
"""Max lateral offset of the next beam of a line, as a fraction of its distance, and lower limit of
this offset, m: lines are straight, ranges have noise. Chosen."""

MIN_STEP = 0.004
"""Min distance of beams, m; chosen: below the range noise."""


def line_direction(points_xy: Float64, spacing: float) -> Float64 | None:
    """Return the direction of the scan lines of a patch; None: the points are not in lines.

    It is the first principal axis of the differences of points on the same line.

    Parameters
    ----------
    points_xy
        float64 (N, 2), m.
    spacing
        Distance of the scan lines, m.

    Returns
    -------
    float64 (2,), a unit vector of either sign.
    """
    if len(points_xy) < MIN_POINTS:
        return None
    queries = _chosen(points_xy)
    distance, index = cKDTree(points_xy).query(queries, k=min(NEIGHBOURS, len(points_xy)))
    limit = max(NEIGHBOURHOOD * spacing, NEAREST * float(np.median(distance[:, 1])))
    offset = (points_xy[index] - queries[:, None])[(distance > 0.0) & (distance <= limit)]
    if len(offset) < MIN_POINTS:
        return None
    variances, axes = np.linalg.eigh(offset.T @ offset / len(offset))
    if variances[0] > MAX_SCATTER**2 * variances[1]:
        return None
    return np.asarray(axes[:, 1], np.float64)


def beam_step(points_xy: Float64, direction: Float64) -> float | None:
    """Return the median distance of neighbouring beams of scan lines, m; None: there are none.

    Parameters
    ----------
    points_xy
        float64 (N, 2), m.
    direction
        float64 (2,), unit vector along the lines.
    """
    if len(points_xy) < 2:
        return None
    offset = points_xy[None] - _chosen(points_xy)[:, None]
    ahead = offset @ direction
    aside = np.abs(offset @ np.array([-direction[1], direction[0]]))
    is_next = (ahead > MIN_STEP) & (aside <= np.maximum(CONE * ahead, MIN_ASIDE))
    step = np.where(is_next, ahead, np.inf).min(axis=1)
    step = step[np.isfinite(step)]
    return float(np.median(step)) if len(step) else None


def _chosen(points_xy: Float64) -> Float64:
    """Return every n-th point: at most twice `MAX_QUERIES` points."""
    return points_xy[:: max(len(points_xy) // MAX_QUERIES, 1)]
