"""The position of an edge, from where the samples of a surface end before it.

Scan lines and beams sample a surface at a distance. The last sample before an edge lies anywhere
within one such distance of it, with noise: an interval for the edge. Several views intersect their
intervals, so that the edge is known better than the sampling of each.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr, logsumexp, ndtr

from tccm_ros.arrays import Bool, Float64

STEP = 0.003
"""Distance of the positions that are compared, m; chosen: below the noise of a range."""

HALF_RANGE = 0.15
"""Positions are compared up to this from the first guess, m; chosen."""

SIGMA = 0.006
"""Standard deviation of a last sample, m: noise of range, of the pose, thinning; chosen."""

OUTLIER = 0.05
"""Fraction of last samples that have nothing to do with the edge, but are anywhere within
`HALF_RANGE`: an object stands before it; chosen."""

OUTLIER_BEFORE_FRONT = 0.10
"""The same where the edge faces the view: what stands on it, as the panel beside a shelf, hides the
surface behind it; chosen: twice."""

OUTLIER_BEYOND = 0.2
"""Samples that are further out than the edge are so many times less frequent: mixed pixels, points
of a wall; chosen."""

OUTERMOST = 0.56
"""The last sample is the outermost of at least two of a front: so many `SIGMA` further out than the
front. The mean of the larger one of two normal variables, 1 / sqrt(pi)."""

FADE = 0.06
"""Where a view did not look past the last sample, the surface may go on: a density that falls by a
factor of e over this, m. Of 0.03, 0.06, 0.12 and 0.24, this one gives the best outlines (mean
overlap .925, .927, .927, .924 on bags/flat, .919, .920, .913, .906 on bags/rgbd_kitchen)."""

INDEPENDENT = 8.0
"""The samples of one view share its pose: they count as at most this many; chosen."""

WALL_SIGMA = 0.005
"""Standard deviation of an edge that touches a wall, m; chosen: the wall is known better."""

WALL_ODDS = 0.1
"""An edge before a wall is as likely at the wall as anywhere within this, m; chosen."""


class EdgeSamples(NamedTuple):
    """The last samples before an edge, of all views, one for each short piece of the edge.

    Attributes
    ----------
    at
        float64 (N,), position along the edge, m.
    last
        float64 (N,), how far across the last sample is, outwards, m.
    gap
        float64 (N,), distance to where the next sample would be, m.
    front
        float64 (N,), how probable it is that the last sample is of the front below the edge, and so
        at the edge: 0 to 1.
    ends
        bool (N,), whether the view looked past the surface there.
    weight
        float64 (N,), 0 to 1.
    """

    at: Float64
    last: Float64
    gap: Float64
    front: Float64
    ends: Bool
    weight: Float64


def locate_edge(samples: EdgeSamples, wall: float | None = None) -> tuple[float, float]:
    """Return how far across an edge is, the median, and its standard deviation, m.

    Parameters
    ----------
    samples
        Across 0 is the first guess.
    wall
        Where a wall bounds the edge, across, m; None: none is near.
    """
    across = _positions(HALF_RANGE)
    score = samples.weight @ _log_likelihoods(across - samples.last[:, None], samples)
    score = score + _log_wall(across, wall)
    density = np.exp(score - score.max())
    density /= density.sum()
    mean = float(density @ across)
    median = float(np.interp(0.5, np.cumsum(density) - 0.5 * density, across))
    return median, float(np.sqrt(density @ (across - mean) ** 2 + STEP**2 / 12.0))


def rotation_scores(
    samples: EdgeSamples, middle: float, rotations: Float64, wall: float | None = None
) -> Float64:
    """Return the log likelihood of rotations of an edge, wherever it is then, float64 (R,).

    Parameters
    ----------
    samples
        At least one; across 0 is the first guess.
    middle
        Position along the edge about which it is rotated, m.
    rotations
        float64 (R,), rad; a positive one moves an edge outwards at its start.
    wall
        As in `locate_edge`.
    """
    across = _positions(HALF_RANGE)
    shifts = np.rint(rotations[:, None] * (samples.at - middle) / STEP).astype(np.int64)
    margin = int(np.abs(shifts).max(initial=0))
    beyond = _positions(HALF_RANGE + margin * STEP) - samples.last[:, None]
    of_sample = samples.weight[:, None] * _log_likelihoods(beyond, samples)
    windows = np.lib.stride_tricks.sliding_window_view(of_sample, len(across), axis=1)
    rows = np.arange(len(samples.at))
    score = np.stack([windows[rows, margin - shift].sum(axis=0) for shift in shifts])
    score += _log_wall(across, wall)
    return np.asarray(logsumexp(score, axis=1), np.float64)


def _positions(half_range: float) -> Float64:
    """Return positions across an edge, each `STEP`, m, the same distance to both sides."""
    count = round(half_range / STEP)
    return np.asarray(STEP * np.arange(-count, count + 1), np.float64)


def _log_likelihoods(beyond: Float64, samples: EdgeSamples) -> Float64:
    """Return the log likelihood of an edge so far beyond last samples, float64 (N, X), m."""
    gap = np.maximum(samples.gap, SIGMA)[:, None]
    limit = np.where(
        samples.ends[:, None],
        ndtr((gap - beyond) / SIGMA),
        np.exp(-np.maximum(beyond - gap, 0.0) / FADE),
    )
    before = ndtr(beyond / SIGMA) * limit / gap
    at_edge = np.exp(-0.5 * (beyond / SIGMA + OUTERMOST) ** 2) / (np.sqrt(2.0 * np.pi) * SIGMA)
    front = samples.front[:, None]
    outlier = np.where(front > 0.0, OUTLIER_BEFORE_FRONT, OUTLIER) / HALF_RANGE
    outlier = outlier * np.where(beyond > -SIGMA, 1.0, OUTLIER_BEYOND)
    return np.asarray(np.log(outlier + front * at_edge + (1.0 - front) * before), np.float64)


def _log_wall(across: Float64, wall: float | None) -> Float64:
    """Return the log likelihood of an edge before or at a wall that is so far across, m."""
    if wall is None:
        return np.zeros(len(across))
    away = (across - wall) / WALL_SIGMA
    peak = WALL_ODDS / (np.sqrt(2.0 * np.pi) * WALL_SIGMA)
    return np.logaddexp(log_ndtr(1.0 - away), np.log(peak) - 0.5 * away**2)
