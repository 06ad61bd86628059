"""An IMU fixed to the base, with its axes: angular velocities and specific forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from tccm_ros.arrays import Float64

GRAVITY = 9.80665
"""Standard gravity, m/s2."""


@dataclass(frozen=True)
class ImuModel:
    """Period, bias and noise of an IMU.

    Attributes
    ----------
    period
        Time between samples, s.
    rate_bias, rate_sigma
        Rates measured at rest about x, y and z, and standard deviation of a sample, rad/s.
    force_bias, force_sigma
        Bias along x, y and z, and standard deviation of a sample, m/s2. Chosen: 2 deg of the
        vertical, a typical error of a cheap uncalibrated accelerometer.
    """

    period: float = 0.01
    rate_bias: tuple[float, float, float] = (0.004, -0.006, 0.008)
    rate_sigma: float = 0.002
    force_bias: tuple[float, float, float] = (0.2, -0.3, 0.1)
    force_sigma: float = 0.05

    def measure_rates(self, exact: Float64, random: Generator) -> Float64:
        """Return measurements of angular velocities (N, 3), float64 (N, 3), rad/s."""
        noise = self.rate_sigma * random.standard_normal(exact.shape)
        return exact + np.array(self.rate_bias) + noise

    def measure_forces(self, exact: Float64, random: Generator) -> Float64:
        """Return measurements of specific forces (N, 3), float64 (N, 3), m/s2."""
        noise = self.force_sigma * random.standard_normal(exact.shape)
        return exact + np.array(self.force_bias) + noise


def angular_velocities(T_world_base: Float64, seconds: float) -> Float64:
    """Return the mean angular velocities between poses, float64 (N - 1, 3), rad/s.

    Parameters
    ----------
    T_world_base
        float64 (N, 4, 4), at intervals of `seconds`, with little rotation between two poses.
    seconds
        Interval, s.
    """
    R = T_world_base[:, :3, :3]
    turned = np.swapaxes(R[:-1], 1, 2) @ R[1:]
    vee = turned[:, [2, 0, 1], [1, 2, 0]] - turned[:, [1, 2, 0], [2, 0, 1]]
    return np.asarray(vee / (2.0 * seconds))


def specific_forces(T_world_base: Float64, seconds: float) -> Float64:
    """Return the specific forces at all poses except the first and the last, float64 (N - 2, 3).

    Parameters
    ----------
    T_world_base
        float64 (N, 4, 4), at intervals of `seconds`.
    seconds
        Interval, s.

    Returns
    -------
    m/s2, along the axes of the base: its acceleration minus gravity; at rest it points up.
    """
    positions, R = T_world_base[:, :3, 3], T_world_base[1:-1, :3, :3]
    forces = np.diff(positions, 2, axis=0) / seconds**2
    forces[:, 2] += GRAVITY
    return np.asarray(np.einsum("nij,ni->nj", R, forces))
