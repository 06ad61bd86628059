"""A robot in the room of `live_robot`, with a simulated controller of its tilt joint.

Its messages define the time: each step publishes odometry, the joint and the scans.
"""

import numpy as np
import pytest
from live_robot import START_NS, STEP_NS, Listener, level_scan, tilt_scan
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future

from tccm_ros.records import JointSample, Odometry

TILT_STEP = 0.02
"""Maximum motion of the joint in a step, rad."""


class MovingHead:
    """The world, its robot and the controller of the robot's tilt joint.

    Attributes
    ----------
    x
        Position of the base, m; `speed` is added at each step.
    tilts
        Targets received by the controller, rad.
    refuses, error_code, holds
        Failures of the controller: it rejects a goal, it aborts with an error code, or it holds a
        goal until it is cancelled.
    """

    def __init__(self, ros, *nodes, controller: str = "head_controller/follow_joint_trajectory"):
        control = pytest.importorskip("control_msgs.action", reason="control_msgs not generated")
        self._kind = control.FollowJointTrajectory
        self.ros, self.nodes = ros, nodes
        self.robot = ros.robot()
        self.robot.wait_until_described(*nodes)
        self.x, self.speed, self.moving_speed, self.tilt = 0.0, 0.0, 0.0, 0.5
        self._k = 0
        self._target = self.tilt
        self._end_of_movement = Future()
        self.tilts: list[float] = []
        self.durations: list[float] = []
        self.refuses, self.error_code, self.holds, self.was_cancelled = False, 0, False, False
        self._server = None
        if controller:
            self._server = ActionServer(
                Listener(ros, "head").node, self._kind, controller, self._follow,
                goal_callback=lambda _: GoalResponse(1 if self.refuses else 2),
                cancel_callback=self._cancel,
            )  # fmt: skip

    def close(self) -> None:
        if self._server is not None:
            self._server.destroy()

    def step(self) -> None:
        """Publish the current measurements, and advance the time."""
        self.tilt += float(np.clip(self._target - self.tilt, -TILT_STEP, TILT_STEP))
        now, x = START_NS + self._k * STEP_NS, self.x
        T = np.eye(4)
        T[0, 3] = x
        records = [
            ("odom", Odometry(now, "odom", "base", T)),
            ("joint_states", JointSample(now, ("tilt",), np.array([self.tilt]))),
            ("tilt_scan", tilt_scan(now, self.tilt)),
        ]
        if self._k % 2:
            records.append(("scan", level_scan(now, x)))
        for topic, record in records:
            heard = (n for n in self.nodes if f"/{topic}" in n.inputs.counts())
            self.robot.publish(topic, self.robot.message(record), *heard)
        self._k += 1
        self.x += self.speed

    def until(self, predicate, what: str = "") -> None:
        """Step until the predicate holds, each time after the nodes have received the last step."""

        def look():
            if predicate():
                return True
            if all(self._has_all(node) for node in self.nodes):
                is_there = abs(self._target - self.tilt) < 1e-9
                if is_there and not self.holds and not self._end_of_movement.done():
                    self._end_of_movement.set_result(None)
                self.step()
            return False

        self.ros.spin_until(look, what=what)

    def _has_all(self, node) -> bool:
        counts = node.inputs.counts()
        return all(counts[f"/{t}"] >= n for t, n in self.robot.sent.items() if f"/{t}" in counts)

    async def _follow(self, goal):
        trajectory = goal.request.trajectory
        assert trajectory.joint_names == ["tilt"]
        (target,) = trajectory.points[-1].positions
        after = trajectory.points[-1].time_from_start
        self.tilts.append(target)
        self.durations.append(after.sec + after.nanosec * 1e-9)
        result = self._kind.Result()
        self.was_cancelled, self._end_of_movement = False, Future()
        if not self.holds:
            self._target, self.speed = target, self.moving_speed
        await self._end_of_movement
        self.speed = 0.0
        if self.was_cancelled:
            goal.canceled()
        elif self.error_code:
            result.error_code, result.error_string = self.error_code, "the joint is blocked"
            goal.abort()
        else:
            goal.succeed()
        return result

    def _cancel(self, _):
        self.was_cancelled = True
        self._end_of_movement.set_result(None)
        return CancelResponse.ACCEPT
