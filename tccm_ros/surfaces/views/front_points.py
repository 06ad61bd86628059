"""Detection of points on the front below the near edge of a surface.

On a board just below the laser, only a few scan lines are on the top, and as many beams are on the
few centimetres of its front. A plane fit through both rises away from the robot and is too low.
Points that are lower than the far half of the points are on the front if the plane fit has much
less slope without them.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Bool, Float64
from tccm_ros.robust import median_sigma
from tccm_ros.surfaces.views.thinning import cell_means

MIN_SLOPE = 0.015
"""Min slope, away from the robot, of a plane fit that may include a front; chosen: roll and pitch
of a base, and the uncertainty of a few scan lines."""

MAX_SLOPE_LEFT = 0.5
"""Max ratio of the slopes without and with the front; chosen: a ramp keeps its slope without its
low points."""

CELL = 0.02
"""Edge of the cells in which points are averaged, m: a scan line on a front has many beams."""

BELOW, SIGMAS = 0.003, 3.0
"""Points on a front are lower than the far half by more than this distance, m, plus this number of
its standard deviations; chosen."""


def are_on_front(points: Float64) -> Bool:
    """Return whether each point of a patch is on the front below its near edge, bool (N,).

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
