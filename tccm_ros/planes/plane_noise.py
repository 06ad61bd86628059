"""Detection of planes that are thicker than the noise of their points.

The expected thickness of a small piece of a plane follows from the range noise and the incidence
angle of the beams: it is small for a table top at a grazing angle and large for a wall ahead. A
horizontal plane through the front of a worktop, through cushions or through objects on a shelf is
much thicker in most of its pieces. A bent plane is not.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int32, Int64

FLATNESS = 0.0013
"""Deviation of a surface from a plane, m (one sigma): DIN 18202 allows finished surfaces a gap of
4 mm under a straightedge of 1 m, which is three of these."""

MIN_SLOPE = 0.02
"""Minimum sine of the angle between beams and a plane: no plane is flat enough for less. Chosen."""

PIECE = 0.04
"""Width of a piece, m: two cells, over which the bend of a plane is negligible."""

MIN_POINTS = 4
"""Minimum number of points of a piece. Chosen: one more than determine a plane."""

MAX_UNEVENNESS = 0.005
"""Maximum thickness of a plane beyond its noise, m: on four simulated recordings the thickness of
true planes equals their noise within 1 mm; on two real ones tops of tables are up to 3 mm thicker,
and planes through cushions, fronts and clutter on worktops 5 to 11 mm."""


def are_too_thick(
    points: Float64,
    labels: Int32,
    normals: Float64,
    offsets: Float64,
    sigma: Float64,
    viewpoint: Float64,
) -> Bool:
    """Return which planes of a tilt cycle are thicker than the noise of their points.

    Parameters
    ----------
    points
        float64 (M, 3), m.
    labels
        int32 (M,), plane of each point, -1 for none.
    normals, offsets
        float64 (F, 3), unit, and (F,), m, of the planes: ``normal . p = offset``.
    sigma
        float64 (M,), standard deviation of the range of each point, m.
    viewpoint
        float64 (3,), position of the sensor, m.

    Returns
    -------
    bool (F,); False for planes without pieces of `MIN_POINTS` points.
    """
    on = labels >= 0
    of, points = labels[on], points[on]
    beams = points - viewpoint
    distance = np.maximum(np.sqrt(np.einsum("ij,ij->i", beams, beams)), 1e-6)
    sine = np.abs(normals[of] @ viewpoint - offsets[of]) / distance
    across = np.maximum(sine, MIN_SLOPE) * sigma[on]
    count = np.maximum(np.bincount(of, minlength=len(normals)), 1)
    expected = np.sqrt(np.bincount(of, across**2, len(normals)) / count)
    residuals = np.einsum("ij,ij->i", points, normals[of]) - offsets[of]
    return np.asarray(thickness(points, of, residuals, len(normals)) > expected + MAX_UNEVENNESS)


def thickness(points: Float64, labels: Int32, residuals: Float64, planes: int) -> Float64:
    """Return the median standard deviation across the pieces of each plane, float64 (F,), m.

    Parameters
    ----------
    points, labels
        float64 (M, 3), m, and int32 (M,), plane of each.
    residuals
        float64 (M,), distance of each point from its plane, m.
    planes
        Number F of planes; those without pieces of `MIN_POINTS` points have thickness 0.
    """
    cells = np.floor(points[:, :2] / PIECE).astype(np.int64)
    cells -= cells.min(axis=0, initial=0)
    wide = cells.max(axis=0, initial=0) + 1
    key = (labels * wide[0] + cells[:, 0]) * wide[1] + cells[:, 1]
    pieces, piece, count = np.unique(key, return_inverse=True, return_counts=True)
    mean = np.bincount(piece, residuals, len(pieces)) / count
    squares = np.bincount(piece, (residuals - mean[piece]) ** 2, len(pieces))
    enough = count >= MIN_POINTS
    spread = np.sqrt(squares[enough] / (count[enough] - 1))
    of = pieces[enough] // (wide[0] * wide[1])
    order = np.lexsort((spread, of))
    first, last = np.searchsorted(of[order], [np.arange(planes), np.arange(1, planes + 1)])
    found = np.zeros(planes)
    has = last > first
    found[has] = spread[order][(first[has] + last[has] - 1) // 2]
    return found


def range_noise(
    points: Float64,
    labels: Int32,
    normals: Float64,
    offsets: Float64,
    rms: Float64,
    viewpoint: Float64,
) -> float:
    """Return the range noise, m: the median of the planes' estimates, weighted by points.

    Parameters
    ----------
    points, labels, normals, offsets, viewpoint
        As in `are_too_thick`.
    rms
        float64 (F,), rms residual of each plane, m.
    """
    slope, count = _slopes(points, labels, normals, offsets, viewpoint)
    return weighted_median(rms / slope, count)


def weighted_median(values: Float64, count: Int64) -> float:
    """Return the median of values float64 (N,) with weights int64 (N,); 0 without values."""
    if not count.any():
        return 0.0
    order = np.argsort(values, kind="stable")
    total = np.cumsum(count[order])
    return float(values[order[np.searchsorted(total, 0.5 * total[-1])]])


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
