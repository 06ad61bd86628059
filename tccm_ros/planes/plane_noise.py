"""Planes that are thicker than the laser is noisy.

A plane is as thick as the noise of the ranges makes it, seen at the angle at which the beams meet
it: a table top that the laser looks along is flat to a millimetre where a wall before it is not.
A level plane through the front of a ledge and its top is thicker than that by far.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int32, Int64

__all__ = ["are_too_thick", "range_noise"]


LEAST_SLOPE = 0.02
"""Beams are taken to meet planes at least this steeply (sine): flatter ones are never straight."""

SIGMAS = 3.0
"""A plane may be this many times as thick as the noise of the ranges makes it,"""

UNEVEN = 0.005
"""plus this, m: neither surfaces nor sensors are perfect."""


def are_too_thick(
    points: Float64,
    labels: Int32,
    normals: Float64,
    offsets: Float64,
    rms: Float64,
    viewpoint: Float64,
) -> Bool:
    """Tell which planes of a sweep are thicker than the noise of the sweep's ranges explains.

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
    return np.asarray((rms > SIGMAS * noise * slope + UNEVEN) & (count > 0))


def range_noise(implied: Float64, count: Int64) -> float:
    """Return the noise of the ranges that most points' planes imply: the weighted median, m."""
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
    """Return the sine of the angle at which beams meet each plane, rms, and its points, (F,).

    It is the distance of the laser from the plane over the length of the beam.
    """
    on = labels >= 0
    of, beams = labels[on], points[on] - viewpoint
    inverse = 1.0 / np.maximum(np.einsum("ij,ij->i", beams, beams), 1e-12)
    count = np.bincount(of, minlength=len(normals))
    mean = np.bincount(of, inverse, len(normals)) / np.maximum(count, 1)
    slope = np.abs(normals @ viewpoint - offsets) * np.sqrt(mean)
    return np.maximum(slope, LEAST_SLOPE), count
