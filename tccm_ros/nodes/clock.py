"""Clock jumps of a node, stamps on receipt, and timers on a steady clock."""

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
"""Maximum time between a step of the clock and the step of the message stamps, s."""


class ClockWatch:
    """Reports a backward jump of the node clock that the message stamps did not follow.

    If there are records, their stamps show the step (`robot.StampGuard`) and separate old records
    from new ones exactly, whereas /clock may arrive before or after them. A jump is therefore
    reported only if the stamps have shown none.

    Parameters
    ----------
    node
        Node whose clock is watched.
    threshold_s
        Smaller steps are ignored, s.
    callback
        Called with the reason, in the executor, if the stamps show no step for `PATIENCE_S`.
    """

    def __init__(self, node: Node, threshold_s: float, callback: Callable[[str], None]):
        self._callback = callback
        self._stepped_s = -math.inf
        self._timer: Timer | None = None
        self._node = node
        threshold = JumpThreshold(
            min_forward=None,
            min_backward=Duration(nanoseconds=-round(threshold_s * 1e9)),
            on_clock_change=False,
        )
        # The callback exists only as long as its handle.
        self._handle = node.get_clock().create_jump_callback(threshold, post_callback=self._jumped)

    def note_stamps(self) -> None:
        """Note that the stamps of the records stepped back."""
        self._stepped_s = time.monotonic()

    @property
    def just_went_back(self) -> bool:
        """Whether the stamps of the records stepped back within `PATIENCE_S`."""
        return time.monotonic() < self._stepped_s + PATIENCE_S

    def close(self) -> None:
        """Stop the reports."""
        self._end_timer()
        self._handle.unregister()

    def _jumped(self, jump: TimeJump) -> None:
        stepped_s = time.monotonic()
        reason = f"the clock stepped back by {-jump.delta.nanoseconds * 1e-9:.1f} s"

        def look() -> None:
            self._end_timer()
            if self._stepped_s < stepped_s - PATIENCE_S:
                self._callback(reason)

        self._end_timer()
        self._timer = steady_timer(self._node, PATIENCE_S, look)

    def _end_timer(self) -> None:
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
            self._timer = None


def stamp_on_receipt(
    node: Node, record: Any, time_span: Callable[[Any], tuple[int, int]] | None
) -> Any:
    """Return a record stamped with its arrival time, for drivers without a clock.

    A measurement over a time span is sent at its end, so its stamp is earlier by the span.

    Parameters
    ----------
    node
        Node whose clock is read.
    record
        Records without a stamp (a robot description) are returned as they are.
    time_span
        Returns the first and last time of a record, ns; None for instantaneous records.
    """
    if not hasattr(record, "stamp_ns"):
        return record
    arrival_ns = int(node.get_clock().now().nanoseconds)
    if time_span is not None:
        arrival_ns -= time_span(record)[1] - record.stamp_ns
    return replace(record, stamp_ns=max(arrival_ns, 0))


def steady_timer(node: Node, period_s: float, callback: Callable[[], None]) -> Any:
    """Return a timer that runs even while the node clock does not, as without /clock.

    Parameters
    ----------
    node
        Node of the timer.
    period_s
        Period, s of a monotonic clock.
    callback
        Called by the node's executor.
    """
    return node.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def is_clock_missing(node: Node) -> bool:
    """Return whether the node uses sim time and has received no /clock yet."""
    return bool(node.get_parameter("use_sim_time").value) and not node.get_clock().now().nanoseconds
