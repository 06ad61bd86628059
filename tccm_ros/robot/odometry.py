"""Filter odometry: move it near the origin, and remove outliers and jumps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import planar, spatial
from tccm_ros.records import Odometry
from tccm_ros.robot.steps import StepGuard

MAX_SPEED = 10.0
"""Maximum speed of a base, m/s, and rad/s."""

STEP_SLACK = 0.1
"""Steps up to this are plausible at any speed, m or rad: corrections of fused odometry."""

ORIGIN_STEP = 1024.0
"""The origin is moved by multiples of this, m: an exact binary number, and zero for odometry that
begins within half of it, such as wheel odometry. UTM coordinates are 10^6 m."""

MAX_HEIGHT = 3.0
"""Odometry that begins higher than this above its origin, m, has the height above sea level, not
above the ground."""


class OdometryFilter:
    """Removes outliers, jumps and far origins from odometry records.

    Attributes
    ----------
    T_near_odom
        float64 (4, 4), from the odometry frame of the messages to that of the records: the identity
        while odometry begins near its origin and does not jump.
    refused
        Number of outliers.
    jumps
        Number of jumps; the base is assumed not to have moved during a jump.
    """

    def __init__(self) -> None:
        self._guard = StepGuard[Odometry](_distance, STEP_SLACK, MAX_SPEED)
        self.T_near_odom: Float64 = np.eye(4)
        self.refused = self.jumps = 0
        self._last: Odometry | None = None

    def add(self, record: Odometry) -> list[Odometry]:
        """Add a record; return the records to use now, near the origin."""
        if self._last is None:
            self.T_near_odom = np.eye(4)
            self.T_near_odom[:3, 3] = -_origin(record.T_odom_base[:3, 3])
        steps = self._guard.add(record.stamp_ns, record)
        self.refused += steps.refused
        if steps.has_jumped and self._last is not None:
            self.jumps += 1
            self.T_near_odom = _joined(self._last.T_odom_base, steps.admitted[0][1].T_odom_base)
        return [self._near(item) for _, item in steps.admitted]

    def clear(self) -> None:
        """Clear all samples, after a jump of the clock."""
        self._guard.clear()
        self._last = None

    def _near(self, record: Odometry) -> Odometry:
        T = self.T_near_odom
        if not np.array_equal(T, np.eye(4)):
            record = replace(record, T_odom_base=T @ record.T_odom_base)
        self._last = record
        return record


def _distance(a: Odometry, b: Odometry) -> float:
    """Return the distance of two poses: the larger of translation (m) and rotation (rad)."""
    T_a, T_b = a.T_odom_base, b.T_odom_base
    moved = math.dist(T_a[:3, 3].tolist(), T_b[:3, 3].tolist())
    cosine = (float(np.vdot(T_a[:3, :3], T_b[:3, :3])) - 1.0) / 2.0
    return max(moved, math.acos(min(max(cosine, -1.0), 1.0)))


def _origin(position: Float64) -> Float64:
    """Return the origin float64 (3,), m, for odometry that begins at a position."""
    origin = ORIGIN_STEP * np.round(position / ORIGIN_STEP)
    origin[2] = position[2] if abs(position[2]) > MAX_HEIGHT else 0.0
    return np.asarray(origin, np.float64)


def _joined(T_near_last: Float64, T_odom_next: Float64) -> Float64:
    """Return T_near_odom that gives the next pose the position and yaw of the last one."""
    yaw = float(planar(T_near_last)[2] - planar(T_odom_next)[2])
    T = np.asarray(spatial(np.array([0.0, 0.0, yaw])))
    T[:3, 3] = T_near_last[:3, 3] - T[:3, :3] @ T_odom_next[:3, 3]
    return T
