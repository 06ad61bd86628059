"""Publishers that build a message only when someone listens, and again for a late viewer.

Messages are made of the typestore's classes and published as bytes: a map of markers has thousands
of points, each of which would be an object of rosidl's classes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.nodes.ros_types import message_class
from tccm_ros.ros.topic_messages import TopicMessage


class Outputs:
    """The private topics of a node that show its newest result.

    Messages are built in the thread of the worker that owns the results.

    Parameters
    ----------
    node
        The node that publishes.
    types
        Message classes of what is published.
    topics
        Types by topic name; the name is private to the node, unless it is in `shared`.
    profiles
        QoS by topic name.
    post
        Has a job done by the worker.
    always
        Topics of which every message is built and sent, listened to or not.
    shared
        Topics in the namespace of the node.

    Attributes
    ----------
    built
        Messages built since the start.
    """

    def __init__(
        self,
        node: Node,
        types: TypestoreMessages,
        topics: Mapping[str, str],
        profiles: Mapping[str, QoSProfile],
        post: Callable[[Callable[[], None]], object],
        always: Iterable[str] = (),
        shared: Iterable[str] = (),
    ):
        self._context = node.context
        self._types = types
        self._always = frozenset(always)
        self._post = post
        self._newest: dict[str, TopicMessage] = {}
        self.built = 0
        self._publishers = {
            name: node.create_publisher(
                message_class(kind),
                name if name in shared else f"~/{name}",
                profiles[name],
                event_callbacks=PublisherEventCallbacks(matched=self._on_match(name)),
            )
            for name, kind in topics.items()
        }

    def publish(self, messages: Iterable[TopicMessage]) -> None:
        """Publish what is listened to; keep the rest for who comes later (in the worker)."""
        for message in messages:
            self._newest[message.topic] = message
            self._send(message.topic)

    def _send(self, name: str) -> None:
        """Send the newest message of a topic, if it was not sent and somebody listens.

        Nothing is published once the node is told to stop: its context is gone by then.
        """
        if name not in self._newest or not self._context.ok():
            return
        publisher = self._publishers[name]
        if name in self._always or publisher.get_subscription_count():
            self.built += 1
            newest = self._newest.pop(name)
            publisher.publish(bytes(self._types.serialize(newest.msgtype, newest.build())))

    def _on_match(self, name: str) -> Any:
        def matched(info: Any) -> None:
            if info.current_count:
                self._post(lambda: self._send(name))

        return matched


class SolutionOutputs:
    """The topics of a node whose messages another process builds.

    Parameters
    ----------
    node
        The node that publishes.
    topics
        Types by topic name; the name is private to the node, unless it is in `shared`.
    profile
        QoS of all.
    ask
        Asks for messages of the newest solution, which come by `publish` (in the worker).
    post
        Has a job done by the worker.
    shared
        Topics in the namespace of the node.
    """

    def __init__(
        self,
        node: Node,
        topics: Mapping[str, str],
        profile: QoSProfile,
        ask: Callable[[frozenset[str]], None],
        post: Callable[[Callable[[], None]], object],
        shared: Iterable[str] = (),
    ):
        self._context, self._ask = node.context, ask
        self._unsent: set[str] = set()

        def matched(info: Any) -> None:
            if info.current_count:
                post(self._ask_for_unsent)

        self._publishers = {
            name: node.create_publisher(
                message_class(kind),
                name if name in shared else f"~/{name}",
                profile,
                event_callbacks=PublisherEventCallbacks(matched=matched),
            )
            for name, kind in topics.items()
        }

    @property
    def listened(self) -> frozenset[str]:
        """Topics that somebody listens to."""
        if not self._context.ok():
            return frozenset()
        return frozenset(n for n, p in self._publishers.items() if p.get_subscription_count())

    def publish_solution(self, messages: Mapping[str, bytes]) -> None:
        """Publish what was asked for of a new solution; the rest when somebody listens."""
        self._unsent = set(self._publishers)
        self.publish(messages)
        self._ask_for_unsent()

    def publish(self, messages: Mapping[str, bytes]) -> None:
        """Publish messages of the newest solution; nothing once the node is told to stop."""
        if self._context.ok():
            for name, message in messages.items():
                self._publishers[name].publish(message)
                self._unsent.discard(name)

    def forget(self) -> None:
        """Ask for nothing before the next solution."""
        self._unsent.clear()

    def _ask_for_unsent(self) -> None:
        wanted = self.listened & self._unsent
        if wanted:
            self._ask(wanted)
