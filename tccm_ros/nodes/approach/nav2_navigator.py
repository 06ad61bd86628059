"""Nav2's navigator as the `Navigator` of an approach, where nav2_msgs is installed."""

from __future__ import annotations

from functools import partial
from importlib import import_module
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.node import Node

from tccm_ros.arrays import Float64
from tccm_ros.geometry import spatial
from tccm_ros.ros.types import MessageTypes, pose_message


class Nav2Navigator:
    """Sends goals to Nav2's NavigateToPose.

    `start` and `cancel` may be called in any thread; answers come in the node's executor.

    Parameters
    ----------
    node, types
        Node of the action client, and its message classes.
    action
        Name of the action.
    map_frame
        Frame of the goals.

    Attributes
    ----------
    failure
        Why the last drive failed; empty if it succeeded or `cancel` ended it.

    Raises
    ------
    ImportError
        Without nav2_msgs.
    """

    def __init__(self, node: Node, types: MessageTypes, action: str, map_frame: str):
        self._node, self._types, self._map_frame = node, types, map_frame
        self._kind = import_module("nav2_msgs.action").NavigateToPose
        self._client = ActionClient(node, self._kind, action)
        self._handle: Any = None
        self._is_active = self._is_unwanted = False
        self._number = 0
        self.failure = ""

    @property
    def is_ready(self) -> bool:
        """Whether Nav2 offers the action."""
        return bool(self._client.server_is_ready())

    @property
    def is_active(self) -> bool:
        """Whether Nav2 drives the base, also while it ends a cancelled drive."""
        if self._is_active and not self.is_ready:
            self._end("Nav2 is gone")
        return self._is_active

    def start(self, pose: Float64) -> None:
        """Start a drive to a pose float64 (3,), in map."""
        self._number += 1
        self._handle, self.failure = None, ""
        self._is_active, self._is_unwanted = True, False
        executor = self._node.executor
        assert executor is not None
        # A goal that is sent in another thread than the executor's may be answered before rclpy
        # has noted that it waits for an answer.
        executor.create_task(self._send, self._number, pose)

    def cancel(self) -> None:
        """Cancel the drive, if there is one."""
        if self._is_active and not self._is_unwanted:
            self._is_unwanted = True
            if self._handle is not None:
                self._handle.cancel_goal_async()

    def close(self) -> None:
        """Cancel the drive and release the action client."""
        self.cancel()
        self._client.destroy()

    # --- in the executor ---

    def _send(self, number: int, pose: Float64) -> None:
        goal = self._kind.Goal()
        goal.pose.header.frame_id = self._map_frame
        goal.pose.header.stamp = self._node.get_clock().now().to_msg()
        goal.pose.pose = pose_message(self._types, spatial(pose))
        sent = self._client.send_goal_async(goal)
        sent.add_done_callback(partial(self._take_answer, number))

    def _take_answer(self, number: int, answered: Any) -> None:
        handle = answered.result()
        if number != self._number:  # Nav2 was gone meanwhile
            handle.cancel_goal_async()
        elif not handle.accepted:
            self._end("Nav2 refuses the goal")
        else:
            self._handle = handle
            if self._is_unwanted:
                handle.cancel_goal_async()
            handle.get_result_async().add_done_callback(partial(self._take_result, number))

    def _take_result(self, number: int, answered: Any) -> None:
        if number != self._number:
            return
        status, result = answered.result().status, answered.result().result
        if status == GoalStatus.STATUS_SUCCEEDED or self._is_unwanted:
            self._end("")
        elif status == GoalStatus.STATUS_CANCELED:
            self._end("another program has cancelled Nav2's goal")
        else:
            message = getattr(result, "error_msg", "")  # not in the first Jazzy
            self._end(f"Nav2: {message or f'error {result.error_code}'}")

    def _end(self, failure: str) -> None:
        self._handle, self.failure, self._is_active = None, failure, False
