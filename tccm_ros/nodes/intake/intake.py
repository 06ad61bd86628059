"""Intake of sensor messages in a separate thread, without the cost of an executor.

For each callback, an executor of rclpy builds a wait set of all entities of its nodes (services,
timers, events, subscriptions), a task and two coroutines, and wakes up once more afterwards: a
millisecond of processor time. A laser, joints and odometry are 200 messages a second. The intake
waits for subscriptions alone, in one wait set, as `rclpy.wait_for_message` does; an executor
handles the rest of the node. The intake also waits for the events of its subscriptions (an
incompatible QoS), because with Fast DDS their waiter wakes up at each message, and for timers of a
high rate.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from typing import Any, cast

from rclpy.callback_groups import CallbackGroup
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.timer import Timer

LOOK_NS = 500_000_000
"""Period of the check for a context shutdown, ns: a signal shuts it down without waking the wait
set. Chosen."""


class Intake:
    """Runs the callbacks of subscriptions and frequent timers in a separate thread.

    Parameters
    ----------
    node
        Its subscriptions and timers must be created in the callback group `group`.
    on_error
        Called in the thread with the exception of a callback; the intake continues.

    Attributes
    ----------
    group
        Callback group that executors ignore.
    """

    def __init__(self, node: Node, on_error: Callable[[Exception], None]):
        self.group = _Kept()
        self._context = node.context
        self._on_error = on_error
        self._subscriptions: list[Subscription] = []
        self._timers: list[Timer] = []
        self._is_done = False
        self._stop = GuardCondition(None, None, context=node.context)
        self._name = f"{node.get_name()} intake"
        self._thread: threading.Thread | None = None

    def add(self, subscription: Subscription) -> None:
        """Receive the messages of a subscription from the next `start` on."""
        self._subscriptions.append(subscription)

    def remove(self, subscription: Subscription) -> None:
        """Stop receiving the messages of a subscription; the intake must be stopped."""
        self._subscriptions.remove(subscription)

    def add_timer(self, timer: Timer) -> None:
        """Run a timer's callback when it is due, from the next `start` on."""
        self._timers.append(timer)

    def start(self) -> None:
        """Start or restart the thread, with everything added since the last start."""
        self.stop()
        self._is_done = False
        self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread for good; queued messages are not received."""
        self.stop()
        self._stop.destroy()

    def stop(self) -> None:
        """End the thread until the next `start`; messages stay queued in between."""
        self._is_done = True
        with suppress(_rclpy.RCLError, _rclpy.InvalidHandle):
            self._stop.trigger()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _run(self) -> None:
        context = self._context.handle
        if context is None:
            return
        # Another node of the process may add entities; they count from the next start on.
        subscriptions, timers = tuple(self._subscriptions), tuple(self._timers)
        entities: list[Any] = [*subscriptions, *timers]
        events: list[Any] = []
        for subscription in subscriptions:
            events += cast("list[Any]", subscription.event_handlers)
        with ExitStack() as held, suppress(_rclpy.InvalidHandle):
            for owner in (context, self._stop.handle, *(e.handle for e in entities), *events):
                held.enter_context(owner)
            size = len(subscriptions), 1, len(timers), 0, 0, len(events)
            wait_set = _rclpy.WaitSet(*size, context)
            while self._context.ok() and not self._is_done:
                try:
                    self._wait(wait_set, subscriptions, timers, events)
                except _rclpy.RCLError:
                    # A signal shuts the context down at any moment.
                    if self._context.ok():
                        raise

    def _wait(
        self,
        wait_set: Any,
        subscriptions: Sequence[Subscription],
        timers: Sequence[Timer],
        events: Sequence[Any],
    ) -> None:
        """Wait until an entity is ready and run the callbacks of all that are."""
        wait_set.clear_entities()
        for subscription in subscriptions:
            wait_set.add_subscription(subscription.handle)
        for timer in timers:
            wait_set.add_timer(timer.handle)
        for event in events:
            event.add_to_wait_set(wait_set)
        wait_set.add_guard_condition(self._stop.handle)
        wait_set.wait(LOOK_NS)
        ready = wait_set.get_ready_entities("subscription")
        due = wait_set.get_ready_entities("timer")
        for subscription in subscriptions:
            if self._is_done:  # messages not taken stay queued for the next start
                return
            if subscription.handle.pointer in ready:
                handle = subscription.handle
                taken = handle.take_message(subscription.msg_type, subscription.raw)
                self._call(subscription.callback, taken)
        for timer in timers:
            if timer.handle.pointer in due and timer.handle.is_timer_ready():
                timer.handle.call_timer()
                self._call(timer.callback, ())
        for event in events:
            if event.is_ready(wait_set):
                data = event.take_data()
                self._call(event.callback, None if data is None else (data,))

    def _call(self, callback: Callable[..., object], taken: tuple[Any, ...] | None) -> None:
        if taken is None:
            return
        try:
            callback(*taken)
        except Exception as error:
            if self._context.ok():
                self._on_error(error)


class _Kept(CallbackGroup):
    """A callback group whose callbacks no executor runs."""

    def can_execute(self, entity: Any) -> bool:
        return False

    def beginning_execution(self, entity: Any) -> bool:
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing: executions are not counted."""
