"""map -> odom and the frames of surfaces on /tf, if tf2_msgs is installed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile

from tccm_ros.config.node import TfConfig
from tccm_ros.nodes.intake.intake import Intake
from tccm_ros.nodes.ros_types import TF_MESSAGE, message_class


class TfPublisher:
    """Publishes transforms at a fixed rate once there are any.

    Parameters
    ----------
    node
        Node of the publisher.
    intake
        Runs the timer's callback.
    config
        The group `tf`; a change of `rate` applies from the next message on.
    current
        Returns geometry_msgs/TransformStamped messages; none before the first scan.
    """

    def __init__(
        self, node: Node, intake: Intake, config: TfConfig, current: Callable[[], Sequence[Any]]
    ):
        self._message = message_class(TF_MESSAGE)
        self._current = current
        self._publisher = node.create_publisher(self._message, "/tf", QoSProfile(depth=100))
        self._config, self._rate = config, config.rate
        self._timer = node.create_timer(1.0 / self._rate, self._tick, callback_group=intake.group)
        intake.add_timer(self._timer)

    def _tick(self) -> None:
        if self._rate != self._config.rate:
            self._rate = self._config.rate
            self._timer.timer_period_ns = round(1e9 / self._rate)
        self.publish()

    def publish(self) -> None:
        """Publish the current transforms, if any."""
        transforms = self._current()
        if transforms:
            self._publisher.publish(self._message(transforms=transforms))
