"""A stand-in for Nav2's navigator: the action NavigateToPose, and a plain controller behind it."""

from math import atan2, hypot

import numpy as np
from nav2_msgs.action import NavigateToPose
from rclpy.action import ActionServer, CancelResponse
from rclpy.task import Future

from tccm_ros.approach.speeds import Speeds
from tccm_ros.geometry import compose2, planar, pose_from_quaternion

AT_M, AT_RAD = 0.2, 0.2
"""As far from the goal as Nav2's SimpleGoalChecker allows, almost."""


class StandInNav2:
    """Drives a simulated base to the goals of the action.

    Attributes
    ----------
    goals
        Poses (3,) in map that were asked for.
    is_driving
        Whether a goal runs.
    refusal
        Message with which the next goal is aborted, if it is not empty.
    """

    def __init__(self, node, base):
        self._base, self._goal, self._done, self._handle = base, None, None, None
        self.goals: list[np.ndarray] = []
        self.refusal = ""
        self.server = ActionServer(
            node, NavigateToPose, "navigate_to_pose", self._execute,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip

    @property
    def is_driving(self) -> bool:
        return self._goal is not None

    async def _execute(self, handle):
        told = handle.request.pose
        p, q = told.pose.position, told.pose.orientation
        quaternion = np.array([q.x, q.y, q.z, q.w])
        self.goals.append(planar(pose_from_quaternion(np.array([p.x, p.y, p.z]), quaternion)))
        assert told.header.frame_id == "map"
        result = NavigateToPose.Result()
        if self.refusal:
            result.error_msg, result.error_code = self.refusal, 7
            handle.abort()
            return result
        self._goal, self._handle, self._done = self.goals[-1], handle, Future()
        if await self._done:
            handle.succeed()
        else:
            handle.canceled()
        return result

    def _end(self, is_there: bool) -> Speeds:
        done, self._goal, self._done = self._done, None, None
        done.set_result(is_there)
        return Speeds()

    def speeds(self) -> Speeds:
        """Return the command of this step; end the goal where it is cancelled or met."""
        if self._handle.is_cancel_requested:
            return self._end(False)
        x, y, yaw = compose2(self._base.map_odom, self._base.odom)
        way = self._goal[:2] - (x, y)
        is_near = hypot(*way) < AT_M
        error = (self._goal[2] if is_near else atan2(way[1], way[0])) - yaw
        error = (error + np.pi) % (2 * np.pi) - np.pi
        if is_near and abs(error) < AT_RAD:
            return self._end(True)
        is_ahead = abs(error) < 0.3 and not is_near
        return Speeds(0.3 if is_ahead else 0.0, float(np.clip(2.0 * error, -0.8, 0.8)))
