"""Random and systematic errors of the plane fit of a patch.

A plane is ``z + a (x - x0) + b (y - y0)`` about the centroid of the points.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.planes.plane_noise import FLATNESS

BLOCKS = 9
"""Number of blocks of a patch from whose residuals the covariance of its plane is estimated.
Chosen: six more than the plane has parameters, so that the estimate is good to a factor of two."""


def fit_covariance(points: Float64, weights: Float64) -> Float64:
    """Return the covariance of (z, a, b) of the plane fit of points.

    Errors of neighbouring points are correlated: they are of one scan line or of neighbouring
    pixels, and surfaces are not flat. The points are divided into blocks, and the sums of residuals
    over blocks, not the residuals of points, are assumed to be independent (a cluster-robust
    covariance: Liang and Zeger 1986, "Longitudinal data analysis using generalized linear models").
    The white noise of the points is added.

    Parameters
    ----------
    points
        float64 (N, 3), m.
    weights
        float64 (N,), number of measured points that each point represents.

    Returns
    -------
    float64 (3, 3), at the centroid; m and 1
    """
    total = weights.sum()
    offsets = points - weights @ points / total
    X = np.column_stack([np.ones(len(points)), offsets[:, :2]])
    moments = (X * weights[:, None]).T @ X
    spread, axes = np.linalg.eigh(moments[1:, 1:] / total)
    # Flatness regularises the slope across a line.
    moments[1:, 1:] += total * FLATNESS**2 * np.eye(2)
    inverse = np.linalg.inv(moments)
    residuals = offsets[:, 2] - X @ (inverse @ (X.T @ (weights * offsets[:, 2])))
    variance = float(weights @ residuals**2 / total) + FLATNESS**2
    block, count = _blocks(offsets[:, :2] @ axes, np.sqrt(np.maximum(spread, 0.0)))
    sums = np.column_stack([np.bincount(block, weights * x * residuals, count) for x in X.T])
    scatter = sums.T @ sums * (count / max(count - 3, 1))
    own = variance * float(weights @ weights) / total
    return np.asarray(inverse @ scatter @ inverse + own * inverse)


def _blocks(along: Float64, spread: Float64) -> tuple[Int64, int]:
    """Return the block of each point, and their number; blocks are about square, of equal counts.

    Parameters
    ----------
    along
        float64 (N, 2), along the shorter and the longer axis of the points, m.
    spread
        float64 (2,), their standard deviations, m.
    """
    ratio = float(np.sqrt(spread[1] / max(spread[0], FLATNESS)))
    longer = int(np.clip(round(np.sqrt(BLOCKS) * ratio), 1, BLOCKS))
    shorter = max(BLOCKS // longer, 1)
    ranks = np.argsort(np.argsort(along, axis=0, kind="stable"), axis=0, kind="stable")
    column = ranks * np.array([shorter, longer]) // max(len(along), 1)
    return column[:, 1] * shorter + column[:, 0], shorter * longer


def systematic_planes(points: Float64, weights: Float64, errors: Float64) -> Float64:
    """Return the error of a plane fit due to systematic errors of its points.

    Parameters
    ----------
    points, weights
        As for `fit_covariance`.
    errors
        float64 (N, K, 3), displacement of the points by each of K components of the error, m
        (`noise.systematic_errors`).

    Returns
    -------
    float64 (3, K), of (z, a, b) at the centroid
    """
    offsets = points - weights @ points / weights.sum()
    X = np.column_stack([np.ones(len(points)), offsets[:, :2]])
    moments = (X * weights[:, None]).T @ X
    moments[1:, 1:] += weights.sum() * FLATNESS**2 * np.eye(2)
    return np.linalg.solve(moments, X.T @ (weights[:, None] * errors[:, :, 2]))
