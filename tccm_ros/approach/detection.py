"""Measurement of a surface for another program that drives, such as Nav2's docking server."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from tccm_ros.approach.approach import EDGE_CYCLES
from tccm_ros.approach.edge import measured_edge
from tccm_ros.approach.floor import Floor
from tccm_ros.approach.guard import Obstacles
from tccm_ros.approach.locating import locate, top_points
from tccm_ros.approach.missing_input import missing_input
from tccm_ros.approach.outcome import Outcome, Phase, Reason
from tccm_ros.approach.readings import Readings, TopCycle
from tccm_ros.approach.settings import Goal, RobotBase, Surroundings
from tccm_ros.approach.standing import StandingPose, standing_poses
from tccm_ros.approach.target import Target
from tccm_ros.arrays import Float64
from tccm_ros.geometry import compose2, inverse2, transform2


class Detection:
    """Follows a surface and the pose of the base at it, one step at a time, without a command.

    The place at the surface is chosen once and moves with the surface.

    Parameters
    ----------
    robot, goal, around
        As in `Approach`.

    Attributes
    ----------
    phase, outcome
        As in `Approach`; it runs until it is cancelled or has lost the surface.
    pose
        float64 (3,), pose of the base at the surface, in odom; None before the first measurement.
    stamp_s
        Stamp of the newest tilt cycle in it, s.
    """

    phase = Phase.LOOKING

    def __init__(self, robot: RobotBase, goal: Goal, around: Surroundings):
        self._robot, self._goal, self._around = robot, goal, around
        self._cycles: deque[TopCycle] = deque(maxlen=EDGE_CYCLES)
        self._expected: Target | None = None
        self._standing: StandingPose | None = None
        self._since_s = math.inf
        self.outcome: Outcome | None = None
        self.pose: Float64 | None = None
        self.stamp_s = -math.inf

    def step(self, readings: Readings) -> None:
        """Follow the surface in a new tilt cycle; set `outcome` where it is lost."""
        lost = missing_input(readings, self._robot.patience_s)
        if lost is not None:
            self.outcome = Outcome(*lost)
            return
        assert readings.map_odom is not None
        if self._expected is None:
            self._expected = self._goal.target.moved(inverse2(readings.map_odom))
            self._since_s = readings.now_s
        cycle = readings.cycle
        if cycle is not None and not (self._cycles and cycle.stamp_s <= self._cycles[-1].stamp_s):
            self._cycles.append(cycle)
            self._follow(readings)
        if self.outcome is None and readings.now_s - self._since_s > self._robot.patience_s:
            self.outcome = Outcome(
                Reason.LOST_SURFACE,
                f"tilt cycles have not shown the surface for {self._robot.patience_s:.0f} s",
            )

    def wait(self, readings: Readings) -> None:
        """Do nothing."""

    def cancel(self, readings: Readings) -> None:
        """End the measurement."""
        self.outcome = Outcome(Reason.CANCELLED, "cancelled")

    def gap(self, pose: Float64) -> float:
        """Return nan: whoever drives knows the gap."""
        return math.nan

    def _follow(self, readings: Readings) -> None:
        assert self._expected is not None
        assert readings.map_odom is not None
        odom_map = inverse2(readings.map_odom)
        others = [transform2(odom_map, o[:, :2]) for o in self._around.same_height]
        found = locate(self._cycles, self._expected, others)
        if found is None:
            return
        standing = self._standing
        if standing is None:
            standing = self._chosen(readings, found)
            if standing is None:
                return
        else:
            motion = compose2(found.pose, inverse2(self._expected.pose))
            standing = standing.moved(motion)
        yaw = standing.pose[2]
        normal = np.array([-math.cos(yaw), -math.sin(yaw)])
        points = np.concatenate([cycle.points for cycle in self._cycles])
        tops = top_points(points, self._expected, others)
        edge = measured_edge(tops, found, standing.edge, normal)
        if edge is not None:
            point, normal = edge.facing(standing.pose[:2])
            place = point + (self._goal.gap + self._robot.footprint.front) * normal
            pose = np.array([*place, math.atan2(-normal[1], -normal[0])])
            standing = standing.moved(compose2(pose, inverse2(standing.pose)))
        self._standing, self._expected = standing, found
        self.pose, self.stamp_s = standing.pose, self._cycles[-1].stamp_s
        self._since_s = readings.now_s

    def _chosen(self, readings: Readings, target: Target) -> StandingPose | None:
        """Return the best free place at a surface, in odom; None, with the outcome, without one."""
        assert readings.map_odom is not None
        map_odom, goal, robot = readings.map_odom, self._goal, self._robot
        others = Obstacles.of(readings, target, robot.margin, goal.gap, robot.height)
        floor = Floor(
            self._around.grid, self._around.overhangs, goal.target.outline,
            transform2(map_odom, others.others(robot.margin)),
        )  # fmt: skip
        shift = compose2(compose2(map_odom, target.pose), inverse2(goal.target.pose))
        spot = None if goal.spot is None else transform2(shift, goal.spot[None])[0]
        poses = standing_poses(
            target.moved(map_odom), floor, robot.footprint, goal.gap, goal.staging,
            goal.max_distance, spot, goal.side, compose2(map_odom, readings.pose)[:2],
        )  # fmt: skip
        if not poses:
            self.outcome = Outcome(
                Reason.NO_PLACE, "nowhere at the surface is free floor for the base"
            )
            return None
        return poses[0].moved(inverse2(map_odom))
