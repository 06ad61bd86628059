"""Sensor messages, taken by a thread that waits for nothing else.

An executor of rclpy makes, for each callback, a wait set of all that its nodes have (services,
timers, events, subscriptions), a task and two coroutines, and wakes up once more after it: a
millisecond of processor time. A laser, joints and odometry are 200 messages a second. Here the
subscriptions alone are waited for, in one wait set, as `rclpy.wait_for_message` does; executors
have the rest of the node as ever. The events of a subscription (an incompatible QoS) are waited for
here as well: with Fast DDS, who waits for these wakes up at each message. So are timers of a high
rate.
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
"""Period, ns, at which is checked whether the context was shut down, which a signal does without
notice. Chosen."""


class Intake:
    """Calls the callbacks of subscriptions and quick timers, in a thread of its own.

    Parameters
    ----------
    node
        Its subscriptions and timers are to be made in the callback group `group`.
    on_error
        Called in the thread with what a callback raised; the intake goes on.

    Attributes
    ----------
    group
        Keeps executors from what is in it.
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
        """Take the messages of a subscription, from the next `start` on."""
        self._subscriptions.append(subscription)

    def remove(self, subscription: Subscription) -> None:
        """Take no messages of a subscription any more, while the intake stands still."""
        self._subscriptions.remove(subscription)

    def add_timer(self, timer: Timer) -> None:
        """Call a timer back when it is due, from the next `start` on."""
        self._timers.append(timer)

    def start(self) -> None:
        """Take messages from now on, also those of what was added since the last start."""
        self.stop()
        self._is_done = False
        self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread; messages that wait are not taken any more."""
        self.stop()
        self._stop.destroy()

    def stop(self) -> None:
        """Stand still until the next `start`; messages that wait are not taken before."""
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
        # Another node of the process may add to them: those count from the next start on.
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
        """Wait for something and take it."""
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
            if self._is_done:  # what is not taken waits for the next start
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
    """A callback group whose callbacks no executor takes."""

    def can_execute(self, entity: Any) -> bool:
        return False

    def beginning_execution(self, entity: Any) -> bool:
        return False

    def ending_execution(self, entity: Any) -> None:
        """Nothing is counted."""
