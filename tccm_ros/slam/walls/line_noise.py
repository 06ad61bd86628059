"""Covariance of a wall observation by a line of one scan."""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.slam.walls.lines import Lines


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
