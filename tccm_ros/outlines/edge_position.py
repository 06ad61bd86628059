"""Estimation of the position of an edge from the last samples of a surface before it.

Scan lines and beams sample a surface at a certain distance. The last sample before an edge is
anywhere within one such distance of it, with noise: an interval for the edge. The intervals of
several views intersect, so that the edge is known more precisely than the sampling of each view.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr, ndtr

from tccm_ros.arrays import Bool, Float64
from tccm_ros.robust import UNIFORM_WIDTH

HALF_RANGE = 0.15
"""Maximum distance of candidate positions from the first guess, m; chosen."""

SIGMA = 0.006
"""Standard deviation of a last sample, and step of the candidate positions, m: range noise, pose
noise, thinning; chosen."""

OUTLIER = 0.05
"""Fraction of outliers among last samples, distributed uniformly within `HALF_RANGE`: an object
occludes the edge; chosen."""

OUTLIER_BEYOND = 0.2
"""Factor on the outlier density for samples beyond the edge: mixed pixels, points of a wall;
chosen."""

OUTERMOST = 0.56
"""Expected distance of the last sample beyond a front, in `SIGMA`: it is the outermost of at least
two samples. The mean of the larger of two normal variables, 1 / sqrt(pi)."""

FADE = 0.06
"""Decay length, m, of the density of an edge beyond a last sample past which the view did not look:
the surface may extend further. Of 0.03, 0.06, 0.12 and 0.24, this one gives the best outlines (mean
overlap .925, .927, .927, .924 on bags/flat, .919, .920, .913, .906 on bags/rgbd_kitchen)."""

INDEPENDENT = 8.0
"""Maximum effective number of samples of one view, as they have a common pose error; chosen."""

EDGE_SIGMA = 0.005
"""Standard deviation of an edge that all its samples have in common, m: mixed pixels at its end, or
the gap to the wall at which it ends. With it errors agree with standard deviations on four
recordings (`bench/bench_edges.py`)."""

WALL_DISTANCE = 0.12
"""Maximum distance of an edge from a wall at which it may end, of an outline beyond a wall that
bounds it, and length before a wall in which an edge is as likely as at the wall itself, m; chosen:
the depth that objects before a wall occlude."""


class EdgeSamples(NamedTuple):
    """The last samples of all views before an edge, one for each short piece of the edge.

    Attributes
    ----------
    at
        float64 (N,), position along the edge, m.
    last
        float64 (N,), position of the last sample across the edge, positive outwards, m.
    gap
        float64 (N,), distance from the last sample to the next one, m.
    front
        float64 (N,), probability that the last sample is on the front below the edge, and so at the
        edge, 0 to 1.
    ends
        bool (N,), whether the view looked past the surface there.
    weight
        float64 (N,), weight of the sample, 0 to 1.
    """

    at: Float64
    last: Float64
    gap: Float64
    front: Float64
    ends: Bool
    weight: Float64


def locate_edge(samples: EdgeSamples, wall: float | None = None) -> tuple[float, float]:
    """Return the median position of an edge across the first guess, and its standard deviation, m.

    Parameters
    ----------
    samples
        Last samples; the first guess is at 0 across.
    wall
        Position across of a wall that bounds the edge, m; None: no wall is near.
    """
    count = round(HALF_RANGE / SIGMA)
    across: Float64 = SIGMA * np.arange(-count, count + 1, dtype=np.float64)
    score = samples.weight @ _log_likelihoods(across - samples.last[:, None], samples)
    score = score + _log_wall(across, wall)
    density = np.exp(score - score.max())
    density /= density.sum()
    mean = float(density @ across)
    median = float(np.interp(0.5, np.cumsum(density) - 0.5 * density, across))
    return median, float(np.sqrt(density @ (across - mean) ** 2 + (SIGMA / UNIFORM_WIDTH) ** 2))


def _log_likelihoods(beyond: Float64, samples: EdgeSamples) -> Float64:
    """Return the log likelihood of edges `beyond` m outside of last samples, float64 (N, X)."""
    gap = np.maximum(samples.gap, SIGMA)[:, None]
    limit = np.where(
        samples.ends[:, None],
        ndtr((gap - beyond) / SIGMA),
        np.exp(-np.maximum(beyond - gap, 0.0) / FADE),
    )
    before = ndtr(beyond / SIGMA) * limit / gap
    at_edge = np.exp(-0.5 * (beyond / SIGMA + OUTERMOST) ** 2) / (np.sqrt(2.0 * np.pi) * SIGMA)
    front = samples.front[:, None]
    outlier = OUTLIER / HALF_RANGE * np.where(beyond > -SIGMA, 1.0, OUTLIER_BEYOND)
    return np.asarray(np.log(outlier + front * at_edge + (1.0 - front) * before), np.float64)


def _log_wall(across: Float64, wall: float | None) -> Float64:
    """Return the log prior of edge positions, given the position `wall` across of a wall, m."""
    if wall is None:
        return np.zeros(len(across))
    away = (across - wall) / EDGE_SIGMA
    peak = WALL_DISTANCE / (np.sqrt(2.0 * np.pi) * EDGE_SIGMA)
    return np.logaddexp(log_ndtr(1.0 - away), np.log(peak) - 0.5 * away**2)
