"""Requests to a service as futures of plain values."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.task import Future

from tccm_ros.errors import RequestError


def ask(client: Any, request: Any, read: Callable[[Any], object]) -> Future:
    """Return a future of the converted response, or of RequestError with the node's message.

    The future has no executor, so its callbacks run at once. With an executor, the callbacks that
    `rclpy.spin_until_future_complete` adds in every step would pile up as tasks until the next
    request, and each request would take longer (rclpy 7.1; ros2/rclpy#1702).

    Parameters
    ----------
    client
        Of a service whose response has `success` and `message`.
    request
        Is sent at once.
    read
        Converts a successful response.
    """
    future = Future()
    if not client.service_is_ready():
        why = f"nobody answers {client.service_name}: is its node running, under this name?"
        future.set_exception(RequestError(why))
        return future

    def done(answered: Future) -> None:
        answer = answered.result()
        if answer.success:
            future.set_result(read(answer))
        else:
            future.set_exception(RequestError(answer.message))

    client.call_async(request).add_done_callback(done)
    return future
