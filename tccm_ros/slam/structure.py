"""The structure prior: buildings have walls at right angles, where the data say so."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tccm_ros.slam.factors import Building, Factor, WallDirection, building_key, wall_key
from tccm_ros.slam.walls import WallTable

__all__ = ["structure_factors"]

Float64 = NDArray[np.float64]

LEAST_SUPPORT = 0.6
"""Share of the length of all walls that must agree on one direction (modulo a right angle)."""

NEAR = 0.05
"""Walls within this angle (rad) of that direction are taken to have it."""

SIGMA = 0.006
"""How exactly builders keep it, rad."""


def structure_factors(table: WallTable) -> list[Factor]:
    """Return soft factors that make walls parallel or square; none where few walls are."""
    if len(table) < 3:
        return []
    length = table.extent[:, 1] - table.extent[:, 0]
    mean = np.sum(length * np.exp(4j * table.phi))
    for _ in range(5):
        away = np.angle(np.exp(4j * table.phi) * np.conj(mean) / abs(mean)) / 4.0
        near = np.abs(away) < NEAR
        if not near.any():
            return []
        mean = np.sum((length * np.exp(4j * table.phi))[near])
    if length[near].sum() < LEAST_SUPPORT * length.sum():
        return []
    yaw, key = float(np.angle(mean)) / 4.0, building_key()
    factors: list[Factor] = [Building(key, yaw)]
    for w in map(int, np.flatnonzero(near)):
        quarter = round(float(table.phi[w] - yaw) / (0.5 * np.pi))
        factors.append(WallDirection(key, wall_key(w), quarter * 0.5 * np.pi, SIGMA))
    return factors
