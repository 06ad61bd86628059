"""Collision guard: limits each command so that the base keeps its margin from obstacles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely

from tccm_ros.approach.footprint import Footprint
from tccm_ros.approach.readings import Readings
from tccm_ros.approach.speeds import HOLD_S, STOP, SpeedLimits, Speeds, safe_speed
from tccm_ros.approach.target import Target
from tccm_ros.arrays import Float64
from tccm_ros.geometry import between2, transform2

OWN_GAPS = 0.3
"""Margin of the surface's own legs and edge, as a fraction of the gap: the rest allows for errors
of the measured edge."""

FLOOR_M = 0.06
"""Cuboids up to this height are floor, m: a cube of ~/obstacles and its noise."""

NEAR_M = 2.5
"""Obstacles further away are ignored, m: more than any braking distance."""

RIM = np.array([[math.cos(a), math.sin(a)] for a in np.arange(8) * math.pi / 4.0])
"""Directions to the points of an obstacle's rim: cells of 5 cm between them are not skipped."""

BLOCKED_M, BLOCKED_RAD = 0.01, math.radians(1.0)
"""A motion is blocked where less than this is free."""


@dataclass(frozen=True, slots=True, eq=False)
class Guarded:
    """A motion after the collision check.

    Attributes
    ----------
    speeds
        Safe velocities; `STOP` where the motion is blocked.
    blocker
        float64 (2,), the blocking obstacle, in odom; None if the motion is free.
    """

    speeds: Speeds
    blocker: Float64 | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Obstacles:
    """Obstacles around the base, as discs.

    Attributes
    ----------
    points
        float64 (N, 2), their middles, in odom, m.
    radii
        float64 (N,), m; 0 for a measured point.
    margins
        float64 (N,), minimum distance of the footprint from each disc, m.
    """

    points: Float64
    radii: Float64
    margins: Float64

    @classmethod
    def of(
        cls, readings: Readings, target: Target | None, margin: float, gap: float, height: float
    ) -> Obstacles:
        """Return the obstacles in the newest measurements.

        Parameters
        ----------
        readings
            Newest measurements.
        target
            The approached surface, in odom: its margin is smaller. None: there is none.
        margin, gap
            Margin of other obstacles, and the gap to the surface, m.
        height
            Height of the robot, m: higher obstacles are ignored.
        """
        cubes = readings.obstacle_points
        is_low = (cubes[:, 2] > FLOOR_M) & (cubes[:, 2] < height)
        points = np.concatenate([readings.scan, cubes[is_low, :2]])
        rows = [len(readings.scan), is_low.sum()]
        radii = np.repeat([0.0, readings.cube_m / math.sqrt(2.0)], rows)
        is_near = np.hypot(*(points - readings.pose[:2]).T) < NEAR_M
        points, radii = points[is_near], radii[is_near]
        if target is None:
            return cls(points, radii, np.full(len(points), margin))
        is_own = shapely.contains_xy(target.own_region, *points.T)
        # Cubes of the top extend beyond its edge: the outline is more exact.
        legs = points[is_own][shapely.contains_xy(target.polygon, *points[is_own].T)]
        edge, *_ = target.edge_points
        own = np.concatenate([legs, edge])
        margins = np.repeat([margin, OWN_GAPS * gap], [(~is_own).sum(), len(own)])
        radii = np.concatenate([radii[~is_own], np.zeros(len(own))])
        return cls(np.concatenate([points[~is_own], own]), radii, margins)

    def others(self, margin: float) -> Float64:
        """Return points (M, 2) on the rim of each obstacle with at least this margin, m."""
        is_other = self.margins >= margin
        rims = self.radii[is_other, None, None] * RIM
        return np.asarray((self.points[is_other, None] + rims).reshape(-1, 2))

    def guard(
        self, wanted: Speeds, pose: Float64, footprint: Footprint, limits: SpeedLimits
    ) -> Guarded:
        """Return the wanted motion, slowed or stopped by obstacles.

        Parameters
        ----------
        wanted
            Wanted velocities.
        pose
            float64 (3,), predicted pose of the base when they take effect, in odom.
        footprint, limits
            Footprint and velocity limits of the base.
        """
        if wanted == STOP or not len(self.points):
            return Guarded(wanted)
        local = transform2(between2(pose, np.zeros(3)), self.points)
        margins = self.radii + self.margins
        forward, yaw_rate = wanted
        if forward:
            way = footprint.free_way(local, margins, math.copysign(1.0, forward))
            if way < BLOCKED_M:
                return Guarded(STOP, self._nearest(local, footprint, math.copysign(1.0, forward)))
            forward = math.copysign(safe_speed(way, abs(forward), limits.acceleration), forward)
        if yaw_rate:
            rate = abs(yaw_rate)
            brake = rate * HOLD_S + rate * rate / (2.0 * limits.yaw_acceleration)
            angle = math.copysign(brake + 2.0 * BLOCKED_RAD, yaw_rate)
            free = abs(footprint.free_rotation(local, margins, angle))
            yaw_rate = math.copysign(safe_speed(free, rate, limits.yaw_acceleration), yaw_rate)
            if free < BLOCKED_RAD:
                # While driving, the yaw rate only keeps the line, so it can be zero.
                if not forward:
                    return Guarded(STOP, self._nearest(local, footprint, 0.0))
                yaw_rate = 0.0
        return Guarded(Speeds(forward, yaw_rate))

    def _nearest(self, local: Float64, footprint: Footprint, direction: float) -> Float64:
        """Return the point (2,) nearest to the footprint in a direction (1, -1, or 0 for any)."""
        distances = footprint.distance(local) - self.radii - self.margins
        distances[direction * local[:, 0] < 0.0] = np.inf
        return self.points[int(distances.argmin())]
