"""Odometry model: the covariance of a motion, and the scale of its translations.

Tyres and calibration make a metre of odometry a few percent more or less. Where walls ahead
determine the motion, matching shows the scale; along corridors, where they do not, odometry is
corrected by it. The scale is estimated by a Kalman filter with one state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config.slam import Odometry as OdometryConfig

ODOMETRY_FLOOR = (0.005, 0.003)
"""Standard deviation (m, rad) of odometry that reports no motion: encoder steps and slip
(chosen)."""

GYRO_FLOOR, GYRO_SCALE, GYRO_BIAS = 0.001, 0.01, 0.001
"""Standard deviation of a yaw by a gyroscope: at rest (rad), by the yaw (1) and by the time
(rad/s), as its bias has drifted since it was learnt (chosen, in the range of MEMS gyroscopes)."""

SCALE_SIGMA = 0.05
"""Standard deviation of the scale before the first step (chosen)."""

SCALE_DRIFT = 0.001
"""Growth of the scale's standard deviation, per root m: floors differ (chosen)."""

MIN_STEP, MAX_YAW = 0.15, 0.25
"""A step that is shorter (m), or has a larger yaw (rad), is not used for the scale (chosen)."""

MAX_VARIANCE_RATIO = 16.0
"""A step is not used for the scale where matching knows its length with more than this many times
the variance of odometry: along a plain corridor, the length is odometry's own (chosen)."""

GATE_CHI2 = 9.0
"""Gate for the squared innovation over its variance, beyond which wheels have slipped. Chosen:
three standard deviations, 99.7 % of one degree of freedom."""


def odometry_covariance(delta: Float64, config: OdometryConfig) -> Float64:
    """Return the covariance (3, 3) of (x, y, yaw) of an odometry step, in its end's frame."""
    return motion_covariance(delta, config, ODOMETRY_FLOOR)


def gyro_yaw_variance(yaw: float, seconds: float) -> float:
    """Return the variance, rad2, of a yaw (rad) that a gyroscope has measured in a time (s)."""
    sigma = GYRO_FLOOR + GYRO_SCALE * abs(yaw) + GYRO_BIAS * seconds
    return sigma**2


def motion_covariance(
    delta: Float64, config: OdometryConfig, floor: tuple[float, float] = (0.0, 0.0)
) -> Float64:
    """Return the covariance of a motion, without the noise of odometry at rest.

    Parameters
    ----------
    delta
        float64 (3,), planar motion, m and rad.
    config
        ``odometry.*``: growth of the standard deviations.
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
        True length over odometry's.
    variance
        Of `value`, as the filter weighs it: wide, so that wheels of any size are learnt soon.
    error_variance
        Of `value` against the truth for wheels as they are expected (``odometry.sigma_scale``).
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
            float64 (3,), planar motion by odometry, not corrected.
        moved
            float64 (3,), the same motion by matching and corrected odometry together.
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
        # A weak prior only makes the inverse exist: 1 m, 1 rad.
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
        # Joseph's form: right for any gain, also one that expects more than this variance.
        self.error_variance = (1.0 - gain) ** 2 * self.error_variance + gain**2 * noise
