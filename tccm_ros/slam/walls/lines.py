"""Line extraction from level scans (surface mapping paper, III.A.1), with full covariance.

Split and merge labels the beams of each segment: it uses the order of the beams and is an order of
magnitude faster than the paper's RANSAC, which is in `baselines.line_ransac`. Both labellings use
the same total-least-squares fit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from tccm_ros.arrays import Float64, Int32, Int64
from tccm_ros.config import Config
from tccm_ros.slam.matching.level_scan import point_sigma
from tccm_ros.slam.walls.line_curves import curved_segments
from tccm_ros.slam.walls.line_fit import fit_segments
from tccm_ros.slam.walls.line_split import split_segments

MIN_PIECE = 4
"""Minimum number of points of a piece for curve detection: two more than the parameters of a
line."""

LabelBeams = Callable[[Float64, Config], Int32]
"""Function that returns the segment of each beam, int32 (B,), or -1, for beams float64 (B, 2),
m."""


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """L segments in one frame.

    Attributes
    ----------
    phi, rho
        float64 (L,), rad in (-pi, pi] and m: ``x cos phi + y sin phi = rho``, where phi points from
        the laser through the line; rho is negative if the frame's origin is beyond it.
    cov
        float64 (L, 2, 2) of (phi, rho), with their correlation.
    endpoints
        float64 (L, 2, 2), m: first and last along the tangent (-sin phi, cos phi).
    count
        int64 (L,), number of beams.
    """

    phi: Float64
    rho: Float64
    cov: Float64
    endpoints: Float64
    count: Int64

    def __len__(self) -> int:
        return len(self.phi)


NO_LINES = Lines(
    np.zeros(0), np.zeros(0), np.zeros((0, 2, 2)), np.zeros((0, 2, 2)), np.zeros(0, np.int64)
)


def label_by_splitting(beams: Float64, config: Config) -> Int32:
    """Label the beams of each segment by split and merge; pieces of curves get none."""
    x = config.lines
    # Pieces that are too short for a line still contribute to the detection of curves.
    labels = split_segments(beams, x.distance, x.max_gap, min(MIN_PIECE, x.min_points))
    # Lines of one wall are within the gate from its direction, on either side.
    curved = curved_segments(beams, labels, x.max_gap, 2.0 * config.walls.gate_angle)
    return np.where(np.append(curved, True)[labels], np.int32(-1), labels)


def extract_lines(
    beams: Float64, origin: Float64, config: Config, label: LabelBeams = label_by_splitting
) -> Lines:
    """Return the line segments of a scan.

    Parameters
    ----------
    beams
        float64 (B, 2), m, valid points in beam order.
    origin
        float64 (2,), position of the laser.
    config
        Group ``lines``, and as in `point_sigma`.
    label
        Function that assigns beams to segments.
    """
    x = config.lines
    beams = np.ascontiguousarray(beams, np.float64)
    sigma = point_sigma(config)
    segments = fit_segments(beams, label(beams, config), origin, sigma, x.min_points, x.min_length)
    return Lines(*(segments[field.name].copy() for field in fields(Lines)))


def line_covariance(lines: Lines, i: int, config: Config, roughness: float = 0.0) -> Float64:
    """Return the covariance (2, 2) of (phi, rho) of line i as an observation of its wall.

    Matching has used the same beams, so that the errors of both are correlated. Two estimates with
    unknown correlation are combined by covariance intersection with equal weights: the covariance
    of a line is doubled (``walls.discount``). The flatness of real walls is added: that of this
    wall, `roughness` (m), or that of all (``walls.flatness``), whichever is larger. Over a segment
    of length L, a smooth deviation of one sigma shifts its centre by sigma and rotates it by about
    sqrt(12) sigma / L.
    """
    a, b = lines.endpoints[i]
    length2 = float(np.sum((b - a) ** 2))
    tangent = np.array([-np.sin(lines.phi[i]), np.cos(lines.phi[i])])
    yc = float(tangent @ (0.5 * (a + b)))
    variance = max(config.walls.flatness, roughness) ** 2
    v_phi = 12.0 * variance / max(length2, 1e-6)
    flatness = np.array([[v_phi, yc * v_phi], [yc * v_phi, variance + yc * yc * v_phi]])
    return lines.cov[i] * config.walls.discount + flatness
