"""Odometry model: covariance of a motion, and scale of its translations.

Tyres and calibration cause a scale error of a few percent. Matching observes the scale where walls
ahead determine the motion, and corrects odometry along corridors, where they do not. The scale is
estimated by a Kalman filter with one state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config.slam import OdometryConfig

ODOMETRY_FLOOR = (0.005, 0.003)
"""Standard deviation (m, rad) of odometry at rest: encoder steps and slip (chosen)."""

GYRO_FLOOR, GYRO_SCALE, GYRO_BIAS = 0.001, 0.01, 0.001
"""Standard deviation of a gyroscope yaw: constant (rad), per yaw (1), and per time (rad/s), as the
bias drifts after its estimation (chosen, in the range of MEMS gyroscopes)."""

SCALE_SIGMA = 0.05
"""Initial standard deviation of the scale (chosen)."""

SCALE_DRIFT = 0.001
"""Growth of the scale's standard deviation, per root m: floors differ (chosen)."""

MIN_STEP, MAX_YAW = 0.15, 0.25
"""Minimum length (m) and maximum yaw (rad) of a step for the scale estimate (chosen)."""

MAX_VARIANCE_RATIO = 16.0
"""Maximum ratio of the variance of a step's length by matching to that by odometry, for the scale
estimate: along a plain corridor, matching does not observe the length (chosen)."""

GATE_CHI2 = 9.0
"""Gate on the squared normalised innovation, beyond which wheels have slipped. Chosen: three
standard deviations, 99.7 % of one degree of freedom."""


def odometry_covariance(delta: Float64, config: OdometryConfig) -> Float64:
    """Return the covariance (3, 3) of (x, y, yaw) of an odometry step, in the frame of its end."""
    return motion_covariance(delta, config, ODOMETRY_FLOOR)


def gyro_yaw_variance(yaw: float, seconds: float) -> float:
    """Return the variance, rad2, of a gyroscope yaw (rad) over a time (s)."""
    sigma = GYRO_FLOOR + GYRO_SCALE * abs(yaw) + GYRO_BIAS * seconds
    return sigma**2


def motion_covariance(
    delta: Float64, config: OdometryConfig, floor: tuple[float, float] = (0.0, 0.0)
) -> Float64:
    """Return the covariance of a motion; without `floor`, a motion of zero has none.

    Parameters
    ----------
    delta
        float64 (3,), planar motion, m and rad.
    config
        Group ``odometry``: growth of the standard deviations.
    floor
        Standard deviation (m, rad) of a motion of zero.

    Returns
    -------
    float64 (3, 3), diagonal, of (x, y, yaw) in the frame of the motion's end
    """
    distance, yaw = float(np.hypot(delta[0], delta[1])), abs(float(delta[2]))
    sigma_xy = floor[0] + config.sigma_per_m * distance
    sigma_yaw = floor[1] + config.sigma_rad_per_rad * yaw
    sigma_yaw += config.sigma_rad_per_m * distance
    return np.diag([sigma_xy**2, sigma_xy**2, sigma_yaw**2])


@dataclass(slots=True)
class OdometryScale:
    """Kalman filter of the scale of odometry's translations.

    Attributes
    ----------
    value
        True length over odometry's length.
    variance
        Filter variance of `value`: wide, so that wheels of any size are learnt quickly.
    error_variance
        Error variance of `value` for wheels with the expected error (``odometry.sigma_scale``).
    """

    value: float = 1.0
    variance: float = SCALE_SIGMA**2
    error_variance: float = 0.0

    def corrected(self, delta: Float64) -> Float64:
        """Return a planar motion (3,) with its translation scaled."""
        return delta * np.array([self.value, self.value, 1.0])

    def update(
        self, odometry: Float64, moved: Float64, matched: Float64, odometry_cov: Float64
    ) -> None:
        """Update the scale by a step between keyframes.

        Parameters
        ----------
        odometry
            float64 (3,), planar motion by odometry, uncorrected.
        moved
            float64 (3,), the same motion by matching combined with corrected odometry.
        matched
            float64 (3, 3), information of matching alone on (x, y, yaw) in the frame of `moved`.
        odometry_cov
            float64 (3, 3), covariance of `odometry`.
        """
        length = float(np.hypot(odometry[0], odometry[1]))
        self.variance += SCALE_DRIFT**2 * length
        self.error_variance += SCALE_DRIFT**2 * length
        if length < MIN_STEP or abs(float(odometry[2])) > MAX_YAW:
            return
        along = np.array([moved[0], moved[1], 0.0]) / max(float(np.hypot(*moved[:2])), 1e-9)
        # A weak prior of 1 m, 1 rad makes the matrix invertible.
        v_match = float(along @ np.linalg.inv(matched + np.eye(3)) @ along)
        v_odometry = float(odometry_cov[0, 0])
        if v_match > MAX_VARIANCE_RATIO * v_odometry:
            return
        # The length by matching alone: `moved` is its mean with odometry, weighted by information.
        length_moved = float(along @ moved)
        ratio = v_match / v_odometry
        by_matching = length_moved + ratio * (length_moved - self.value * length)
        noise = (v_match + v_odometry) / length**2
        innovation = by_matching / length - self.value
        if innovation**2 > GATE_CHI2 * (noise + self.variance):
            return
        gain = self.variance / (self.variance + noise)
        self.value += gain * innovation
        self.variance *= 1.0 - gain
        # Joseph form: valid for any gain, also one from a larger assumed variance.
        self.error_variance = (1.0 - gain) ** 2 * self.error_variance + gain**2 * noise
