"""Requests to other nodes: filling them, and sending them to services."""

from __future__ import annotations

import threading
from array import array
from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import PointStamped
from numpy.typing import ArrayLike
from rclpy.task import Future

from tccm_ros.errors import RequestError


def filled(message: Any, /, **values: Any) -> Any:
    """Set fields of a message and return it.

    Parameters
    ----------
    message
        Message with its default values.
    values
        Values by field; None keeps the default, a whole number may stand for a float, and any
        sequence for a list.

    Raises
    ------
    TypeError
        If there is no such field, or a string where a list is expected.
    """
    for name, value in values.items():
        if name not in message.get_fields_and_field_types():
            raise TypeError(f"{type(message).__name__} has no field {name}")
        if value is None:
            continue
        default = getattr(message, name)
        if isinstance(default, (list, array)):
            if isinstance(value, str):
                raise TypeError(f"{name} is {value!r}; expected a list")
            value = list(value)
        setattr(message, name, float(value) if isinstance(default, float) else value)
    return message


def stamped_point(xy: ArrayLike, frame_id: str) -> PointStamped:
    """Return a point (x, y), m, z = 0, in a frame."""
    message = PointStamped()
    message.header.frame_id = frame_id
    message.point.x, message.point.y = np.asarray(xy, float)[:2].tolist()
    return message


def set_outcome(future: Future, answer: Any, read: Callable[[Any], object]) -> None:
    """Give a future the converted answer, or `RequestError` with the message of a failure.

    Parameters
    ----------
    future
        Future without a result.
    answer
        Response or result with the fields `success` and `message`.
    read
        Conversion of a successful answer to the future's result.
    """
    if answer.success:
        future.set_result(read(answer))
    else:
        future.set_exception(RequestError(answer.message))


def done_event(future: Future) -> threading.Event:
    """Return an event that is set when a future is done, for other threads than its executor's."""
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    return done


def ask(client: Any, request: Any, read: Callable[[Any], object]) -> Future:
    """Call a service and return a future of the converted response, as of `set_outcome`.

    The future has no executor, so its callbacks run at once. With an executor, the callbacks that
    `rclpy.spin_until_future_complete` adds in every step would pile up as tasks until the next
    request, and each request would take longer (rclpy 7.1; ros2/rclpy#1702).

    Parameters
    ----------
    client
        Client of the service; if the service is not available, the future raises `RequestError`.
    request
        Request, sent at once.
    read
        As in `set_outcome`.
    """
    future = Future()
    if not client.service_is_ready():
        why = f"nobody answers {client.service_name}: is its node running, under this name?"
        future.set_exception(RequestError(why))
        return future
    sent = client.call_async(request)
    sent.add_done_callback(lambda answered: set_outcome(future, answered.result(), read))
    return future
