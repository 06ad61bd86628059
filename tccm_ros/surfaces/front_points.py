"""Points of the front below the near edge of a surface, that a plane through both took in.

Of a board just below the laser a few scan lines lie on the top, and as many beams on the few
centimetres of its front. A plane through both rises away from the robot, and is too low. Where the
far half of the points is level by itself, and what is lower than that leaves no slope when it is
removed, it is the front.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Bool, Float64
from tccm_ros.robust import median_sigma
from tccm_ros.surfaces.thinning import cell_means

MIN_SLOPE = 0.015
"""A surface that rises by less than this, and away from the robot, has no front in it; chosen: the
roll and pitch of a base, and what a few scan lines leave open."""

MAX_SLOPE_LEFT = 0.5
"""Without the front the slope is less than this fraction of that with it; chosen: a ramp keeps its
slope whatever is removed."""

CELL = 0.02
"""Points are counted once for each cell of this edge, m: a scan line on a front has many beams."""

BELOW, SIGMAS = 0.003, 3.0
"""Points of a front are lower than the far half by more than this, m, and so many of its standard
deviations; chosen."""


def are_on_front(points: Float64) -> Bool:
    """Return which points of a patch are of the front below its near edge, bool (N,).

    Parameters
    ----------
    points
        float64 (N, 3), m, in the base frame of the view.
    """
    none = np.zeros(len(points), np.bool_)
    cells, _ = cell_means(points, CELL)
    slopes = _slopes(cells)
    slope = float(np.hypot(*slopes))
    if slope < MIN_SLOPE or slopes @ cells[:, :2].mean(axis=0) <= 0.0:
        return none
    up = slopes / slope
    depth = cells[:, :2] @ up
    far = cells[depth >= np.median(depth), 2]
    middle = float(np.median(far))
    level = middle - BELOW - SIGMAS * median_sigma(far - middle)
    if _slopes(cells[cells[:, 2] >= level]) @ up > MAX_SLOPE_LEFT * slope:
        return none
    return np.asarray(points[:, 2] < level)


def _slopes(points: Float64) -> Float64:
    """Return the slopes in x and y of the least-squares plane of points (N, 3), float64 (2,)."""
    offset = points - points.mean(axis=0)
    slopes, *_ = np.linalg.lstsq(offset[:, :2], offset[:, 2], rcond=None)
    return np.asarray(slopes, np.float64)
