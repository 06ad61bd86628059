"""An accelerometer fixed to the base: the specific force with bias and noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from tccm_ros.arrays import Float64

GRAVITY = 9.80665
"""Standard gravity, m/s2."""


@dataclass(frozen=True)
class Accelerometer:
    """An IMU's accelerometer, with the axes of the base.

    Attributes
    ----------
    bias
        Bias along x, y and z, m/s2. Chosen: 2 deg of the vertical, a typical error of a cheap
        uncalibrated one.
    sigma
        Standard deviation of a sample, m/s2.
    """

    bias: tuple[float, float, float] = (0.2, -0.3, 0.1)
    sigma: float = 0.05


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


def measure_forces(accelerometer: Accelerometer, exact: Float64, random: Generator) -> Float64:
    """Return measurements of specific forces (N, 3), float64 (N, 3), m/s2."""
    noise = accelerometer.sigma * random.standard_normal(exact.shape)
    return exact + np.array(accelerometer.bias) + noise
