"""The direction of the scan lines in the points of a patch.

A laser measures a surface in lines whose distance is larger than that of the beams along them. A
line that crosses an edge ends within one beam of it, at any distance of the lines.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from tccm_ros.arrays import Float64

NEIGHBOURS = 9
"""Number of nearest points, including itself, that are compared with a point. With 24, the overlap
of random flat 216 is .941 in place of .945."""

NEIGHBOURHOOD = 0.6
"""Max distance of points on the same line, as a fraction of the distance of scan lines; chosen:
more than half, less than one."""

MAX_SCATTER = 0.6
"""Max ratio of the scatter across to that along the lines; chosen."""


def line_direction(points_xy: Float64, spacing: float) -> Float64 | None:
    """Return the direction of the scan lines of a patch; None: the points are not in lines.

    It is the first principal axis of the differences of points on the same line.

    Parameters
    ----------
    points_xy
        float64 (N, 2), N > 0, m.
    spacing
        Distance of the scan lines, m.

    Returns
    -------
    float64 (2,), a unit vector of either sign.
    """
    distance, index = cKDTree(points_xy).query(
        points_xy, k=NEIGHBOURS, distance_upper_bound=NEIGHBOURHOOD * spacing
    )
    of_point, nth = np.nonzero(np.isfinite(distance))
    offset = points_xy[index[of_point, nth]] - points_xy[of_point]
    variances, axes = np.linalg.eigh(offset.T @ offset)
    if not variances[1] > 0.0 or variances[0] > MAX_SCATTER**2 * variances[1]:
        return None
    return np.asarray(axes[:, 1], np.float64)
