"""Publishers that build a message only for subscribers, also for late ones.

Messages use the typestore's classes and are published serialised: a map of markers has thousands of
points, and rosidl's classes would make an object of each.
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
    """Publishers of a node's newest result on private topics.

    Messages are built in the worker thread, which owns the results.

    Parameters
    ----------
    node
        Node of the publishers.
    types
        Message classes.
    topics
        Message types by topic name; a name is private to the node unless it is in `shared`.
    profiles
        QoS by topic name.
    post
        Queues a job for the worker.
    always
        Topics whose messages are all built and published, with or without subscribers.
    shared
        Topics in the node's namespace.

    Attributes
    ----------
    built
        Number of messages built since the start.
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
        """Publish topics with subscribers; keep the others for later (in the worker)."""
        for message in messages:
            self._newest[message.topic] = message
            self._send(message.topic)

    def _send(self, name: str) -> None:
        """Publish the newest message of a topic if it is unsent and has a subscriber.

        Nothing is published after a stop signal, because the context is no longer valid.
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
    """Publishers of a node whose messages the solver process builds.

    Parameters
    ----------
    node
        Node of the publishers.
    topics
        Message types by topic name; a name is private to the node unless it is in `shared`.
    profile
        QoS of all topics.
    ask
        Requests messages of the newest solution, which arrive by `publish` (in the worker).
    post
        Queues a job for the worker.
    shared
        Topics in the node's namespace.
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
        """Topics with subscribers."""
        if not self._context.ok():
            return frozenset()
        return frozenset(n for n, p in self._publishers.items() if p.get_subscription_count())

    def publish_solution(self, messages: Mapping[str, bytes]) -> None:
        """Publish the messages of a new solution; later subscribers request theirs."""
        self._unsent = set(self._publishers)
        self.publish(messages)
        self._ask_for_unsent()

    def publish(self, messages: Mapping[str, bytes]) -> None:
        """Publish messages of the newest solution; nothing after a stop signal."""
        if self._context.ok():
            for name, message in messages.items():
                self._publishers[name].publish(message)
                self._unsent.discard(name)

    def forget(self) -> None:
        """Request no messages until the next solution."""
        self._unsent.clear()

    def _ask_for_unsent(self) -> None:
        wanted = self.listened & self._unsent
        if wanted:
            self._ask(wanted)
