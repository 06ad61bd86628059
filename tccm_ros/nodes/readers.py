"""Records of serialised messages, as a live node receives them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.serialization import deserialize_message

from tccm_ros.nodes.ros_types import message_class
from tccm_ros.ros.reading import READERS

RecordReader = Callable[[bytes], Sequence[Any]]
"""Gives the records of a serialised message; MessageError for content that cannot be used."""


def record_reader(role: str) -> tuple[str, RecordReader]:
    """Return the message type of a role (`ros.READERS`), and what reads its messages.

    Arrays of the records can be written to: kernels are compiled for such alone.
    """
    reader = READERS[role]

    def read(data: bytes) -> Sequence[Any]:
        return reader.read(bytearray(data), _deserialize)

    return reader.message_type, read


def _deserialize(type_name: str, data: bytes) -> Any:
    return deserialize_message(bytes(data), message_class(type_name))
