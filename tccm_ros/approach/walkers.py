"""Speed and separation from people: points of the level scan where older scans saw free floor."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from tccm_ros.approach.readings import Readings
from tccm_ros.approach.settings import RobotBase
from tccm_ros.approach.speeds import HOLD_S, Speeds
from tccm_ros.arrays import Bool, Float64
from tccm_ros.geometry import between2, transform2

WALKING_M_S = 1.6
"""Speed at which a person walks towards the base, m/s (K of ISO 13855:2010)."""

MIN_AGE_S, MAX_AGE_S = 0.4, 1.0
"""Ages of the older scans, s: with `CLEAR_M`, speeds from 0.25 m/s are seen. Chosen."""

CLEAR_M = 0.10
"""Minimum distance of a moving point from all older points, m. A rotation at 0.6 rad/s with an
error of 20 ms of time and 2 % of odometry moves a point at 2 m by 5 cm."""

MIN_POINTS = 2
"""Minimum number of points within `CLEAR_M`: a single one may be a beam that two objects mix."""


@dataclass(frozen=True, slots=True, eq=False)
class _Scan:
    """A level scan: stamp, s, position (2,) of the laser, points (N, 2), and their tree."""

    stamp_s: float
    laser: Float64
    points: Float64
    tree: cKDTree

    def has_near(self, points: Float64) -> Bool:
        """Return which points (M, 2) have a point of this scan within `CLEAR_M`."""
        distances, _ = self.tree.query(points, distance_upper_bound=CLEAR_M)
        return np.asarray(np.isfinite(distances))

    def sees_through(self, points: Float64) -> Bool:
        """Return which points (M, 2) are free: the beams around them ended behind them."""
        rays, ends = points - self.laser, self.points - self.laser
        ranges = np.hypot(*rays.T)
        units = rays / ranges[:, None]
        along = units @ ends.T
        across = units[:, :1] * ends[:, 1] - units[:, 1:] * ends[:, 0]
        along[(np.abs(across) > CLEAR_M) | (along <= 0.0)] = np.inf
        nearest = along.min(axis=1, initial=np.inf)
        return np.asarray(np.isfinite(nearest) & (nearest > ranges + CLEAR_M))


class Walkers:
    """Finds moving objects near the base, and limits the speed so that it rests before contact.

    Parameters
    ----------
    robot
        The base.

    Attributes
    ----------
    points
        float64 (K, 2), points of the newest level scan that move, in odom.
    """

    def __init__(self, robot: RobotBase):
        self._robot = robot
        self._scans: deque[_Scan] = deque()
        self.points = np.zeros((0, 2))

    def add(self, readings: Readings) -> None:
        """Add the newest level scan, unless it is known."""
        if not len(readings.scan) or (self._scans and readings.scan_s <= self._scans[-1].stamp_s):
            return
        while self._scans and readings.scan_s - self._scans[0].stamp_s > MAX_AGE_S:
            self._scans.popleft()
        older = [s for s in self._scans if readings.scan_s - s.stamp_s >= MIN_AGE_S]
        self.points = self._moving(readings.scan, older)
        scan = readings.scan
        self._scans.append(_Scan(readings.scan_s, readings.laser, scan, cKDTree(scan)))

    @staticmethod
    def _moving(points: Float64, older: list[_Scan]) -> Float64:
        """Return the points that no older scan has, and one of them saw through."""
        for scan in older:
            points = points[~scan.has_near(points)]
            if len(points) < MIN_POINTS:
                return points[:0]
        is_free = np.zeros(len(points), bool)
        for scan in older:
            is_free |= scan.sees_through(points)
        points = points[is_free]
        if len(points) < MIN_POINTS:
            return points[:0]
        counts = cKDTree(points).query_ball_point(points, CLEAR_M, return_length=True)
        return points[counts >= MIN_POINTS]

    def limit(self, wanted: Speeds, pose: Float64) -> tuple[Speeds, Float64 | None]:
        """Return the wanted motion, slowed down, and the point (2,) of a person who forbids it.

        The base rests when a person who walks towards it from now on comes within the margin: the
        protective separation distance of ISO/TS 15066:2016, 5.5.4. None instead of a point where
        nobody forbids it.

        Parameters
        ----------
        wanted
            Wanted velocities.
        pose
            float64 (3,), predicted pose of the base when they take effect, in odom.
        """
        if not len(self.points):
            return wanted, None
        robot = self._robot
        local = transform2(between2(pose, np.zeros(3)), self.points)
        distances = robot.footprint.distance(local) - robot.margin
        braking_s = float(distances.min()) / WALKING_M_S - robot.latency_s - HOLD_S
        if braking_s <= 0.0:
            return Speeds(), self.points[int(distances.argmin())]
        limits = robot.limits
        needed_s = max(
            abs(wanted.forward) / limits.acceleration,
            abs(wanted.yaw_rate) / limits.yaw_acceleration,
        )
        factor = min(1.0, braking_s / max(needed_s, 1e-9))
        return Speeds(factor * wanted.forward, factor * wanted.yaw_rate), None
