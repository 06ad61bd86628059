"""Conversion of serialised messages to records, for live nodes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.serialization import deserialize_message

from tccm_ros.cdr.message_reader import MessageReader
from tccm_ros.nodes.ros_types import message_class

RecordReader = Callable[[bytes], Sequence[Any]]
"""Returns the records of a serialised message; raises MessageError if they cannot be used."""


def record_reader(reader: MessageReader) -> RecordReader:
    """Return a function that converts the serialised messages of a topic to records.

    The arrays of the records are writable, because kernels are compiled only for writable arrays.
    """

    def read(data: bytes) -> Sequence[Any]:
        return reader.read(bytearray(data), _deserialize)

    return read


def _deserialize(type_name: str, data: bytes) -> Any:
    return deserialize_message(bytes(data), message_class(type_name))
