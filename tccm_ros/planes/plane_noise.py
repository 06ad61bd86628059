"""Detection of planes that are thicker than the noise of the ranges explains.

The thickness of a plane follows from the noise of the ranges and the angle at which the beams meet
it: a table top that the laser looks along is flat to a millimetre where a wall before it is not.
A horizontal plane through the front of a ledge and its top is much thicker than that.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int32, Int64

MIN_SLOPE = 0.02
"""Minimum sine of the angle between beams and a plane: no plane is straight enough for less.
Chosen."""

SIGMAS = 3.0
"""A plane may be this many times as thick as the noise of the ranges explains, plus
`MAX_UNEVENNESS`. Chosen."""

MAX_UNEVENNESS = 0.005
"""m, for uneven surfaces and errors of the sensor. Chosen."""


def are_too_thick(
    points: Float64,
    labels: Int32,
    normals: Float64,
    offsets: Float64,
    rms: Float64,
    viewpoint: Float64,
) -> Bool:
    """Return which planes of a tilt cycle are thicker than the noise of its ranges explains.

    Parameters
    ----------
    points
        float64 (M, 3), m.
    labels
        int32 (M,), plane of each point, -1 for none.
    normals, offsets, rms
        float64 (F, 3), unit, and (F,) and (F,), m, of the planes: ``normal . p = offset``.
    viewpoint
        float64 (3,), the laser.

    Returns
    -------
    bool (F,); planes without points are not.
    """
    slope, count = _slopes(points, labels, normals, offsets, viewpoint)
    noise = range_noise(rms / slope, count)
    return np.asarray((rms > SIGMAS * noise * slope + MAX_UNEVENNESS) & (count > 0))


def range_noise(implied: Float64, count: Int64) -> float:
    """Return the noise of the ranges, m: the median of what planes imply, weighted by points."""
    if not count.any():
        return 0.0
    order = np.argsort(implied, kind="stable")
    total = np.cumsum(count[order])
    return float(implied[order[np.searchsorted(total, 0.5 * total[-1])]])


def _slopes(
    points: Float64,
    labels: Int32,
    normals: Float64,
    offsets: Float64,
    viewpoint: Float64,
) -> tuple[Float64, Int64]:
    """Return for each plane the RMS sine of its beams' incidence angle, and its number of points.

    The angle is that between beam and plane: its sine is the distance of the laser from the plane
    over the length of the beam. Both arrays are (F,).
    """
    on = labels >= 0
    of, beams = labels[on], points[on] - viewpoint
    inverse = 1.0 / np.maximum(np.einsum("ij,ij->i", beams, beams), 1e-12)
    count = np.bincount(of, minlength=len(normals))
    mean = np.bincount(of, inverse, len(normals)) / np.maximum(count, 1)
    slope = np.abs(normals @ viewpoint - offsets) * np.sqrt(mean)
    return np.maximum(slope, MIN_SLOPE), count
