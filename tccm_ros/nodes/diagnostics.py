"""/diagnostics at 1 Hz: what comes in, what was dropped and why, and what to do."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from tccm_ros.nodes.clock import steady_timer
from tccm_ros.nodes.inputs import Blocking
from tccm_ros.nodes.refusals import kind_of

NAMES = {DiagnosticStatus.WARN: "the warning", DiagnosticStatus.ERROR: "the error"}

PERIOD_S = 1.0
"""Between two messages on /diagnostics, s: the rate that diagnostic_updater has by default."""


@dataclass(frozen=True, slots=True)
class InputStatus:
    """What is published of one input.

    Attributes
    ----------
    topic
        Resolved name.
    problems
        What is wrong with it, `Blocking` where the node cannot work without it.
    values
        Its figures.
    """

    topic: str
    problems: tuple[str, ...]
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
    said
        Returns problems that are logged elsewhere.
    """

    def __init__(
        self,
        node: Node,
        problems: Callable[[], Sequence[str]],
        values: Callable[[], Mapping[str, object]],
        inputs: Callable[[], Sequence[InputStatus]],
        said: Callable[[], Sequence[str]],
    ):
        self._node, self._problems, self._values, self._inputs = node, problems, values, inputs
        self._said = said
        self._logged: set[str] = set()
        self._level = DiagnosticStatus.OK
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._timer = steady_timer(node, PERIOD_S, self.publish)

    def publish(self) -> None:
        """Publish one DiagnosticArray, the node's own status first; log what is new."""
        if not self._node.context.ok():
            return
        problems = list(self._problems())
        kinds = {kind_of(text) for text in problems}
        for text in problems:
            if kind_of(text) not in self._logged:
                self._log(text)
        self._logged = kinds
        problems += self._said()
        self._say_better(problems)
        name = self._node.get_fully_qualified_name().lstrip("/")
        message = DiagnosticArray(status=[_status(name, problems, self._values())])
        for state in self._inputs():
            status = _status(f"{name}: {state.topic}", state.problems, state.values)
            message.status.append(status)
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def _say_better(self, problems: Sequence[str]) -> None:
        """Say that a level has gone down, and what is left."""
        before, self._level = self._level, _level(problems)
        if self._level < before:
            left = f"; still: {'; '.join(problems)}" if problems else ""
            self._node.get_logger().info(f"{NAMES[before]} is over{left}")

    def _log(self, text: str) -> None:
        logger = self._node.get_logger()
        if isinstance(text, Blocking):
            logger.error(text)
        else:
            logger.warning(text)


def _level(problems: Sequence[str]) -> bytes:
    """Return the level of the gravest problem."""
    if any(isinstance(text, Blocking) for text in problems):
        return bytes(DiagnosticStatus.ERROR)
    return bytes(DiagnosticStatus.WARN if problems else DiagnosticStatus.OK)


def _status(name: str, problems: Sequence[str], values: Mapping[str, object]) -> DiagnosticStatus:
    """Return a status whose level is that of the gravest problem."""
    return DiagnosticStatus(
        level=_level(problems),
        name=name,
        hardware_id="tccm_ros",
        message="; ".join(problems) or "ok",
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
