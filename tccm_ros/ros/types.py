"""Message classes, and the common parts of messages: stamp, header, pose.

Messages are built by a `MessageTypes` object, so that live nodes (rosidl classes) and bags (rosbags
typestore) use the same code.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from tccm_ros.arrays import Float64
from tccm_ros.errors import MessageError

_SECOND_NS = 1_000_000_000


class MessageTypes(Protocol):
    """Message classes of one family: rosidl's, or those of the rosbags typestore."""

    def make(self, msgtype: str, /, **fields: Any) -> Any:
        """Return a message of a type such as ``std_msgs/msg/Header``; other fields are defaults."""
        ...

    def field_names(self, msgtype: str) -> list[str]:
        """Return the fields of a type, in order."""
        ...

    def array(self, dtype: DTypeLike, values: ArrayLike) -> Any:
        """Return the value of a sequence field of numbers (``float32[]``, ``uint8[]``, ...)."""
        ...

    def rows(self, msgtype: str, table: ArrayLike, chosen: ArrayLike | None = None) -> Any:
        """Return the value of a list of purely numeric messages (points, colours).

        Parameters
        ----------
        msgtype
            Message type, such as ``geometry_msgs/msg/Point``.
        table
            (N, number of fields), one message per row.
        chosen
            Indices of the rows to take, in order; repeated rows are the same message. All by
            default.
        """
        ...

    def octet(self, value: int) -> Any:
        """Return the value of a ``byte`` field."""
        ...


def stamp_message(types: MessageTypes, stamp_ns: int) -> Any:
    """Return a builtin_interfaces/Time; MessageError before 1901 and after 2038."""
    sec, nanosec = divmod(int(stamp_ns), _SECOND_NS)
    if not -(2**31) <= sec < 2**31:
        raise MessageError(f"stamp of {sec} s does not fit a message; expected 32 bits of seconds")
    return types.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)


def header_message(types: MessageTypes, stamp_ns: int, frame_id: str) -> Any:
    """Return a std_msgs/Header.

    Parameters
    ----------
    types
        Message classes.
    stamp_ns
        Time of the data, ns.
    frame_id
        Frame of the data.
    """
    return types.make(
        "std_msgs/msg/Header", stamp=stamp_message(types, stamp_ns), frame_id=frame_id
    )


def point_message(types: MessageTypes, xyz: ArrayLike) -> Any:
    """Return a geometry_msgs/Point."""
    x, y, z = np.asarray(xyz, np.float64).tolist()
    return types.make("geometry_msgs/msg/Point", x=x, y=y, z=z)


def vector_message(types: MessageTypes, xyz: ArrayLike) -> Any:
    """Return a geometry_msgs/Vector3."""
    x, y, z = np.asarray(xyz, np.float64).tolist()
    return types.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def pose_message(types: MessageTypes, T_a_b: Float64) -> Any:
    """Return a geometry_msgs/Pose of T_a_b (4, 4)."""
    return types.make(
        "geometry_msgs/msg/Pose",
        position=point_message(types, T_a_b[:3, 3]),
        orientation=quaternion_message(types, T_a_b),
    )


def quaternion_message(types: MessageTypes, T_a_b: Float64) -> Any:
    """Return a geometry_msgs/Quaternion of the rotation of T_a_b (4, 4), with w >= 0."""
    x, y, z, w = _unit_quaternion(T_a_b[:3, :3].tolist())
    return types.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def _unit_quaternion(R: list[list[float]]) -> list[float]:
    """Return (x, y, z, w) of a rotation matrix; scipy takes twenty times as long for a single one.

    Shepperd's method: dividing by the largest of the four components avoids small divisors.
    """
    trace = R[0][0] + R[1][1] + R[2][2]
    squares = [R[0][0], R[1][1], R[2][2], trace]
    i = squares.index(max(squares))
    if i == 3:
        q = [R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1], 1.0 + trace]
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        q = [0.0] * 4
        q[i] = 1.0 - trace + 2.0 * R[i][i]
        q[j] = R[j][i] + R[i][j]
        q[k] = R[k][i] + R[i][k]
        q[3] = R[k][j] - R[j][k]
    norm = math.copysign(math.hypot(*q), q[3])
    return [value / norm for value in q]
