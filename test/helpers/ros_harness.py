"""Fixtures for tests with rclpy: each test has its own context and domain."""

import fcntl
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
import rclpy
from live_robot import CYCLE_SCANS, START_NS, STEP_NS, Robot, is_connected, topics_of
from processes import PATIENCE_S
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

DOMAINS = range(1, 100)
"""Domains with ports below the ephemeral ones."""

ASK_AGAIN_S = 60.0
"""Time after which a request without a response is repeated, s: longer than any response takes."""

BETWEEN_NS = 5_000_000_000
"""Interval between recordings played to one process, ns: more than any wait in message time."""


def _lock(domain: int) -> Path:
    return Path(tempfile.gettempdir()) / f"tccm_ros_test_domain_{domain}.lock"


def _last_use(domain: int) -> float:
    """Return when a test in any process used a domain last, s."""
    with suppress(FileNotFoundError):
        return _lock(domain).stat().st_mtime
    return 0.0


@contextmanager
def own_domain() -> Iterator[int]:
    """Yield a domain that no other test on this machine uses, in any process.

    It is the one that was not used for longest: messages in flight from a test that is over would
    tell of nodes that are gone.
    """
    for domain in sorted(DOMAINS, key=_last_use):
        with _lock(domain).open("a") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            _lock(domain).touch()
            yield domain
            _lock(domain).touch()
            return
    raise RuntimeError("all domains are in use")


class Ros:
    """A context and an executor, with waits for conditions without sleeping."""

    def __init__(self, context: Context, domain: int):
        self.context = context
        self.domain = domain
        self.executor = SingleThreadedExecutor(context=context)
        self._nodes: list = []
        self._contexts: list[Context] = []
        self._start_ns = START_NS

    def another_context(self) -> Context:
        """Return the context of a second participant in the domain, as of another process."""
        context = Context()
        rclpy.init(context=context, domain_id=self.domain)
        self._contexts.append(context)
        return context

    def add(self, node):
        """Add a node to the executor; it is destroyed after the test."""
        self.executor.add_node(node)
        self._nodes.append(node)
        return node

    def node(self, name: str, **options) -> Node:
        """Add a node of the test, in a participant of its own, without parameter services and log.

        Each wait of the executor looks at all services of all its nodes.
        """
        options = {"start_parameter_services": False, "enable_rosout": False, **options}
        return self.add(Node(name, context=self.another_context(), **options))

    def remove(self, node) -> None:
        """Destroy a node, as if its process had ended; return when no other node lists it.

        Otherwise its endpoints could be mistaken for those of later nodes.
        """
        topics = topics_of(node)
        name = node.get_namespace(), node.get_name()
        self.executor.remove_node(node)
        self._nodes.remove(node)
        _end(node)
        self.spin_until(
            lambda: not any(_knows(other, name, topics) for other in self._nodes),
            what=f"the end of {name[1]}",
        )

    def connect(self, writer, reader, *topics: str) -> None:
        """Wait until the publishers of one node on some topics are matched with another node.

        Participants discover each other in pairs: a match with one reader, or an entry in the
        graph, does not imply a match with another reader.
        """
        for topic in topics:
            self.spin_until(
                lambda t=topic: is_connected(writer, reader, t),
                what=f"{reader.get_name()} to hear {topic}",
            )

    def robot(self, **options) -> Robot:
        """Return a robot that publishes scans of its lasers."""
        return Robot(self, **options)

    def start_of_recording(self, cycles: float) -> int:
        """Return the start stamp of the next recording of some tilt cycles, ns."""
        start_ns = self._start_ns
        self._start_ns += round(cycles * CYCLE_SCANS) * STEP_NS + BETWEEN_NS
        return start_ns

    def spin_until(
        self, predicate: Callable[[], object], timeout: float = PATIENCE_S, what: str = ""
    ) -> None:
        """Spin until the predicate holds, or fail."""
        end = time.monotonic() + timeout
        while not predicate():
            assert time.monotonic() < end, f"timed out: {what or predicate}"
            self.executor.spin_once(timeout_sec=0.02)

    def call(self, client, request):
        """Call a service and return its response.

        The response is lost if the client has discovered the service, but not the service the
        client; then the request is repeated.
        """
        self.spin_until(client.service_is_ready, what=client.srv_name)
        asked, ask_s, end = [], time.monotonic(), time.monotonic() + PATIENCE_S
        while not (answered := [future for future in asked if future.done()]):
            assert time.monotonic() < end, f"timed out: {client.srv_name}"
            if time.monotonic() >= ask_s:
                asked.append(client.call_async(request))
                ask_s += ASK_AGAIN_S
            self.executor.spin_once(timeout_sec=0.02)
        return answered[0].result()

    def close(self) -> None:
        for node in self._nodes:
            _end(node)
        self.executor.shutdown()
        for context in self._contexts:
            rclpy.try_shutdown(context=context)


def _knows(node, name: tuple[str, str], topics: Iterable[str]) -> bool:
    """Return whether a node still lists another among the endpoints of some topics."""
    return any(
        (end.node_namespace, end.node_name) == name
        for topic in topics
        for end in (
            *node.get_publishers_info_by_topic(topic),
            *node.get_subscriptions_info_by_topic(topic),
        )
    )


def _end(node) -> None:
    worker = getattr(node, "worker", None)
    if worker is not None:
        worker.close()
    node.destroy_node()


@pytest.fixture
def ros() -> Iterator[Ros]:
    with own_domain() as domain:
        context = Context()
        rclpy.init(context=context, domain_id=domain)
        harness = Ros(context, domain)
        yield harness
        harness.close()
        rclpy.try_shutdown(context=context)


@pytest.fixture
def domain() -> Iterator[int]:
    """Yield a domain for processes."""
    with own_domain() as number:
        yield number
