"""The guard of every motion: what is nearer than the margin in level scans or cuboids stops it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely

from tccm_ros.approach.footprint import Footprint
from tccm_ros.approach.senses import Senses
from tccm_ros.approach.speeds import STOP, Limits, Speeds, braked
from tccm_ros.approach.target import Target
from tccm_ros.arrays import Float64
from tccm_ros.geometry import between2, transform2

OWN_M = 0.06
"""What is within this of the surface's outline belongs to it, m: a cube of ~/obstacles is 5 cm."""

OWN_GAPS = 0.3
"""Legs and edge of the surface itself may come as near as this fraction of the gap: the rest is
left for errors of the measured edge."""

FLOOR_M = 0.06
"""Cuboids up to this height are floor, m: a cube of ~/obstacles and its noise."""

NEAR_M = 2.5
"""Obstacles further away do not matter to this step, m: more than any way to brake."""

BLOCKED_M, BLOCKED_RAD = 0.01, math.radians(1.0)
"""A motion that is free for less is blocked."""


@dataclass(frozen=True, slots=True, eq=False)
class Guarded:
    """A motion that was checked.

    Attributes
    ----------
    speeds
        As fast as is safe; `STOP` where it is blocked.
    blocker
        float64 (2,), in odom, what is in the way; None where nothing is.
    """

    speeds: Speeds
    blocker: Float64 | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Obstacles:
    """What is around the base.

    Attributes
    ----------
    points
        float64 (N, 2), in odom, m.
    margins
        float64 (N,), distance that each must keep, m.
    """

    points: Float64
    margins: Float64

    @classmethod
    def of(
        cls, senses: Senses, target: Target | None, margin: float, gap: float, height: float
    ) -> Obstacles:
        """Return the obstacles that are seen.

        Parameters
        ----------
        senses
            Now.
        target
            The surface that is approached, in odom: it may come nearer than the margin.
        margin, gap
            Of other obstacles, and of the surface, m.
        height
            Of the robot, m: higher ones do not matter.
        """
        is_low = (senses.cuboids[:, 2] > FLOOR_M) & (senses.cuboids[:, 2] < height)
        points = np.concatenate([senses.scan, senses.cuboids[is_low, :2]])
        points = points[np.hypot(*(points - senses.pose[:2]).T) < NEAR_M]
        margins = np.full(len(points), margin)
        if target is None:
            return cls(points, margins)
        is_own = shapely.contains_xy(target.polygon.buffer(OWN_M), *points.T)
        # Cuboids of the top spread beyond its edge by half a cube: the outline says where it ends.
        legs = points[is_own][shapely.contains_xy(target.polygon, *points[is_own].T)]
        edge, *_ = target.edge_points()
        points = np.concatenate([points[~is_own], legs, edge])
        margins = np.full(len(points), OWN_GAPS * gap)
        margins[: int((~is_own).sum())] = margin
        return cls(points, margins)

    def others(self, margin: float) -> Float64:
        """Return the points (M, 2) that keep a margin of at least this."""
        return self.points[self.margins >= margin]

    def guard(self, wanted: Speeds, pose: Float64, footprint: Footprint, limits: Limits) -> Guarded:
        """Return a motion as far as it is free.

        Parameters
        ----------
        wanted
            Speeds that are asked for.
        pose
            float64 (3,), of the base when they act, in odom.
        footprint, limits
            Of the base.
        """
        if wanted == STOP or not len(self.points):
            return Guarded(wanted)
        local = transform2(between2(pose, np.zeros(3)), self.points)
        ahead, yaw_rate = wanted
        if ahead:
            way = footprint.free_way(local, self.margins, math.copysign(1.0, ahead))
            if way < BLOCKED_M:
                return Guarded(STOP, self._nearest(local, footprint, math.copysign(1.0, ahead)))
            ahead = braked(math.copysign(way, ahead), abs(ahead), limits.acceleration)
        if yaw_rate:
            brake = yaw_rate * yaw_rate / (2.0 * limits.yaw_acceleration)
            angle = math.copysign(brake + 2.0 * BLOCKED_RAD, yaw_rate)
            free = footprint.free_rotation(local, self.margins, angle)
            if abs(free) < BLOCKED_RAD:
                # Ahead, a yaw_rate only keeps the line: it is left out.
                if not ahead:
                    return Guarded(STOP, self._nearest(local, footprint, 0.0))
                yaw_rate = 0.0
        return Guarded(Speeds(ahead, yaw_rate))

    def _nearest(self, local: Float64, footprint: Footprint, direction: float) -> Float64:
        """Return the point that is nearest to the footprint, ahead of it where that is asked."""
        distances = footprint.distance(local) - self.margins
        distances[direction * local[:, 0] < 0.0] = np.inf
        return self.points[int(distances.argmin())]
