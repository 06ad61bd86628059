"""Message classes of the ROS installation, which live nodes publish and receive."""

from __future__ import annotations

from array import array
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

_TYPE_CODES = {np.dtype(code): code for code in ("b", "B", "h", "H", "i", "I", "q", "Q", "f", "d")}

TF_MESSAGE = "tf2_msgs/msg/TFMessage"


@cache
def message_class(msgtype: str) -> Any:
    """Return the class of a type such as ``sensor_msgs/msg/LaserScan``.

    Raises
    ------
    ModuleNotFoundError
        If its package is not installed (tf2_msgs may be missing).
    """
    package, _, name = msgtype.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def is_installed(msgtype: str) -> bool:
    """Return whether the class of a type such as ``sensor_msgs/msg/LaserScan`` is installed."""
    try:
        message_class(msgtype)
    except (ImportError, AttributeError):  # AttributeError: a version without the type
        return False
    return True


def has_tf2_msgs() -> bool:
    """Return whether tf2_msgs can be imported."""
    return is_installed(TF_MESSAGE)


class RosidlMessages:
    """The `MessageTypes` of live nodes; bulk fields are array.array, which rosidl does not copy."""

    def make(self, msgtype: str, /, **fields: Any) -> Any:
        """Return a message; missing fields have rosidl's defaults."""
        return message_class(msgtype)(**fields)

    def field_names(self, msgtype: str) -> list[str]:
        """Return the fields of a type, in order."""
        return list(message_class(msgtype).get_fields_and_field_types())

    def array(self, dtype: DTypeLike, values: ArrayLike) -> Any:
        """Return the value of a sequence field of numbers."""
        kind = np.dtype(dtype)
        result = array(_TYPE_CODES[kind])
        result.frombytes(np.ascontiguousarray(values, kind).tobytes())
        return result

    def rows(self, msgtype: str, table: ArrayLike, chosen: ArrayLike | None = None) -> Any:
        """Return a list of messages, one per row; a row chosen twice is the same message object.

        Parameters
        ----------
        msgtype
            ``package/msg/Name`` of a message whose fields are all numbers.
        table
            (N, fields), in the order of the fields.
        chosen
            int (M,), rows of the table; all of them, in order, if None.
        """
        kind, names = message_class(msgtype), self.field_names(msgtype)
        lines = np.asarray(table, float).reshape(-1, len(names)).tolist()
        made = [kind(**dict(zip(names, line))) for line in lines]
        return made if chosen is None else [made[k] for k in np.asarray(chosen).tolist()]

    def octet(self, value: int) -> Any:
        """Return the value of a ``byte`` field."""
        return bytes([value])
