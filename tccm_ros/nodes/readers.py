"""Records of serialised messages: what most come as is read without making a message object."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from contextlib import suppress

from rclpy.serialization import deserialize_message

from tccm_ros.cdr.reading import FAST_READERS, NotPlain
from tccm_ros.nodes.ros_types import message_class
from tccm_ros.records.building import Record
from tccm_ros.ros import READERS

__all__ = ["Reader", "record_reader"]

Reader = Callable[[bytes], Sequence[Record]]
"""Gives the records of a serialised message; MessageError for content that cannot be used."""


def record_reader(role: str) -> tuple[str, Reader]:
    """Return the message type of a role (`messages.READERS`), and what reads its messages.

    Arrays of the records can be written to: kernels are compiled for such alone.
    """
    type_name, of_message = READERS[role]
    fast = FAST_READERS.get(role)

    def read(data: bytes) -> Sequence[Record]:
        if fast is not None:
            with suppress(NotPlain, struct.error, UnicodeDecodeError):
                return fast(bytearray(data))  # type: ignore[arg-type]  # bytes that can be written
        return of_message(deserialize_message(data, message_class(type_name)))

    return type_name, read
