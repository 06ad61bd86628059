"""Message classes of the rosbags typestore, which reads and writes bags without ROS."""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tccm_ros.cdr.reading import MAX_TRAILING_BYTES
from tccm_ros.cdr.writing import CdrWriter, numpy_name
from tccm_ros.errors import MessageError, one_line

Factory = Callable[[], Any]

ROOM = Path(__file__).resolve().parents[1] / "ros"
DEFINITIONS = ROOM / "definitions"
"""Definitions of tccm_interfaces: a link to interfaces/msg, files in an installed package."""

PUBLIC_DEFINITIONS = ROOM / "public_definitions"
"""Definitions of other public packages, by package, whether they are installed or not."""


class TypestoreMessages:
    """The `MessageTypes` of bags, with CDR encoding and decoding.

    The types are those of ROS 2 Jazzy's common interfaces, of tccm_interfaces and of
    `PUBLIC_DEFINITIONS`: the used types of moveit_msgs, object_recognition_msgs and vision_msgs.
    """

    def __init__(self) -> None:
        self._store = _shared_store()
        self._writer = _shared_writer()
        self._defaults: dict[str, dict[str, Factory]] = {}

    def make(self, msgtype: str, /, **fields: Any) -> Any:
        """Return a message; missing fields are zero, empty, or the identity rotation.

        Raises
        ------
        KeyError
            If the type is unknown.
        TypeError
            If the type does not have a field.
        """
        defaults = self._defaults.get(msgtype) or self._plan(msgtype)
        if len(fields) < len(defaults):
            for name, default in defaults.items():
                if name not in fields:
                    fields[name] = default()
        return self._store.types[msgtype](**fields)

    def array(self, dtype: DTypeLike, values: ArrayLike) -> Any:
        """Return the value of a sequence field of numbers."""
        return np.ascontiguousarray(values, dtype)

    def octet(self, value: int) -> Any:
        """Return the value of a ``byte`` field."""
        return int(value)

    def rows(self, msgtype: str, table: ArrayLike, chosen: ArrayLike | None = None) -> Any:
        """Return a list of purely numeric messages as the table itself.

        Parameters
        ----------
        msgtype
            Type of the messages.
        table
            (N, C), a row for each message.
        chosen
            Rows to take, by mask or by index; None for all.
        """
        row = self._writer.row(msgtype)
        values = np.asarray(table, row.dtype).reshape(-1, row.columns)
        return values if chosen is None else values[np.asarray(chosen)]

    def serialize(self, msgtype: str, message: Any) -> bytearray:
        """Return a message as little-endian CDR.

        Raises
        ------
        MessageError
            If a value does not fit its field.
        """
        return self._writer.write(msgtype, message)

    def deserialize(self, msgtype: str, data: bytes | memoryview) -> Any:
        """Return the message of CDR data of either byte order; its arrays are read-only views.

        Raises
        ------
        MessageError
            If the data are truncated, too long or not CDR. Sizes are checked before memory is
            allocated.
        """
        raw = memoryview(data)
        if len(raw) < 4 or raw[0] != 0 or raw[1] > 1:
            raise MessageError(f"{msgtype} message of {len(raw)} bytes is not CDR")
        kind = self._store.get_msgdef(msgtype)
        read = kind.deserialize_cdr_le if raw[1] else kind.deserialize_cdr_be
        try:
            message, end = read(raw[4:], 0, kind.cls, self._store)
        except (SerdeError, struct.error, ValueError, IndexError, OverflowError) as error:
            raise MessageError(f"{msgtype} message is damaged ({one_line(error)})") from None
        if not 0 <= len(raw) - 4 - end <= MAX_TRAILING_BYTES:
            raise MessageError(f"{msgtype} message has {len(raw)} bytes, expected {end + 4}")
        return message

    def knows(self, msgtype: str) -> bool:
        """Return whether the type is known."""
        return msgtype in self._store.fielddefs

    def field_names(self, msgtype: str) -> list[str]:
        """Return the fields of a type, in order."""
        return [name for name, _ in self._store.fielddefs[msgtype][1]]

    def definition(self, msgtype: str) -> str:
        """Return the definition of a type and of all types in it, as rosbag2 stores it."""
        return self._store.generate_msgdef(msgtype, ros_version=2)[0]

    def type_hash(self, msgtype: str) -> str:
        """Return the REP-2016 hash of a type."""
        return self._store.hash_rihs01(msgtype)

    def _plan(self, msgtype: str) -> dict[str, Factory]:
        """Return a factory for each field, and cache it."""
        _, fields = self._store.fielddefs[msgtype]
        plan = {name: self._factory(description) for name, description in fields}
        if msgtype == "geometry_msgs/msg/Quaternion":
            plan["w"] = lambda: 1.0
        self._defaults[msgtype] = plan
        return plan

    def _factory(self, description: Any) -> Factory:
        kind, detail = description
        if kind == Nodetype.NAME:
            return lambda: self.make(detail)
        if kind == Nodetype.BASE:
            return _base_factory(detail[0])
        (inner_kind, inner), length = detail
        size = length if kind == Nodetype.ARRAY else 0
        if inner_kind == Nodetype.BASE and inner[0] != "string":
            dtype = numpy_name(inner[0])
            return lambda: np.zeros(size, dtype)
        item = self._factory((inner_kind, inner))
        return lambda: [item() for _ in range(size)]


@cache
def _shared_store() -> Typestore:
    """Return the typestore of the process; compiling its converters takes 0.1 s."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for package, paths in (
        ("tccm_interfaces", DEFINITIONS.glob("*.msg")),
        *((folder.name, folder.glob("msg/*.msg")) for folder in PUBLIC_DEFINITIONS.iterdir()),
    ):
        for path in sorted(paths):
            store.register(get_types_from_msg(path.read_text(), f"{package}/msg/{path.stem}"))
    return store


@cache
def _shared_writer() -> CdrWriter:
    return CdrWriter(_shared_store().fielddefs)


def _base_factory(base: str) -> Factory:
    if base in ("string", "wstring"):
        return str
    if base == "bool":
        return bool
    return float if base.startswith("float") else int
