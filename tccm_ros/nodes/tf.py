"""map -> odom on /tf, where tf2_msgs is installed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile

from tccm_ros.nodes.intake import Intake
from tccm_ros.nodes.ros_types import message_class

__all__ = ["TfPublisher", "has_tf2_msgs"]


def has_tf2_msgs() -> bool:
    """Return whether tf2_msgs can be imported."""
    try:
        message_class("tf2_msgs/msg/TFMessage")
    except ImportError:
        return False
    return True


class TfPublisher:
    """Publishes a transform at a fixed rate from its first value on.

    Parameters
    ----------
    node
        The node that publishes.
    intake
        Calls back when a publication is due.
    rate_hz
        Of publication.
    current
        Returns a geometry_msgs/TransformStamped, or None before the first scan.
    """

    def __init__(
        self, node: Node, intake: Intake, rate_hz: float, current: Callable[[], Any | None]
    ):
        self._message = message_class("tf2_msgs/msg/TFMessage")
        self._current = current
        self._publisher = node.create_publisher(self._message, "/tf", QoSProfile(depth=100))
        timer = node.create_timer(1.0 / rate_hz, self.publish, callback_group=intake.group)
        intake.add_timer(timer)

    def publish(self) -> None:
        """Publish the transform, if there is one."""
        transform = self._current()
        if transform is not None:
            self._publisher.publish(self._message(transforms=[transform]))
