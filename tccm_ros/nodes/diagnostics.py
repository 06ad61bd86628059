"""/diagnostics at 1 Hz: what comes in, what was dropped and why, and what to do."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from tccm_ros.nodes.clock import steady_timer
from tccm_ros.nodes.inputs import Blocking

PERIOD_S = 1.0
"""Between two messages on /diagnostics, s: the rate that diagnostic_updater has by default."""


@dataclass(frozen=True, slots=True)
class InputStatus:
    """What is published of one input.

    Attributes
    ----------
    topic
        Resolved name.
    problem
        What is wrong with it, `Blocking` where the node cannot work without it.
    values
        Its figures.
    """

    topic: str
    problem: str | None
    values: Mapping[str, object]


class Diagnostics:
    """Publishes the node's state and that of each input once a second; logs new problems once.

    Parameters
    ----------
    node
        The node that publishes.
    problems
        Returns the present problems, one line each; none is OK, a `Blocking` one an error.
    values
        Returns the figures to show.
    inputs
        Returns the state of each input.
    """

    def __init__(
        self,
        node: Node,
        problems: Callable[[], Sequence[str]],
        values: Callable[[], Mapping[str, object]],
        inputs: Callable[[], Sequence[InputStatus]],
    ):
        self._node, self._problems, self._values, self._inputs = node, problems, values, inputs
        self._logged: set[str] = set()
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._timer = steady_timer(node, PERIOD_S, self.publish)

    def publish(self) -> None:
        """Publish one DiagnosticArray, the node's own status first; log what is new."""
        if not self._node.context.ok():
            return
        problems = list(self._problems())
        for text in problems:
            if text not in self._logged:
                self._log(text)
        self._logged = set(problems)
        name = self._node.get_fully_qualified_name().lstrip("/")
        message = DiagnosticArray(status=[_status(name, problems, self._values())])
        for state in self._inputs():
            found = [state.problem] if state.problem else []
            message.status.append(_status(f"{name}: {state.topic}", found, state.values))
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def _log(self, text: str) -> None:
        logger = self._node.get_logger()
        if isinstance(text, Blocking):
            logger.error(text)
        else:
            logger.warning(text)


def _status(name: str, problems: Sequence[str], values: Mapping[str, object]) -> DiagnosticStatus:
    """Return a status whose level is that of the gravest problem."""
    level = DiagnosticStatus.WARN if problems else DiagnosticStatus.OK
    if any(isinstance(text, Blocking) for text in problems):
        level = DiagnosticStatus.ERROR
    return DiagnosticStatus(
        level=level,
        name=name,
        hardware_id="tccm_ros",
        message="; ".join(problems) or "ok",
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
