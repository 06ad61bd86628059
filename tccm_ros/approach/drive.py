"""Motions of the base, one step at a time: straight legs, turns in place, reversing."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tccm_ros.approach.guard import Guarded, Obstacles
from tccm_ros.approach.readings import Readings
from tccm_ros.approach.settings import RobotBase
from tccm_ros.approach.speeds import CommandHistory, Speeds, along_line, rotate_to
from tccm_ros.approach.walkers import Walkers
from tccm_ros.arrays import Float64
from tccm_ros.geometry import between2, compose2, transform2, wrap_angle

PERIOD_S = 0.05
"""Period of the control loop, s (20 Hz)."""

AT_POSE_M, AT_YAW_RAD = 0.003, math.radians(0.25)
"""Goal tolerance in position and yaw: small compared with the specified 2 cm and 1.5 deg, and above
the resolution of odometry."""

AT_LEG_M = 0.05
"""Position tolerance at the bends of a path, m: a cell of the grid."""

ALIGNED_RAD = math.radians(4.0)
"""Heading error below which the base starts a leg, rad; it steers out the rest while driving."""


class Driver:
    """Limits velocity commands to free motions, and records blocking obstacles and people.

    Parameters
    ----------
    robot
        The base.

    Attributes
    ----------
    blocked_s
        Time at which an obstacle began to block the motion, s; None while the motion is free.
    blocker
        float64 (2,), that obstacle, in odom.
    """

    def __init__(self, robot: RobotBase):
        self._robot = robot
        self._history = CommandHistory(robot.limits, robot.latency_s)
        self._walkers = Walkers(robot)
        self.blocked_s: float | None = None
        self.blocker: Float64 | None = None

    def pose(self, readings: Readings) -> Float64:
        """Return the predicted pose (3,) of the base when a command sent now takes effect."""
        return self._history.predict_pose(readings.pose, readings.pose_s, readings.now_s)

    def stop(self, readings: Readings) -> Speeds:
        """Return the zero command."""
        self._walkers.add(readings)
        return self._history.stop(readings.now_s)

    def move(self, wanted: Speeds, readings: Readings, obstacles: Obstacles) -> Speeds:
        """Return the next command: the wanted one, slowed or zero where an obstacle requires it."""
        pose = self.pose(readings)
        robot = self._robot
        self._walkers.add(readings)
        wanted, person = self._walkers.limit(wanted, pose)
        guarded = Guarded(wanted, person)
        if person is None:
            guarded = obstacles.guard(wanted, pose, robot.footprint, robot.limits)
        if guarded.blocker is None:
            self.blocked_s = self.blocker = None
            speeds = self._history.send(guarded.speeds, readings.now_s, PERIOD_S)
            # The limited command may still be faster than wanted: its braking must be free too.
            checked = obstacles.guard(speeds, pose, robot.footprint, robot.limits)
            return speeds if checked.blocker is None else self._history.stop(readings.now_s)
        if self.blocked_s is None:
            self.blocked_s = readings.now_s
        self.blocker = guarded.blocker
        return self._history.stop(readings.now_s)


@dataclass(slots=True, eq=False)
class LegDrive:
    """Drives straight legs to a pose, turning in place at each bend.

    Attributes
    ----------
    ends
        float64 (2,) each, ends of the remaining legs, in odom.
    yaw
        Heading at the end, rad.
    backing
        float64 (3,), a pose straight behind to which the base reverses first, or None.
    """

    ends: list[Float64]
    yaw: float
    backing: Float64 | None = None
    _leg: Float64 | None = None

    def moved(self, motion: Float64) -> LegDrive:
        """Return the remaining legs after a rigid motion (3,)."""
        backing = None if self.backing is None else compose2(motion, self.backing)
        ends = [transform2(motion, end[None])[0] for end in self.ends]
        return LegDrive(ends, self.yaw + float(motion[2]), backing)

    def wanted(self, pose: Float64, robot: RobotBase) -> Speeds | None:
        """Return the wanted velocities at a pose (3,) of the base; None at the end."""
        limits = robot.limits
        if self.backing is not None:
            if abs(float(between2(self.backing, pose)[0])) > AT_LEG_M:
                return along_line(pose, self.backing, limits, limits.speed)
            self.backing = None
        while self.ends:
            if self._leg is None:
                way = self.ends[0] - pose[:2]
                if np.hypot(*way) < AT_LEG_M:
                    self.ends.pop(0)
                    continue
                bearing = math.atan2(way[1], way[0])
                error = float(wrap_angle(bearing - pose[2]))
                if abs(error) > ALIGNED_RAD:
                    return rotate_to(error, limits)
                self._leg = np.array([*self.ends[0], bearing])
            if float(between2(self._leg, pose)[0]) < -AT_LEG_M / 2.0:
                return along_line(pose, self._leg, limits, limits.speed)
            self._leg = None
            self.ends.pop(0)
        error = float(wrap_angle(self.yaw - pose[2]))
        return None if abs(error) < ALIGNED_RAD / 4.0 else rotate_to(error, limits)


def close_in(pose: Float64, goal: Float64, robot: RobotBase, speed: float) -> Speeds | None:
    """Return the velocities from a pose (3,) to a goal pose (3,) straight ahead; None there."""
    x, _, yaw = between2(goal, pose).tolist()
    if abs(x) > AT_POSE_M:
        return along_line(pose, goal, robot.limits, speed)
    return None if abs(yaw) < AT_YAW_RAD else rotate_to(-yaw, robot.limits)


def pose_behind(pose: Float64, distance: float) -> Float64:
    """Return the pose (3,) straight behind another by a distance, m."""
    return compose2(pose, np.array([-distance, 0.0, 0.0]))
