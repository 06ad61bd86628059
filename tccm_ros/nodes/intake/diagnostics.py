"""/diagnostics at 1 Hz: inputs, dropped records with reasons, and advice."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from tccm_ros.nodes.clock import steady_timer
from tccm_ros.nodes.intake.inputs import Blocking
from tccm_ros.nodes.intake.refusals import kind_of

NAMES = {DiagnosticStatus.WARN: "the warning", DiagnosticStatus.ERROR: "the error"}

PERIOD_S = 1.0
"""Period of /diagnostics, s: the default of diagnostic_updater."""


@dataclass(frozen=True, slots=True)
class InputStatus:
    """Diagnostics of one input.

    Attributes
    ----------
    topic
        Resolved name of the topic.
    problems
        Its problems, `Blocking` if the node cannot work without it.
    values
        Values to show.
    """

    topic: str
    problems: tuple[str, ...]
    values: Mapping[str, object]


class Diagnostics:
    """Publishes the states of the node and its inputs once a second; logs each new problem once.

    Parameters
    ----------
    node
        Node of the publisher.
    problems
        Returns the current problems, one line each; no problem is OK, a `Blocking` one an error.
    values
        Returns the values to show.
    inputs
        Returns the state of each input.
    said
        Returns the problems that are logged elsewhere.
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
        """Publish a DiagnosticArray, the node's own status first, and log new problems."""
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
        """Log that the level has decreased, with the remaining problems."""
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
    """Return the level of the most severe problem."""
    if any(isinstance(text, Blocking) for text in problems):
        return bytes(DiagnosticStatus.ERROR)
    return bytes(DiagnosticStatus.WARN if problems else DiagnosticStatus.OK)


def _status(name: str, problems: Sequence[str], values: Mapping[str, object]) -> DiagnosticStatus:
    """Return a status with the level of the most severe problem."""
    return DiagnosticStatus(
        level=_level(problems),
        name=name,
        hardware_id="tccm_ros",
        message="; ".join(problems) or "ok",
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
