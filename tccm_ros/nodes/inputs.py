"""The inputs of a node: subscriptions that are counted and watched.

"Running but nothing published" is what users of such nodes complain of most. Every input that has
no publisher, another type, an incompatible QoS or no messages is named, with what to do.
"""

from __future__ import annotations

import statistics
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from tccm_ros.nodes.intake import Intake
from tccm_ros.nodes.qos import subscription_events
from tccm_ros.nodes.ros_types import message_class

Watch = Literal["needed", "stream", "event"]
"""How the silence of a topic is rated.

needed: it is a problem until the first message, and so is the lack of a publisher; a pause is none,
as many tilting lasers and cameras measure while the robot stands. stream: it is a problem where
there is a publisher. event: it is none.
"""

MAX_GAP = 100_000
"""A larger step of a publisher's sequence number is another publisher, not a loss. Chosen."""


SAME_CLOCK_S = 60.0
"""A latency above this is none: stamps are a recording's, or another clock's. Chosen."""


LATENCIES = 15
"""Records whose median latency is compared with that of other inputs. Chosen: 0.3 s of odometry, 15
s of a slow camera; what arrives late once is none."""


class Blocking(str):
    """A problem that keeps the node from its work; other problems are warnings."""

    __slots__ = ()


@dataclass(slots=True)
class Input:
    """One subscription and what has come in.

    Attributes
    ----------
    topic
        Resolved name.
    name
        As it was subscribed to.
    type_name
        ``package/msg/Name``.
    watch
        How its silence is rated.
    count
        Messages received.
    lost
        Messages that were sent but not received, by the sequence numbers of publications.
    last_ns
        When the last message came, ns of the node clock; None before the first.
    sequence
        Of the last message; None before the first and where the middleware gives none.
    refused
        Messages that could not be used.
    latency_s
        Between the stamp and the arrival of the last record; None where that tells nothing.
    latencies_s
        Of the last records.
    """

    topic: str
    name: str
    type_name: str
    watch: Watch
    count: int = 0
    lost: int = 0
    last_ns: int | None = None
    sequence: int | None = None
    instead: tuple[str, ...] = ()
    refused: int = 0
    latency_s: float | None = None
    latencies_s: deque[float] = field(default_factory=lambda: deque(maxlen=LATENCIES))

    def note(self, arrival_ns: int, stamp_ns: int) -> None:
        """Note when a record came and its stamp."""
        latency_s = (arrival_ns - stamp_ns) * 1e-9
        self.latency_s = latency_s if abs(latency_s) < SAME_CLOCK_S else None
        if self.latency_s is None:
            self.latencies_s.clear()
        else:
            self.latencies_s.append(latency_s)


class Inputs:
    """Subscribes, counts, and tells what is wrong.

    Parameters
    ----------
    node
        The node that subscribes.
    silence_s
        An input without messages for this long, in s of the node clock, is a problem.
    intake
        Takes the messages; by default the node's executor does.
    """

    def __init__(self, node: Node, silence_s: float, intake: Intake | None = None):
        self._node = node
        self._intake = intake
        self._silence_ns = round(silence_s * 1e9)
        self._start_ns: int | None = None
        self._inputs: list[Input] = []
        self._subscriptions: list[Subscription] = []
        self._incompatible: dict[str, str] = {}

    def subscribe(
        self,
        type_name: str,
        topic: str,
        callback: Callable[[Any], None],
        qos: QoSProfile,
        *,
        watch: Watch = "needed",
        raw: bool = False,
        instead: Sequence[str] = (),
    ) -> Input:
        """Subscribe to a topic, and return what is counted of it.

        Parameters
        ----------
        type_name
            ``package/msg/Name``.
        topic
            Relative to the node's namespace, before remapping.
        callback
            Takes a message, or its bytes where `raw`.
        qos
            Of the subscription.
        watch
            How the topic's silence is rated in /diagnostics.
        raw
            Whether messages are given serialised (CDR).
        instead
            Resolved names of topics: where one of them is heard, this one is not needed.
        """
        name = self._node.resolve_topic_name(topic)
        entry = Input(name, topic, type_name, watch, instead=tuple(instead))
        self._inputs.append(entry)

        def counted(message: Any, info: Any) -> None:
            entry.last_ns = self._now()
            self._count_lost(entry, info["publication_sequence_number"])
            callback(message)
            entry.count += 1  # now, so that who sees the count finds the record queued

        def warn(text: str) -> None:
            self._incompatible[entry.topic] = text
            self._node.get_logger().warning(text)

        subscription = self._node.create_subscription(
            message_class(type_name),
            topic,
            counted,  # type: ignore[arg-type]  # the message's info is a second argument
            qos,
            raw=raw,
            callback_group=self._intake.group if self._intake else None,
            event_callbacks=subscription_events(entry.topic, warn),
        )
        self._subscriptions.append(subscription)
        if self._intake is not None:
            self._intake.add(subscription)
        return entry

    def unsubscribe(self) -> None:
        """End all subscriptions, of which nothing is known afterwards; the intake stands still."""
        for subscription in self._subscriptions:
            if self._intake is not None:
                self._intake.remove(subscription)
            self._node.destroy_subscription(subscription)
        self._subscriptions.clear()
        self._inputs.clear()
        self._incompatible.clear()
        self._start_ns = None

    def __iter__(self) -> Iterator[Input]:
        return iter(self._inputs)

    def has(self, topic: str) -> bool:
        """Return whether a topic is subscribed to; its name is resolved."""
        return any(entry.topic == topic for entry in self._inputs)

    def counts(self) -> dict[str, int]:
        """Return the messages received by topic."""
        return {entry.topic: entry.count for entry in self._inputs}

    def lost(self) -> dict[str, int]:
        """Return the messages that were sent but not received, by topic, where there are any."""
        return {entry.topic: entry.lost for entry in self._inputs if entry.lost}

    def latencies(self) -> dict[str, float]:
        """Return the median latency of each stream of measurements, s, by topic."""
        return {
            entry.topic: statistics.median(tuple(entry.latencies_s))
            for entry in self._inputs
            if entry.watch != "event" and len(entry.latencies_s) == LATENCIES
        }

    def awaited(self, optional: Collection[str] = ()) -> list[str]:
        """Return the topics that nothing has come on yet, without those that may stay silent.

        Parameters
        ----------
        optional
            Resolved names of such, beside events.
        """
        silent = (e for e in self._inputs if not e.count and e.watch != "event")
        return [entry.topic for entry in silent if entry.topic not in optional]

    def is_published(self, topic: str) -> bool:
        """Return whether there is a publisher of a topic."""
        return self._node.count_publishers(topic) > 0

    def is_absent(self, topic: str) -> bool:
        """Return whether nobody has published a topic for the time of a silence."""
        entry = next(e for e in self._inputs if e.topic == topic)
        return not entry.count and not self.is_published(topic) and self._is_silent(entry)

    def problems(self) -> list[str]:
        """Return one line for each input that gives nothing, and what to do about it."""
        return [text for text in map(self.problem, self._inputs) if text]

    def problem(self, entry: Input) -> str | None:
        """Return why an input gives nothing, `Blocking` where it is needed, and what to do."""
        if self._start_ns is None:
            self._start_ns = self._now()
        text, is_needed = self._problem(entry), self._is_needed(entry)
        # Who is there and has said nothing yet may be about to.
        is_awaited = not entry.count and self.is_published(entry.topic)
        return Blocking(text) if text and is_needed and not is_awaited else text

    def _now(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)

    def _count_lost(self, entry: Input, sequence: int | None) -> None:
        """Count gaps in the sequence numbers of the one publisher of a topic."""
        before, entry.sequence = entry.sequence, sequence
        if sequence is None or before is None or not 1 < sequence - before < MAX_GAP:
            return
        if self._node.count_publishers(entry.topic) == 1:
            entry.lost += sequence - before - 1

    def _problem(self, entry: Input) -> str | None:
        publishers = self._node.get_publishers_info_by_topic(entry.topic)
        others = sorted({p.topic_type for p in publishers} - {entry.type_name})
        if others and entry.count == 0:
            return (
                f"'{entry.topic}' is published as {', '.join(others)}, {entry.type_name} is "
                "expected; remap the topic"
            )
        if entry.topic in self._incompatible and entry.count == 0:
            return self._incompatible[entry.topic]
        if entry.watch == "event" or not self._is_silent(entry) or self._has_ended(entry):
            return None
        if not publishers and (self._is_needed(entry) or entry.count):
            instead = "".join(f" or '{topic}'" for topic in entry.instead if not entry.count)
            return (
                f"nobody publishes '{entry.topic}'{instead}; start its driver, or remap the topic"
                f"{self._elsewhere(entry)}"
            )
        if not publishers or (entry.watch == "needed" and entry.count):
            return None
        if not entry.count:
            return (
                f"waits for '{entry.topic}': {len(publishers)} publisher(s) are there and have "
                "sent nothing yet; if that goes on, look at the driver, its QoS and the network"
            )
        return (
            f"'{entry.topic}' is silent; {len(publishers)} publisher(s) are there: "
            "look at the driver, its QoS and the network"
        )

    def _is_needed(self, entry: Input) -> bool:
        """Return whether the node works with nothing else: what a robot lacks it does without."""
        others = (other for other in self._inputs if other.topic in entry.instead)
        is_replaced = any(other.count or self.is_published(other.topic) for other in others)
        return entry.watch == "needed" and not is_replaced

    def _has_ended(self, entry: Input) -> bool:
        """Return whether all inputs have ended together, as a drive or a recording does."""
        return entry.count > 0 and all(e.watch == "event" or self._is_silent(e) for e in self)

    def _elsewhere(self, entry: Input) -> str:
        """Return where a topic of the same name and type is published."""
        name = entry.topic.rpartition("/")[2]
        found = [
            topic
            for topic, types in self._node.get_topic_names_and_types()
            if topic != entry.topic
            and topic.rpartition("/")[2] == name
            and entry.type_name in types
            and self.is_published(topic)
        ]
        if not found:
            return ""
        return f" ({', '.join(found)} is published: is the node in the right namespace?)"

    def _is_silent(self, entry: Input) -> bool:
        now = self._now()
        since = entry.last_ns if entry.last_ns is not None else self._start_ns
        if since is None:
            return False
        if since > now:  # the clock was set back
            entry.last_ns = since = now
        return now - since > self._silence_ns
