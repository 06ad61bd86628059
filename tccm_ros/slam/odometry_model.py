"""How far odometry can be trusted: the covariance of a motion, and how long its metre is.

Tyres and calibration make a metre of odometry a few percent more or less. Where walls ahead tell
how far the robot went, matching shows the scale; along corridors that tell nothing, odometry
corrected by it takes over. The scale is estimated by a Kalman filter of one number.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Odometry as OdometryConfig

__all__ = ["OdometryScale", "motion_covariance", "odometry_covariance"]


ODOMETRY_FLOOR = (0.005, 0.003)
"""Standard deviation (m, rad) of odometry that reports no motion: encoder steps and slip."""

START_SIGMA = 0.05
"""Before anything is known."""

DRIFT = 0.001
"""Growth of the standard deviation, per root m: floors differ."""

LEAST_STEP, MOST_TURN = 0.15, 0.25
"""A step shorter (m), or one that turns more (rad), shows no scale."""

GATE = 9.0
"""A step further off, squared and in variances, is a slip."""


def odometry_covariance(delta: Float64, config: OdometryConfig) -> Float64:
    """Return the covariance (3, 3) of (x, y, yaw) of an odometry step, in its end's frame."""
    return motion_covariance(delta, config, ODOMETRY_FLOOR)


def motion_covariance(
    delta: Float64, config: OdometryConfig, floor: tuple[float, float] = (0.0, 0.0)
) -> Float64:
    """Return the part of `odometry_covariance` that grows with the motion, above a floor."""
    distance, turn = float(np.hypot(delta[0], delta[1])), abs(float(delta[2]))
    sigma_xy = floor[0] + config.sigma_per_m * distance
    sigma_yaw = floor[1] + config.sigma_rad_per_rad * turn
    sigma_yaw += config.sigma_rad_per_m * distance
    return np.diag([sigma_xy**2, sigma_xy**2, sigma_yaw**2])


@dataclass(slots=True)
class OdometryScale:
    """The factor `value` that makes odometry's translations true, and its `variance`."""

    value: float = 1.0
    variance: float = START_SIGMA**2

    def corrected(self, delta: Float64) -> Float64:
        """Return a planar motion (3,) with its translation scaled."""
        return delta * np.array([self.value, self.value, 1.0])

    def update(
        self, odometry: Float64, moved: Float64, matched: Float64, odometry_cov: Float64
    ) -> None:
        """Learn from a step between keyframes.

        Parameters
        ----------
        odometry
            Planar motion (3,) as odometry tells it, not corrected.
        moved
            The same motion (3,) as placed, by matching and by corrected odometry together.
        matched
            float64 (3, 3), information of matching alone on (x, y, yaw) in the frame of `moved`.
        odometry_cov
            float64 (3, 3), covariance of `odometry`.
        """
        length = float(np.hypot(odometry[0], odometry[1]))
        self.variance += DRIFT**2 * length
        if length < LEAST_STEP or abs(float(odometry[2])) > MOST_TURN:
            return
        along = np.array([moved[0], moved[1], 0.0]) / max(float(np.hypot(*moved[:2])), 1e-9)
        # A weak prior only makes the inverse exist: 1 m, 1 rad.
        v_match = float(along @ np.linalg.inv(matched + np.eye(3)) @ along)
        v_odometry = float(odometry_cov[0, 0])
        # What matching says alone: `moved` is its mean with odometry, by information.
        placed = float(along @ moved)
        share = v_match / v_odometry
        alone = placed + share * (placed - self.value * length)
        noise = (v_match + v_odometry) / length**2
        innovation = alone / length - self.value
        if innovation**2 > GATE * (noise + self.variance):
            return
        gain = self.variance / (self.variance + noise)
        self.value += gain * innovation
        self.variance *= 1.0 - gain
