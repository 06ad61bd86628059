"""Line segments from a level scan (surface mapping paper, III.A.1), with full covariance.

Two extractors: the paper's RANSAC, and split and merge, which uses the order of the beams and is an
order of magnitude faster. Both end in the same total-least-squares fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.slam.line_fit import fit_segment
from tccm_ros.slam.line_ransac import ransac_segments
from tccm_ros.slam.line_split import split_segments

__all__ = ["Lines", "extract_lines"]

Float64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """L segments in one frame.

    Attributes
    ----------
    phi, rho
        float64 (L,), rad in (-pi, pi] and m >= 0: ``x cos phi + y sin phi = rho``, where phi points
        from the laser through the line; rho is negative where the frame's origin lies beyond it.
    cov
        float64 (L, 2, 2) of (phi, rho), with their correlation.
    endpoints
        float64 (L, 2, 2), m: first and last along the tangent (-sin phi, cos phi).
    count
        int64 (L,), beams.
    """

    phi: Float64
    rho: Float64
    cov: Float64
    endpoints: Float64
    count: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.phi)

    @property
    def length(self) -> Float64:
        """Distance between the endpoints, float64 (L,), m."""
        return np.hypot(*(self.endpoints[:, 1] - self.endpoints[:, 0]).T)


def extract_lines(beams: Float64, origin: Float64, config: Config) -> Lines:
    """Find the line segments of a scan.

    Parameters
    ----------
    beams
        float64 (B, 2), m, valid points in beam order.
    origin
        float64 (2,), the laser.
    config
        ``lines.*`` and ``matching.range_sigma``.
    """
    x = config.lines
    sigma = config.matching.range_sigma
    limits = x.distance, x.max_gap, x.min_points, x.min_length, x.trials
    beams = np.ascontiguousarray(beams, np.float64)
    return Lines(*_extract(beams, origin, sigma, x.extractor == "ransac", limits))


@njit(nogil=True, cache=True)
def _extract(
    beams: Float64,
    origin: Float64,
    sigma: float,
    ransac: bool,
    limits: tuple[float, float, int, float, int],
) -> tuple[Float64, Float64, Float64, Float64, NDArray[np.int64]]:  # pragma: no cover - compiled
    """Return the fields of `Lines`: from beams to covariances in one compiled call."""
    distance, max_gap, min_points, min_length, trials = limits
    if ransac:
        labels = ransac_segments(beams, distance, max_gap, min_points, min_length, trials)
    else:
        labels = split_segments(beams, distance, max_gap, min_points)
    rows = _fit_all(beams, labels, origin, sigma, min_points, min_length)
    n = len(rows)
    cov, endpoints, count = np.empty((n, 2, 2)), np.empty((n, 2, 2)), np.empty(n, np.int64)
    for k in range(n):
        cov[k, 0, 0], cov[k, 1, 1] = rows[k, 2], rows[k, 4]
        cov[k, 0, 1] = cov[k, 1, 0] = rows[k, 3]
        endpoints[k, 0, 0], endpoints[k, 0, 1] = rows[k, 5], rows[k, 6]
        endpoints[k, 1, 0], endpoints[k, 1, 1] = rows[k, 7], rows[k, 8]
        count[k] = int(rows[k, 9])
    return rows[:, 0].copy(), rows[:, 1].copy(), cov, endpoints, count


@njit(nogil=True, cache=True)
def _fit_all(
    beams: Float64,
    labels: NDArray[np.int32],
    origin: Float64,
    sigma: float,
    min_points: int,
    min_length: float,
) -> Float64:  # pragma: no cover - compiled
    """Fit every label's points; rows of phi, rho, v_phi, c, v_rho, x0, y0, x1, y1, count."""
    total = 0
    for i in range(len(labels)):
        total = max(total, labels[i] + 1)
    rows = np.zeros((total, 10))
    sums = np.zeros((total, 2))
    members = np.zeros(total, np.int64)
    for i in range(len(labels)):
        if labels[i] >= 0:
            members[labels[i]] += 1
    starts = np.zeros(total + 1, np.int64)
    for k in range(total):
        starts[k + 1] = starts[k] + members[k]
    points = np.empty((starts[total], 2))
    fill = starts[:-1].copy()
    for i in range(len(labels)):
        if labels[i] >= 0:
            to = fill[labels[i]]
            points[to, 0], points[to, 1] = beams[i, 0], beams[i, 1]
            fill[labels[i]] += 1
    count = 0
    for k in range(len(sums)):
        if members[k] < min_points:
            continue
        row = rows[count]
        fit_segment(points[starts[k] : starts[k + 1]], origin, sigma, row)
        if np.hypot(row[7] - row[5], row[8] - row[6]) >= min_length:
            count += 1
    return rows[:count]
