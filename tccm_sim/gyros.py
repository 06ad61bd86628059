"""A gyroscope fixed to the base: rates with bias and noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from tccm_ros.arrays import Float64


@dataclass(frozen=True)
class Gyro:
    """An IMU's gyroscope, with the axes of the base.

    Attributes
    ----------
    period
        Time between samples, s.
    bias
        Rates measured at rest, rad/s about x, y and z.
    sigma
        Standard deviation of a sample, rad/s.
    """

    period: float = 0.01
    bias: tuple[float, float, float] = (0.004, -0.006, 0.008)
    sigma: float = 0.002


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


def measure_rates(gyro: Gyro, exact: Float64, random: Generator) -> Float64:
    """Return measurements of angular velocities (N, 3), float64 (N, 3), rad/s."""
    return exact + np.array(gyro.bias) + gyro.sigma * random.standard_normal(exact.shape)
