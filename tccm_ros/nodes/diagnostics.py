"""/diagnostics at 1 Hz: what comes in, what was dropped and why, and what to do."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from tccm_ros.nodes.clock import steady_timer

PERIOD_S = 1.0
"""Between two messages on /diagnostics, s: the rate that diagnostic_updater has by default."""


class Diagnostics:
    """Publishes problems and counts once a second, and logs each new problem once.

    Parameters
    ----------
    node
        The node that publishes.
    problems
        Returns the present problems, one line each; none is OK.
    values
        Returns the figures to show.
    """

    def __init__(
        self,
        node: Node,
        problems: Callable[[], Sequence[str]],
        values: Callable[[], Mapping[str, object]],
    ):
        self._node, self._problems, self._values = node, problems, values
        self._logged: set[str] = set()
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._timer = steady_timer(node, PERIOD_S, self.publish)

    def publish(self) -> None:
        """Publish one DiagnosticArray; log what is new."""
        if not self._node.context.ok():
            return
        problems = list(self._problems())
        for text in problems:
            if text not in self._logged:
                self._node.get_logger().warning(text)
        self._logged = set(problems)
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if problems else DiagnosticStatus.OK,
            name=self._node.get_fully_qualified_name().lstrip("/"),
            hardware_id="tccm_ros",
            message="; ".join(problems) or "ok",
            values=[KeyValue(key=k, value=str(v)) for k, v in self._values().items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)
