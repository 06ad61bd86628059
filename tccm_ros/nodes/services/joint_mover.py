"""Client of a joint controller's action, control_msgs/FollowJointTrajectory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.task import Future

from tccm_ros.errors import MotionError
from tccm_ros.nodes.ros_types import message_class

MIN_DURATION_S = 0.1
"""Minimum duration of a movement, s. Chosen."""

ANSWER_S = 5.0
"""Timeout for a controller to accept or cancel a trajectory, s. Chosen."""

LATE_S = 10.0
"""A movement may take twice its duration plus this, s. Chosen."""

Wait = Callable[[Callable[[], bool], float, str], None]
"""Returns when a condition holds. Raises when the wait is cancelled, and MotionError with the given
text after the timeout in s."""


def has_controllers() -> bool:
    """Return whether control_msgs can be imported."""
    return find_spec("control_msgs") is not None


class JointMover:
    """Moves joints to positions.

    Parameters
    ----------
    node
        Node of the client; its executor must run in another thread meanwhile.
    controller
        Name of the action.
    """

    def __init__(self, node: Node, controller: str):
        self._name = controller
        self._kind = import_module("control_msgs.action").FollowJointTrajectory
        self._client = ActionClient(node, self._kind, controller)

    def close(self) -> None:
        """Destroy the client."""
        self._client.destroy()

    def move(self, positions: Mapping[str, float], duration_s: float, wait: Wait) -> None:
        """Move joints and return when the controller is done.

        Parameters
        ----------
        positions
            Positions by joint, rad or m.
        duration_s
            Duration of the movement, s.
        wait
            Waits for a condition; if it raises, the movement is cancelled.

        Raises
        ------
        MotionError
            If there is no controller, or it refuses or fails.
        """
        wait(
            self._client.server_is_ready, ANSWER_S,
            f"nobody offers the action '{self._name}' (control_msgs/FollowJointTrajectory); start "
            "the controller, or set scan_here.controller",
        )  # fmt: skip
        duration_s = max(duration_s, MIN_DURATION_S)
        goal = self._kind.Goal(trajectory=_trajectory(positions, duration_s))
        sent = self._client.send_goal_async(goal)
        wait(sent.done, ANSWER_S, f"the controller '{self._name}' does not answer")
        handle: Any = sent.result()
        joints = ", ".join(positions)
        if not handle.accepted:
            raise MotionError(f"the controller '{self._name}' refuses to move {joints}")
        done: Future = handle.get_result_async()
        late = f"the controller '{self._name}' has not moved {joints} in time"
        try:
            wait(done.done, 2.0 * duration_s + LATE_S, late)
        except BaseException:
            handle.cancel_goal_async()
            raise
        result: Any = done.result()
        error = result.result
        if error.error_code or result.status != GoalStatus.STATUS_SUCCEEDED:
            raise MotionError(
                f"the controller '{self._name}' failed: {error.error_string or 'without a reason'} "
                f"(error_code {error.error_code}, status {result.status})"
            )


def _trajectory(positions: Mapping[str, float], duration_s: float) -> Any:
    point = message_class("trajectory_msgs/msg/JointTrajectoryPoint")(
        positions=[float(position) for position in positions.values()],
        time_from_start=Duration(seconds=duration_s).to_msg(),
    )
    return message_class("trajectory_msgs/msg/JointTrajectory")(
        joint_names=list(positions), points=[point]
    )
