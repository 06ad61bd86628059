"""Stamps and jumps of the node clock."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rclpy.clock import Clock, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.timer import Timer

PATIENCE_S = 1.0
"""Stamps that follow a step of the clock do so within this time, or came this much before it."""


class ClockWatch:
    """Reports a backward jump of the node clock that the message stamps did not follow.

    Where records come, their own stamps tell the step (`robot.StampGuard`), and tell exactly which
    records are from before: /clock overtakes them, or comes late. So their word is waited for.

    Parameters
    ----------
    node
        Its clock is watched.
    threshold_s
        Smaller steps are none.
    callback
        Called with a reason, in the executor, when the stamps have said nothing for `PATIENCE_S`.
    """

    def __init__(self, node: Node, threshold_s: float, callback: Callable[[str], None]):
        self._callback = callback
        self._told_s = -math.inf
        self._timer: Timer | None = None
        self._node = node
        threshold = JumpThreshold(
            min_forward=None,
            min_backward=Duration(nanoseconds=-round(threshold_s * 1e9)),
            on_clock_change=False,
        )
        # The callback is gone with its handle.
        self._handle = node.get_clock().create_jump_callback(threshold, post_callback=self._jumped)

    def note_stamps(self) -> None:
        """Note that the stamps of the records went back."""
        self._told_s = time.monotonic()

    @property
    def just_went_back(self) -> bool:
        """Whether the stamps of the records went back a moment ago."""
        return time.monotonic() < self._told_s + PATIENCE_S

    def close(self) -> None:
        """Report nothing any more."""
        self._end_timer()
        self._handle.unregister()

    def _jumped(self, jump: TimeJump) -> None:
        stepped_s = time.monotonic()
        reason = f"the clock stepped back by {-jump.delta.nanoseconds * 1e-9:.1f} s"

        def look() -> None:
            self._end_timer()
            if self._told_s < stepped_s - PATIENCE_S:
                self._callback(reason)

        self._end_timer()
        self._timer = steady_timer(self._node, PATIENCE_S, look)

    def _end_timer(self) -> None:
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
            self._timer = None


def stamp_on_receipt(
    node: Node, record: Any, time_span: Callable[[Any], tuple[int, int]] | None = None
) -> Any:
    """Return a record with the time of its arrival, for drivers that have no clock.

    What a sensor measures over a time span is sent at its end: its stamp is so much earlier.

    Parameters
    ----------
    node
        Its clock is read.
    record
        Records without a stamp (a robot description) are returned as they are.
    time_span
        Gives the first and last ns of a record; None for what is measured at one time.
    """
    if not hasattr(record, "stamp_ns"):
        return record
    arrival_ns = int(node.get_clock().now().nanoseconds)
    if time_span is not None:
        arrival_ns -= time_span(record)[1] - record.stamp_ns
    return replace(record, stamp_ns=max(arrival_ns, 0))


def steady_timer(node: Node, period_s: float, callback: Callable[[], None]) -> Any:
    """Return a timer that also runs while the node clock stands still, as without /clock.

    Parameters
    ----------
    node
        Owns the timer.
    period_s
        Between two calls, s of a clock that never jumps.
    callback
        Called by the node's executor.
    """
    return node.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def is_clock_missing(node: Node) -> bool:
    """Return whether the node waits for /clock, which nobody has published yet."""
    return bool(node.get_parameter("use_sim_time").value) and not node.get_clock().now().nanoseconds
