"""Straight retreat from a surface."""

from __future__ import annotations

from tccm_ros.approach.drive import AT_POSE_M, Driver, pose_behind
from tccm_ros.approach.guard import Obstacles
from tccm_ros.approach.missing_input import missing_input
from tccm_ros.approach.outcome import Outcome, Phase, Reason
from tccm_ros.approach.senses import Senses
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

    def step(self, senses: Senses) -> Speeds:
        """Return the velocity command of this step; zero once `outcome` is set."""
        lost = missing_input(senses, self._robot.patience_s)
        if lost is not None:
            return self._end(senses, *lost)
        if self._start is None:
            self._start = senses.pose
        goal = pose_behind(self._start, self._distance)
        pose = self._driver.pose(senses)
        if float(between2(goal, pose)[0]) < AT_POSE_M:
            return self._end(senses, Reason.NONE, "backed off")
        wanted = along_line(pose, goal, self._robot.limits, self._robot.limits.speed)
        around = Obstacles.of(senses, None, self._robot.margin, 0.0, self._robot.height)
        speeds = self._driver.move(wanted, senses, around)
        since = self._driver.blocked_s
        if since is not None and senses.now_s - since > self._robot.patience_s:
            return self._end(senses, Reason.BLOCKED, "something behind is in the way")
        return speeds

    def way(self, pose: Float64) -> float:
        """Return the length driven up to a pose (3,), m."""
        return 0.0 if self._start is None else -float(between2(self._start, pose)[0])

    def wait(self, senses: Senses) -> Speeds:
        """Return the zero command; keep the retreat."""
        return self._driver.stop(senses)

    def cancel(self, senses: Senses) -> Speeds:
        """Cancel the retreat; return the zero command."""
        return self._end(senses, Reason.CANCELLED, "cancelled")

    def _end(self, senses: Senses, reason: Reason, message: str) -> Speeds:
        self.outcome = Outcome(reason, message, distance=self.way(senses.pose))
        return self._driver.stop(senses)
