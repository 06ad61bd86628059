"""Line segments from a level scan (surface mapping paper, III.A.1), with full covariance.

Two extractors: the paper's RANSAC, and split and merge, which uses the order of the beams and is an
order of magnitude faster. Both end in the same total-least-squares fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.config import Config
from tccm_ros.slam.line_fit import fit_segments
from tccm_ros.slam.line_ransac import ransac_segments
from tccm_ros.slam.line_split import split_segments

__all__ = ["Lines", "extract_lines"]


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
    count: Int64

    def __len__(self) -> int:
        return len(self.phi)


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
    beams = np.ascontiguousarray(beams, np.float64)
    if x.extractor == "ransac":
        labels = ransac_segments(beams, x.distance, x.max_gap, x.min_points, x.min_length, x.trials)
    else:
        labels = split_segments(beams, x.distance, x.max_gap, x.min_points)
    sigma = config.matching.range_sigma
    segments = fit_segments(beams, labels, origin, sigma, x.min_points, x.min_length)
    return Lines(
        segments["phi"].copy(),
        segments["rho"].copy(),
        segments["cov"].copy(),
        segments["endpoints"].copy(),
        segments["count"].copy(),
    )
