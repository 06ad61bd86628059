"""Stamps and jumps of the node clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rclpy.clock import Clock, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node


def on_backward_jump(node: Node, threshold_s: float, callback: Callable[[str], None]) -> Any:
    """Call back with a reason when the node clock steps back by more than a threshold.

    Parameters
    ----------
    node
        Its clock is watched.
    threshold_s
        Steps back of more than this, s.
    callback
        Called with the reason as a sentence.

    Returns
    -------
    JumpHandle
        Keep it: the callback is gone with it.
    """

    def jumped(jump: TimeJump) -> None:
        callback(f"the clock stepped back by {-jump.delta.nanoseconds * 1e-9:.1f} s")

    threshold = JumpThreshold(
        min_forward=None,
        min_backward=Duration(nanoseconds=-round(threshold_s * 1e9)),
        on_clock_change=False,
    )
    return node.get_clock().create_jump_callback(threshold, post_callback=jumped)


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
