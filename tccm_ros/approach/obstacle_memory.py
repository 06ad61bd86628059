"""Memory of obstacles beside and behind the base, which the integration map forgets.

`~/obstacles` contains the last `map.window_cycles` tilt cycles: a table behind the base is soon
missing in it, and level scans see only its legs.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.approach.guard import NEAR_M
from tccm_ros.approach.readings import TopCycle
from tccm_ros.arrays import Bool, Float64, Int64

BEARING_RAD = np.radians(3.0)
"""Width of the bearing bins of a field of view, rad: an obstacle's cube of 5 cm at 1 m."""

BINS = round(2.0 * np.pi / BEARING_RAD)


class ObstacleMemory:
    """The newest obstacles, and older ones that were not in the field of view since.

    Parameters
    ----------
    cube_m
        Edge length of the cubes, m.

    Attributes
    ----------
    points
        float64 (N, 3) in odom, as `Readings.obstacle_points`.
    """

    def __init__(self, cube_m: float):
        self._cube_m = cube_m
        self._newest = self._older = self.points = np.zeros((0, 3))

    def add(self, obstacles: Float64, base: Float64) -> None:
        """Add the newest obstacles (N, 3) in odom; drop older ones far from the base at (2,)."""
        older = np.concatenate([self._older, self._newest])
        older = older[np.hypot(*(older[:, :2] - base).T) < NEAR_M]
        places = np.round(older / (0.5 * self._cube_m)).astype(np.int64)
        self._older = older[np.unique(places, axis=0, return_index=True)[1]]
        self._newest = obstacles
        self.points = np.concatenate([self._newest, self._older])

    def forget_visible(self, cycle: TopCycle) -> None:
        """Forget older obstacles in the field of view of a tilt cycle."""
        self._older = self._older[~_is_visible(cycle, self._older)]
        self.points = np.concatenate([self._newest, self._older])


def _is_visible(cycle: TopCycle, points: Float64) -> Bool:
    """Return which points (N, 3) are in a cycle's field of view.

    In each direction it is assumed to extend from the cycle's lowest beam up to the horizon.
    """
    steepest = np.full(BINS, -np.inf)
    np.maximum.at(steepest, *_directions(cycle.points - cycle.sensor))
    bins, depressions = _directions(points - cycle.sensor)
    return np.asarray(depressions <= steepest[bins])


def _directions(rays: Float64) -> tuple[Int64, Float64]:
    """Return the bearing bins and the depression angles, rad, of rays (N, 3)."""
    x, y, z = rays.T
    bins = np.floor(np.arctan2(y, x) / BEARING_RAD).astype(np.int64) % BINS
    return bins, np.arctan2(-z, np.hypot(x, y))
