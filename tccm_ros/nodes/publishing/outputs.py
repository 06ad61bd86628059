"""Publishers that build a message only for subscribers, also for late ones.

Messages use the typestore's classes and are published serialised: a map of markers has thousands of
points, and rosidl's classes would make an object of each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.nodes.ros_types import message_class
from tccm_ros.ros.topic_messages import TopicMessage


def _create_publishers(
    node: Node,
    topics: Mapping[str, str],
    profile_of: Callable[[str], QoSProfile],
    on_listener: Callable[[str], object],
    shared: Iterable[str] = (),
) -> dict[str, Any]:
    """Return a publisher for each topic; `on_listener` is called with the topic of a new one."""

    def matched(name: str, info: Any) -> None:
        if info.current_count:
            on_listener(name)

    return {
        name: node.create_publisher(
            message_class(kind),
            name if name in shared else f"~/{name}",
            profile_of(name),
            event_callbacks=PublisherEventCallbacks(matched=partial(matched, name)),
        )
        for name, kind in topics.items()
    }


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
        Message types by topic name, which is private to the node.
    profiles
        QoS by topic name.
    post
        Queues a job for the worker.
    always
        Topics whose messages are all built and published, with or without subscribers.
    """

    def __init__(
        self,
        node: Node,
        types: TypestoreMessages,
        topics: Mapping[str, str],
        profiles: Mapping[str, QoSProfile],
        post: Callable[[Callable[[], None]], object],
        always: Iterable[str] = (),
    ):
        self._context = node.context
        self._types = types
        self._always = frozenset(always)
        self._newest: dict[str, TopicMessage] = {}
        self._publishers = _create_publishers(
            node, topics, profiles.__getitem__, lambda name: post(lambda: self._send(name))
        )

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
            newest = self._newest.pop(name)
            publisher.publish(bytes(self._types.serialize(newest.msgtype, newest.build())))


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
        self._publishers = _create_publishers(
            node, topics, lambda _: profile, lambda _: post(self._ask_for_unsent), shared
        )

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
