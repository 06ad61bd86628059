"""The floor plan: walls as lines whose corners are closed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tccm_ros.records import Wall

__all__ = ["close_corners"]

Float64 = NDArray[np.float64]

LEAST_ANGLE = np.radians(15.0)
"""Walls nearer to parallel than this have no corner."""

REACH = 0.6
"""A wall is drawn longer or shorter by this much, m, at most, to meet its neighbour."""


def close_corners(walls: Sequence[Wall]) -> list[Float64]:
    """Return the ends (2, 2) of each wall, moved onto the corners it shares with others.

    Walls know the walls that share an endpoint with them; both are drawn to the point where their
    lines cross.
    """
    by_id = {wall.id: wall for wall in walls}
    ends = {wall.id: np.array(wall.endpoints, float) for wall in walls}
    for wall in walls:
        for other in (by_id[k] for k in wall.corners if k in by_id):
            corner = _crossing(wall, other)
            if corner is None:
                continue
            near = int(np.argmin(np.linalg.norm(wall.endpoints - corner, axis=1)))
            if np.linalg.norm(wall.endpoints[near] - corner) <= REACH:
                ends[wall.id][near] = corner
    return [ends[wall.id] for wall in walls]


def _crossing(a: Wall, b: Wall) -> Float64 | None:
    """Return where two lines x cos phi + y sin phi = rho cross; None where they are parallel."""
    N = np.array([[np.cos(a.phi), np.sin(a.phi)], [np.cos(b.phi), np.sin(b.phi)]])
    if abs(np.linalg.det(N)) < np.sin(LEAST_ANGLE):
        return None
    return np.linalg.solve(N, np.array([a.rho, b.rho]))
