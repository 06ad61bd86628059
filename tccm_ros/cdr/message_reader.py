"""Readers of serialised messages: to records from CDR bytes or from a message object."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, NamedTuple


class NotPlain(ValueError):
    """Bytes that the typestore has to read."""


class MessageReader(NamedTuple):
    """Reads the messages of one type.

    Attributes
    ----------
    message_type
        Such as ``sensor_msgs/msg/LaserScan``.
    of_message
        Returns the records of a message object, of any family of message classes; raises
        `MessageError` for content that no processor can use.
    of_bytes
        Returns the records of CDR bytes without a message object, which takes ten times as long;
        raises NotPlain, struct.error or UnicodeDecodeError for bytes that `of_message` has to read.
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
            Returns the message object of a type's name and bytes.

        Raises
        ------
        MessageError
            For content that no processor can use.
        """
        if self.of_bytes is not None:
            with suppress(NotPlain, struct.error, UnicodeDecodeError):
                return self.of_bytes(data)
        return self.of_message(deserialize(self.message_type, data))
