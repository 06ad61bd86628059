"""The inputs of a node: subscriptions with message counts and diagnostics.

"Running but nothing published" is the most frequent complaint of users of such nodes. Each input
without a publisher, with another type, with an incompatible QoS or without messages is reported
with advice.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from tccm_ros.nodes.intake.intake import Intake
from tccm_ros.nodes.qos import subscription_events
from tccm_ros.nodes.ros_types import message_class

Watch = Literal["needed", "stream", "event"]
"""When a silent topic is a problem.

needed: without a publisher or before the first message; later pauses are normal, since many tilting
lasers and cameras only measure while the robot stands still. stream: whenever it has a publisher.
event: never.
"""

MAX_GAP = 100_000
"""A larger step of the sequence number means another publisher, not lost messages. Chosen."""


SAME_CLOCK_S = 60.0
"""A larger latency is ignored: the stamps come from a recording or another clock. Chosen."""


LATENCIES = 15
"""Number of records behind the median latency of an input. Chosen: 0.3 s of odometry, 15 s of a
slow camera; a single late record has no effect."""


class Blocking(str):
    """A problem that keeps the node from working; other problems are warnings."""

    __slots__ = ()


@dataclass(slots=True)
class Input:
    """One subscription with its counts.

    Attributes
    ----------
    topic
        Resolved name of the topic.
    name
        Name as subscribed to, before resolving.
    type_name
        ``package/msg/Name``.
    watch
        When its silence is a problem.
    count
        Number of messages received.
    lost
        Number of messages sent but not received, from the publisher's sequence numbers.
    last_ns
        Arrival time of the last message, ns of the node clock; None before the first.
    sequence
        Sequence number of the last message; None before the first or if the middleware has none.
    instead
        Topics that may be published in place of this one.
    refused
        Number of messages that could not be used.
    latency_s
        Arrival time minus stamp of the last record; None if the clocks are not comparable.
    latencies_s
        Latencies of the last records.
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
        """Note the arrival time and the stamp of a record."""
        latency_s = (arrival_ns - stamp_ns) * 1e-9
        self.latency_s = latency_s if abs(latency_s) < SAME_CLOCK_S else None
        if self.latency_s is None:
            self.latencies_s.clear()
        else:
            self.latencies_s.append(latency_s)

    def values(self, used: int | None) -> dict[str, object]:
        """Return the values for /diagnostics.

        Parameters
        ----------
        used
            Number of records that the processor has used; None for all that were read.
        """
        received = self.count
        used = received - self.refused if used is None else used
        return {
            "needed": self.watch,
            "expected": received + self.lost,
            "received": received,
            "used": min(used, received),
            "latency [s]": "" if self.latency_s is None else f"{self.latency_s:.3f}",
        }


class Inputs:
    """Subscribes to topics, counts messages and reports problems.

    Parameters
    ----------
    node
        The node that subscribes.
    silence_s
        An input without messages for this long, in s of the node clock, is a problem.
    intake
        Receives the messages; by default the node's executor does.
    max_lag_s
        An input that arrives this much later than the others, s, is a problem.
    """

    def __init__(
        self,
        node: Node,
        silence_s: float,
        intake: Intake | None = None,
        max_lag_s: float = math.inf,
    ):
        self._node = node
        self._intake = intake
        self._max_lag_s = max_lag_s
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
        """Subscribe to a topic and return its counts.

        Parameters
        ----------
        type_name
            ``package/msg/Name``.
        topic
            Relative to the node's namespace, before remapping.
        callback
            Called with each message, or with its bytes if `raw`.
        qos
            QoS of the subscription.
        watch
            When the topic's silence is a problem in /diagnostics.
        raw
            Whether messages are passed serialised (CDR).
        instead
            Resolved names of alternative topics; if one of them is published, this one is not
            needed.
        """
        name = self._node.resolve_topic_name(topic)
        entry = Input(name, topic, type_name, watch, instead=tuple(instead))
        self._inputs.append(entry)

        def counted(message: Any, info: Any) -> None:
            entry.last_ns = self._now()
            self._count_lost(entry, info["publication_sequence_number"])
            callback(message)
            entry.count += 1  # after the callback: a reader of the count finds the record queued

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
        """Destroy all subscriptions and forget their counts; the intake must be stopped."""
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
        """Return whether a topic, given by its resolved name, is subscribed to."""
        return any(entry.topic == topic for entry in self._inputs)

    def counts(self) -> dict[str, int]:
        """Return the number of messages received, by topic."""
        return {entry.topic: entry.count for entry in self._inputs}

    def lost(self) -> dict[str, int]:
        """Return the number of messages lost, by topic, for topics with losses."""
        return {entry.topic: entry.lost for entry in self._inputs if entry.lost}

    def late(self) -> dict[str, str]:
        """Return a sentence for each stream that lags behind the others, by topic."""
        latencies_s = {
            entry.topic: statistics.median(tuple(entry.latencies_s))
            for entry in self._inputs
            if entry.watch != "event" and len(entry.latencies_s) == LATENCIES
        }
        return lagging(latencies_s, self._max_lag_s)

    def awaited(self, optional: Collection[str] = ()) -> list[str]:
        """Return the topics without a message so far, except events and optional ones.

        Parameters
        ----------
        optional
            Resolved names of topics that may stay silent.
        """
        silent = (e for e in self._inputs if not e.count and e.watch != "event")
        return [entry.topic for entry in silent if entry.topic not in optional]

    def is_published(self, topic: str) -> bool:
        """Return whether a topic has a publisher."""
        return self._node.count_publishers(topic) > 0

    def is_absent(self, topic: str) -> bool:
        """Return whether a topic has had no publisher and no message for the silence period."""
        entry = next(e for e in self._inputs if e.topic == topic)
        return not entry.count and not self.is_published(topic) and self._is_silent(entry)

    def problems(self) -> list[str]:
        """Return one line for each silent or late input, with advice."""
        silent = [text for text in map(self.problem, self._inputs) if text]
        return [*silent, *self.late().values()]

    def problem(self, entry: Input) -> str | None:
        """Return why an input is silent, with advice; `Blocking` if the input is needed."""
        if self._start_ns is None:
            self._start_ns = self._now()
        text, is_needed = self._problem(entry), self._is_needed(entry)
        # A publisher that has sent nothing yet may be about to.
        is_awaited = not entry.count and self.is_published(entry.topic)
        return Blocking(text) if text and is_needed and not is_awaited else text

    def _now(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)

    def _count_lost(self, entry: Input, sequence: int | None) -> None:
        """Count gaps in the sequence numbers, if the topic has a single publisher."""
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
        if entry.watch == "event" or not self._is_silent(entry):
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
        """Return whether the input is needed and no alternative topic replaces it."""
        others = (other for other in self._inputs if other.topic in entry.instead)
        is_replaced = any(other.count or self.is_published(other.topic) for other in others)
        return entry.watch == "needed" and not is_replaced

    def _elsewhere(self, entry: Input) -> str:
        """Return a hint if a topic of the same name and type is published in another namespace."""
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
        """Return whether an input has sent nothing for the silence period.

        Once it has sent something, the time is that of the newest message of any input: inputs that
        stop together, as at the end of a drive or in a paused recording, are not silent.
        """
        now = self._now()
        if self._start_ns is None:
            return False
        if entry.last_ns is None:
            return now - self._start_ns > self._silence_ns
        entry.last_ns = min(entry.last_ns, now)  # the clock was set back
        newest = max((e.last_ns or 0 for e in self if e.watch != "event"), default=0)
        return min(newest, now) - entry.last_ns > self._silence_ns


def lagging(latencies_s: Mapping[str, float], limit_s: float) -> dict[str, str]:
    """Return a problem for each input that lags, by topic.

    An input is compared with the median of the others (the higher one of two), so that a single
    early input makes none of the others late.

    Parameters
    ----------
    latencies_s
        Latency from stamp to arrival, s, by topic.
    limit_s
        Tolerated lag, s: `sync_timeout`, for which records wait for each other.
    """
    found = {}
    for topic, latency_s in latencies_s.items():
        others = [s for name, s in latencies_s.items() if name != topic]
        if not others:
            continue
        usual_s = statistics.median_high(others)
        if latency_s - usual_s > limit_s:
            found[topic] = (
                f"'{topic}' comes {latency_s - usual_s:.1f} s later than the other inputs "
                f"({latency_s:.2f} s from stamp to arrival, the others {usual_s:.2f} s): look at "
                "its driver's queue and the network, or set the clock that stamps it; what it "
                "measures is used late or dropped, and poses and heights suffer"
            )
    return found
