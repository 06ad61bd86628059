"""How a serialised message becomes records: straight from its bytes, or by a message object."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

__all__ = ["MessageReader", "NotPlain"]


class NotPlain(ValueError):
    """Bytes that are left to the typestore."""


class MessageReader(NamedTuple):
    """Reads the messages of one type.

    Attributes
    ----------
    message_type
        Such as ``sensor_msgs/msg/LaserScan``.
    of_message
        Gives the records of a message, of any family of message classes; `MessageError` for content
        that no processor can use.
    of_bytes
        The same straight from CDR bytes, for messages that come often: a message object takes ten
        times as long. It raises NotPlain, struct.error or UnicodeDecodeError for what `of_message`
        shall read.
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
            Makes a message object of a type's name and bytes.

        Raises
        ------
        MessageError
            For content that no processor can use.
        """
        if self.of_bytes is not None:
            with suppress(NotPlain, struct.error, UnicodeDecodeError):
                return self.of_bytes(data)
        return self.of_message(deserialize(self.message_type, data))
