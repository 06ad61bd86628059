"""Readers that convert a serialised message or a message object to records."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, NamedTuple


class NotPlain(ValueError):
    """CDR that only the typestore can read."""


class MessageReader(NamedTuple):
    """Reads the messages of one type.

    Attributes
    ----------
    message_type
        Message type, such as ``sensor_msgs/msg/LaserScan``.
    of_message
        Returns the records of a message object of any message class; raises `MessageError` if no
        processor can use its content.
    of_bytes
        Returns the records of CDR bytes without a message object, which would take ten times as
        long; raises NotPlain, struct.error or UnicodeDecodeError for bytes that need `of_message`.
    """

    message_type: str
    of_message: Callable[[Any], Sequence[Any]]
    of_bytes: Callable[[Any], Sequence[Any]] | None = None

    def read(
        self, data: bytes | bytearray, deserialize: Callable[[str, Any], Any]
    ) -> Sequence[Any]:
        """Return the records of a serialised message.

        Parameters
        ----------
        data
            CDR bytes.
        deserialize
            Returns the message object, given its type name and bytes.

        Raises
        ------
        MessageError
            If no processor can use the content.
        """
        if self.of_bytes is not None:
            with suppress(NotPlain, struct.error, UnicodeDecodeError):
                return self.of_bytes(data)
        return self.of_message(deserialize(self.message_type, data))
