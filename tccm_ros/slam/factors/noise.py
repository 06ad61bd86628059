"""Noise models, and covariances in the tangent order of GTSAM."""

from __future__ import annotations

import gtsam
import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.slam.factors.keys import rotation_z

PLANAR_SIGMA = 1e-5
"""Standard deviation of roll, pitch (rad) and z (m) of a keyframe: negligible, but numerically
stable (chosen)."""

OPEN_SIGMA = 1e3
"""Standard deviation (m, rad) of a component that a factor does not measure (chosen)."""

FREE_POSITION_SIGMA = 1e6
"""Standard deviation of an unknown position of a keyframe in map, m: maps are large (chosen)."""

LOOSE_SIGMA = 1.0
"""Standard deviation (m, rad) of a component that another factor holds at zero (chosen)."""

PLANAR_ORDER = [3, 4, 2]
"""Indices of x, y and yaw in GTSAM's order (roll, pitch, yaw, x, y, z)."""

Z_ROLL_PITCH = [5, 0, 1]
"""Indices of z, roll and pitch in GTSAM's order (roll, pitch, yaw, x, y, z)."""

HUBER_K = 1.345
"""Huber threshold in standard deviations: 95 % efficiency for Gaussian noise (the usual choice)."""


def gaussian(covariance: Float64) -> gtsam.noiseModel.Gaussian:
    """Return the noise model of a covariance (N, N)."""
    return gtsam.noiseModel.Gaussian.Covariance(np.asarray(covariance, float))


def huber(noise: gtsam.noiseModel.Base) -> gtsam.noiseModel.Robust:
    """Return a robust noise model, which bounds the influence of a residual."""
    return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(HUBER_K), noise)


def planar_covariance(cov_xyyaw: Float64, z_roll_pitch: tuple[float, float, float]) -> Float64:
    """Extend a covariance of (x, y, yaw) to GTSAM's (roll, pitch, yaw, x, y, z).

    Parameters
    ----------
    cov_xyyaw
        float64 (3, 3), m and rad.
    z_roll_pitch
        Standard deviations of z (m), roll and pitch (rad).
    """
    cov = np.zeros((6, 6))
    cov[np.ix_(PLANAR_ORDER, PLANAR_ORDER)] = cov_xyyaw
    cov[Z_ROLL_PITCH, Z_ROLL_PITCH] = np.square(z_roll_pitch)
    return cov


def rotate_frame(cov_xyyaw: Float64, yaw: float) -> Float64:
    """Express a covariance of (x, y, yaw) in a frame that is rotated by `yaw` (rad) about z."""
    R = rotation_z(yaw)[:3, :3]
    return R.T @ np.asarray(cov_xyyaw, float) @ R
