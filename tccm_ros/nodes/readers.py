"""Records of serialised messages, as a live node receives them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.serialization import deserialize_message

from tccm_ros.cdr.message_reader import MessageReader
from tccm_ros.nodes.ros_types import message_class

RecordReader = Callable[[bytes], Sequence[Any]]
"""Gives the records of a serialised message; MessageError for content that cannot be used."""


def record_reader(reader: MessageReader) -> RecordReader:
    """Return what reads the messages of a node's topic.

    Arrays of the records can be written to: kernels are compiled for such alone.
    """

    def read(data: bytes) -> Sequence[Any]:
        return reader.read(bytearray(data), _deserialize)

    return read


def _deserialize(type_name: str, data: bytes) -> Any:
    return deserialize_message(bytes(data), message_class(type_name))
