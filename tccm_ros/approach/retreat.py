"""Straight retreat from a surface."""

from __future__ import annotations

from tccm_ros.approach.drive import AT_POSE_M, Driver, pose_behind
from tccm_ros.approach.guard import Obstacles
from tccm_ros.approach.missing_input import missing_input
from tccm_ros.approach.outcome import Outcome, Phase, Reason
from tccm_ros.approach.readings import Readings
from tccm_ros.approach.settings import RobotBase
from tccm_ros.approach.speeds import Speeds, along_line
from tccm_ros.arrays import Float64
from tccm_ros.geometry import between2


class Retreat:
    """Drives the base straight back, one step at a time.

    Parameters
    ----------
    robot
        The base.
    distance
        Length of the retreat, m, > 0.

    Attributes
    ----------
    phase, outcome
        As in `Approach`; the outcome's `distance` is the length driven, m.
    """

    phase = Phase.RETREATING

    def __init__(self, robot: RobotBase, distance: float):
        self._robot, self._distance = robot, distance
        self._driver = Driver(robot)
        self._start: Float64 | None = None
        self.outcome: Outcome | None = None

    def step(self, readings: Readings) -> Speeds:
        """Return the velocity command of this step; zero once `outcome` is set."""
        lost = missing_input(readings, self._robot.patience_s)
        if lost is not None:
            return self._end(readings, *lost)
        if self._start is None:
            self._start = readings.pose
        goal = pose_behind(self._start, self._distance)
        pose = self._driver.pose(readings)
        if float(between2(goal, pose)[0]) < AT_POSE_M:
            return self._end(readings, Reason.NONE, "backed off")
        wanted = along_line(pose, goal, self._robot.limits, self._robot.limits.speed)
        around = Obstacles.of(readings, None, self._robot.margin, 0.0, self._robot.height)
        speeds = self._driver.move(wanted, readings, around)
        since = self._driver.blocked_s
        if since is not None and readings.now_s - since > self._robot.patience_s:
            return self._end(readings, Reason.BLOCKED, "something behind is in the way")
        return speeds

    def way(self, pose: Float64) -> float:
        """Return the length driven up to a pose (3,), m."""
        return 0.0 if self._start is None else -float(between2(self._start, pose)[0])

    def wait(self, readings: Readings) -> Speeds:
        """Return the zero command; keep the retreat."""
        return self._driver.stop(readings)

    def cancel(self, readings: Readings) -> Speeds:
        """Cancel the retreat; return the zero command."""
        return self._end(readings, Reason.CANCELLED, "cancelled")

    def _end(self, readings: Readings, reason: Reason, message: str) -> Speeds:
        self.outcome = Outcome(reason, message, distance=self.way(readings.pose))
        return self._driver.stop(readings)
