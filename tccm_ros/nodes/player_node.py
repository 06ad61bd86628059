"""player_node: plays a bag where `ros2 bag` is not installed.

Topics are remapped as in every node (``-r /scan:=/base_scan``). Messages are published in their
recorded serialised form.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.duration import Duration
from rclpy.exceptions import InvalidParameterTypeException, ParameterUninitializedException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from tccm_ros.bags.reader import BagMessage, BagReader
from tccm_ros.errors import BagError, ConfigError
from tccm_ros.nodes.clock import steady_timer
from tccm_ros.nodes.params import type_advice, warn_of_unknown
from tccm_ros.nodes.qos import SENSOR_DEPTH
from tccm_ros.nodes.ros_types import RosidlMessages, message_class
from tccm_ros.nodes.run import run
from tccm_ros.nodes.timeline import Timeline
from tccm_ros.ros.types import stamp_message

TICK_S = 0.002
"""Period of the check for due messages, s. Chosen: a fifth of the period of a topic at 100 Hz."""

CLOCK_PERIOD_NS = 10_000_000
"""Period of /clock, ns of wall time: 100 Hz, the maximum of `ros2 bag play`."""

BURST = 100
"""Maximum number of messages published in a tick. Chosen: other callbacks get their turn, and
queues of `qos.SENSOR_DEPTH` hold the messages after a delay."""

STABLE_S = 0.5
"""The set of subscribers must be unchanged for this time before playing starts, s. Chosen: nodes
are discovered one after another."""

ACK_TIMEOUT = Duration(seconds=10)
"""Timeout for acknowledgements by subscribers at the end of the bag. Chosen."""

PARAMETERS = {
    "bag": ("", "rosbag2 folder, .mcap or .db3 file"),
    "rate": (1.0, "seconds of the bag in a second"),
    "start": (0.0, "seconds of the bag to skip"),
    "duration": (0.0, "seconds of the bag to play; 0 to its end"),
    "loop": (False, "start over at the end"),
    "paused": (False, "start paused"),
    "clock": (True, "publish /clock"),
    "wait_for_subscribers": (0.0, "longest wait for the subscribers of each topic, s; 0 none"),
    "topics": ([""], "topics to play; empty: all"),
    "reliable": (False, "offer every topic reliably, whatever the bag's publishers offered"),
}


class PlayerNode(Node):
    """Publishes the messages of a bag at their times.

    Attributes
    ----------
    is_done
        Whether the end is reached and all reliable subscribers have acknowledged it.
    sent
        Number of messages published, by topic.
    """

    def __init__(self, **kwargs: Any):
        super().__init__("player", **kwargs)
        for name, (default, meaning) in PARAMETERS.items():
            self._declare(name, default, meaning)
        warn_of_unknown(self, PARAMETERS)
        self.is_done = False
        self.sent: Counter[str] = Counter()
        self._reader = BagReader(_bag_path(self._value("bag")))
        self._start_ns = self._reader.start_ns + round(self._skipped() * 1e9)
        rate = self._value("rate")
        if not rate > 0.0:
            raise ConfigError(f"parameter rate: {rate} found, a positive number is expected")
        self._timeline = Timeline(self._start_ns, rate, is_paused=self._value("paused"))
        self._types = RosidlMessages()
        self._publishers_by_topic = self._advertise()
        self._clock_publisher = (
            self.create_publisher(Clock, "/clock", 10) if self._value("clock") else None
        )
        self._waiting_since_ns: int | None = None
        self._matched: dict[str, int] = {}
        self._matched_since_ns = 0
        self._clock_due_ns = 0
        self._messages = self._open()
        self._next = next(self._messages, None)
        self.create_service(SetBool, "~/pause", self._on_pause)
        if self._timeline.is_paused:
            self.get_logger().info("ready; paused, waits for ~/pause")
        # A timer on the wall clock, because this node may itself publish the node clock.
        self._timer = steady_timer(self, TICK_S, self._tick)

    @property
    def published(self) -> int:
        """Total number of messages published."""
        return self.sent.total()

    def close(self) -> None:
        """Close the bag."""
        self._reader.close()

    # --- set up ---

    def _declare(self, name: str, default: object, meaning: str) -> None:
        try:
            self.declare_parameter(name, default, ParameterDescriptor(description=meaning))
        except InvalidParameterTypeException:
            wanted = RosParameter.Type.from_parameter_value(default)
            advice = type_advice(wanted, self._parameter_overrides[name].value)
            raise ConfigError(f"parameter {name}: {advice}") from None

    def _value(self, name: str) -> Any:
        try:
            return self.get_parameter(name).value
        except ParameterUninitializedException:  # an empty list, which has no type
            return PARAMETERS[name][0]

    def _skipped(self) -> float:
        """Return the parameter `start`, s."""
        start = float(self._value("start"))
        length = (self._reader.end_ns - self._reader.start_ns) * 1e-9
        if not 0.0 <= start <= length:
            raise ConfigError(f"parameter start: {start} found, the bag has 0 to {length:.1f} s")
        return start

    def _topics(self) -> dict[str, str]:
        wanted = {topic for topic in self._value("topics") if topic}
        known = {info.name: info.msgtype for info in self._reader.topics()}
        if wanted - set(known):
            absent = ", ".join(sorted(wanted - set(known)))
            raise BagError(f"{self._reader.path}: no topic {absent}; there are: {', '.join(known)}")
        return {name: kind for name, kind in known.items() if not wanted or name in wanted}

    def _advertise(self) -> dict[str, Publisher]:
        publishers = {}
        for topic, msgtype in self._topics().items():
            try:
                kind = message_class(msgtype)
            except (ImportError, AttributeError):
                self.get_logger().warning(f"{topic} is not played: {msgtype} is not installed")
                continue
            publishers[topic] = self.create_publisher(kind, topic, self._profile(topic))
        return publishers

    def _profile(self, topic: str) -> QoSProfile:
        offered = self._reader.qos(topic)
        return QoSProfile(
            depth=max(offered.depth, SENSOR_DEPTH),
            reliability=ReliabilityPolicy.RELIABLE
            if offered.reliable or self._value("reliable")
            else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL
            if offered.latched
            else DurabilityPolicy.VOLATILE,
        )

    def _open(self) -> Iterator[BagMessage]:
        duration = self._value("duration")
        if not duration >= 0.0:
            raise ConfigError(f"parameter duration: {duration} found, 0 or more is expected")
        end_ns = self._start_ns + round(duration * 1e9) if duration > 0.0 else None
        latched = {topic for topic in self._publishers_by_topic if self._reader.qos(topic).latched}
        for message in self._reader.messages(self._publishers_by_topic):
            if end_ns is not None and message.log_ns > end_ns:
                return
            if message.log_ns >= self._start_ns or message.topic in latched:
                yield message

    # --- playing ---

    def _tick(self) -> None:
        now = time.monotonic_ns()
        if self.is_done or not self._is_ready(now):
            return
        due_ns = self._timeline.now(now)
        for _ in range(BURST):
            if self._next is None or self._next.log_ns > due_ns:
                break
            self._publish(self._next)
            self._next = next(self._messages, None)
        self._tell_time(now, due_ns)
        if self._next is None:
            self._end(now)

    def _tell_time(self, now: int, due_ns: int) -> None:
        """Publish /clock if it is due, and at the end."""
        if self._clock_publisher is None or (now < self._clock_due_ns and self._next is not None):
            return
        self._clock_due_ns = now + CLOCK_PERIOD_NS
        played = min(due_ns, self._reader.end_ns if self._next is None else self._next.log_ns)
        self._clock_publisher.publish(Clock(clock=stamp_message(self._types, played)))

    def _is_ready(self, now: int) -> bool:
        """Return whether playing has begun; begin it when all topics have subscribers."""
        if self._timeline.is_running or self._timeline.is_paused:
            return not self._timeline.is_paused
        is_first_look = self._waiting_since_ns is None
        self._waiting_since_ns = self._waiting_since_ns or now
        waited = (now - self._waiting_since_ns) * 1e-9
        lonely = self._find_lonely()
        if waited < self._value("wait_for_subscribers") and (
            lonely or not self._are_subscribers_stable(now)
        ):
            if is_first_look and lonely:
                self.get_logger().info(f"ready; waits for subscribers of {', '.join(lonely)}")
            return False
        self.get_logger().info(f"plays {self._value('bag')}")
        self._timeline.run(now)
        return True

    def _find_lonely(self) -> list[str]:
        """Return the topics without a subscriber, or with one that is not matched yet."""
        return [
            topic
            for topic, publisher in self._publishers_by_topic.items()
            if publisher.get_subscription_count() < max(1, self.count_subscribers(topic))
        ]

    def _are_subscribers_stable(self, now: int) -> bool:
        """Return whether the set of subscribers has been unchanged for `STABLE_S`."""
        matched = {t: p.get_subscription_count() for t, p in self._publishers_by_topic.items()}
        if matched != self._matched:
            self._matched, self._matched_since_ns = matched, now
        return (now - self._matched_since_ns) * 1e-9 >= STABLE_S

    def _publish(self, message: BagMessage) -> None:
        publisher = self._publishers_by_topic[message.topic]
        publisher.publish(message.data)
        self.sent[message.topic] += 1
        if self.sent[message.topic] == 1:
            self._await_readers(publisher)

    def _await_readers(self, publisher: Publisher) -> None:
        """Pause until the subscribers have received the first message of a topic.

        A publisher is notified of a match before the subscriber, and keeps only its queue depth of
        messages for that subscriber. Best-effort subscribers acknowledge nothing and are not waited
        for.
        """
        patience = float(self._value("wait_for_subscribers"))
        if patience > 0.0:
            self._timeline.pause(time.monotonic_ns())
            publisher.wait_for_all_acked(Duration(seconds=patience))
            self._timeline.run(time.monotonic_ns())

    def _end(self, now: int) -> None:
        if self._value("loop"):
            self._messages = self._open()
            self._next = next(self._messages, None)
            self._timeline.rewind(self._start_ns, now)
            return
        for publisher in self._publishers_by_topic.values():
            publisher.wait_for_all_acked(ACK_TIMEOUT)
        self.get_logger().info(f"played {self.published} messages")
        self.is_done = True

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> Any:
        now = time.monotonic_ns()
        if request.data:
            self._timeline.pause(now)
        else:
            self._timeline.run(now)
        response.success = True
        return response


def _bag_path(text: str) -> Path:
    if not text:
        raise ConfigError("parameter bag is empty; write -p bag:=PATH")
    return Path(text).expanduser()


def usage() -> str:
    """Return the usage text with the player's parameters."""
    lines = [f"  {name:22}{meaning} [{default}]" for name, (default, meaning) in PARAMETERS.items()]
    return "\n".join(
        [
            "usage: player_node --ros-args -p bag:=PATH [-p name:=value ...] [-r from:=to ...]",
            "parameters [default]:",
            *lines,
        ]
    )


def main() -> None:
    """Play a bag and exit at its end."""
    run(PlayerNode, usage=usage())
