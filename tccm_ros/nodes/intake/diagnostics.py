"""/diagnostics at 1 Hz: inputs, dropped records with reasons, and advice."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from tccm_ros.nodes.clock import steady_timer
from tccm_ros.nodes.intake.inputs import Blocking, Inputs
from tccm_ros.nodes.intake.refusals import Refusals, kind_of

NAMES = {DiagnosticStatus.WARN: "the warning", DiagnosticStatus.ERROR: "the error"}

PERIOD_S = 1.0
"""Period of /diagnostics, s: the default of diagnostic_updater."""


class Diagnostics:
    """Publishes the states of the node and its inputs once a second; logs each new problem once.

    Parameters
    ----------
    node
        Node of the publisher.
    inputs, refusals
        Inputs of the node, and their messages that were refused, which are logged there.
    problems
        Returns the current problems, one line each; no problem is OK, a `Blocking` one an error.
    values
        Returns the values to show.
    used
        Returns the number of records that the processor has used, by resolved topic.
    """

    def __init__(
        self,
        node: Node,
        inputs: Inputs,
        refusals: Refusals,
        problems: Callable[[], Sequence[str]],
        values: Callable[[], Mapping[str, object]],
        used: Callable[[], Mapping[str, int]],
    ):
        self._node, self._inputs, self._refusals = node, inputs, refusals
        self._problems, self._values, self._used = problems, values, used
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
        problems += self._refusals.problems()
        self._say_better(problems)
        name = self._node.get_fully_qualified_name().lstrip("/")
        message = DiagnosticArray(status=[_status(name, problems, self._values())])
        late, used = self._inputs.late(), self._used()
        for entry in self._inputs:
            topic = entry.topic
            found = self._refusals.problem(entry.name), self._inputs.problem(entry), late.get(topic)
            values = entry.values(used.get(topic))
            status = _status(f"{name}: {topic}", [text for text in found if text], values)
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


def message_counts(
    inputs: Inputs, refusals: Refusals, dropped: Mapping[str, int]
) -> dict[str, object]:
    """Return the counts of messages by topic, and of dropped records by reason."""
    received = {f"received {topic}": n for topic, n in inputs.counts().items()}
    lost = {f"lost {topic}": n for topic, n in inputs.lost().items()}
    refused = {f"refused {topic}": n for topic, n in sorted(refusals.counts.items())}
    reasons = {f"dropped: {why}": n for why, n in sorted(dropped.items())}
    return {**received, **lost, **refused, **reasons}
