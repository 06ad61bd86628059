"""Read records directly from CDR bytes, for the five most frequent message types.

A bag has ten odometry, joint and tf messages for each scan. Reading a record takes 3.6 to 5.3 us
here, and 9.7 to 15.2 us with rosbags' message objects, mostly in `deserialize_cdr` (``python
bench/bench_bags.py``). Names are decoded only if their bytes differ from those of the last message.
The typestore reads everything that is not plain little-endian CDR of the expected size: the readers
raise NotPlain, struct.error or UnicodeDecodeError for it, and MessageError in the same cases as
with a message object.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tccm_ros.cdr.message_reader import NotPlain
from tccm_ros.records import Imu, JointSample, Odometry, Scan, TransformSample
from tccm_ros.records.building import (
    frame_name,
    imu_record,
    joint_sample,
    pose_matrix,
    scan_record,
    transform_samples,
)

ENCAPSULATION = b"\0\1"
ORIGIN = 4
"""Offset from which alignment is counted, after the encapsulation header."""

STAMP_END = ORIGIN + 8

AFTER_POSE_BYTES = 8 * (36 + 6 + 36)
"""Size of the pose covariance, the twist and its covariance."""

_U32 = struct.Struct("<I").unpack_from
_STAMP = struct.Struct("<iI").unpack_from
_POSE = struct.Struct("<7d").unpack_from
_BEAMS = struct.Struct("<7f").unpack_from
_VECTOR = struct.Struct("<4d").unpack_from
POSE_BYTES, BEAMS_BYTES = 56, 28

ORIENTATION_BYTES, IMU_BYTES = 8 * (4 + 9), 8 * (4 + 9 + 3 + 9 + 3 + 9)
"""Sizes of an IMU's orientation with covariance, and of everything after the header."""

VECTOR_BYTES = 8 * (3 + 9)
"""Size of an IMU's angular velocity or acceleration with covariance."""

MAX_TRAILING_BYTES = 15
"""Maximum number of bytes accepted after a message: rclpy's serialize_message leaves up to 8 after
empty sequences, and DDS pads to 4."""


def _align(offset: int, size: int) -> int:
    return (offset - ORIGIN + size - 1 & -size) + ORIGIN


def _text(data: bytes, offset: int) -> tuple[str, int]:
    """Return the string at an offset (after alignment) and its end."""
    offset = _align(offset, 4)
    (length,) = _U32(data, offset)
    end = offset + 4 + length
    if length < 1 or end > len(data) or data[end - 1]:
        raise NotPlain
    return data[offset + 4 : end - 1].decode(), end


def _header(data: bytes, offset: int) -> tuple[int, str, int]:
    """Return stamp in ns, frame, and the end of the header."""
    offset = _align(offset, 4)
    sec, nanosec = _STAMP(data, offset)
    frame, end = _text(data, offset + 8)
    return sec * 1_000_000_000 + nanosec, frame, end


def _numbers(data: bytes, offset: int, dtype: str, size: int) -> tuple[NDArray[Any], int]:
    """Return a sequence of numbers of `size` bytes as a view, and its end."""
    offset = _align(offset, 4)
    (count,) = _U32(data, offset)
    if count == 0:
        return np.zeros(0, dtype), offset + 4
    start = _align(offset + 4, size)
    end = start + size * count
    if end > len(data):
        raise NotPlain
    return np.frombuffer(data, dtype, count, start), end


class _Names:
    """Reads the names in a message, with a cache of the last ones.

    Parameters
    ----------
    read
        Returns the names of a message and their end offset.
    """

    def __init__(self, read: Callable[[bytes], tuple[tuple[str, ...], int]]) -> None:
        self._read = read
        self._last: tuple[bytes | None, tuple[str, ...], int] = (None, (), 0)

    def __call__(self, data: bytes) -> tuple[int, tuple[str, ...], int]:
        """Return the stamp in ns, the names and their end offset."""
        sec, nanosec = _STAMP(data, ORIGIN)
        known, names, end = self._last
        if data[STAMP_END:end] != known:
            names, end = self._read(data)
            self._last = (data[STAMP_END:end], names, end)
        return sec * 1_000_000_000 + nanosec, names, end


def _check(data: bytes, end: int) -> None:
    if data[:2] != ENCAPSULATION or not 0 <= len(data) - end <= MAX_TRAILING_BYTES:
        raise NotPlain


def _frames_of_odometry(data: bytes) -> tuple[tuple[str, ...], int]:
    frame, offset = _text(data, STAMP_END)
    child, offset = _text(data, offset)
    return (frame_name(frame), frame_name(child)), _align(offset, 8)


def _names_of_joints(data: bytes) -> tuple[tuple[str, ...], int]:
    _, offset = _text(data, STAMP_END)
    offset = _align(offset, 4)
    (count,) = _U32(data, offset)
    offset += 4
    names = []
    for _ in range(count):
        name, offset = _text(data, offset)
        names.append(name)
    return tuple(names), offset


def _frame_of_scan(data: bytes) -> tuple[tuple[str, ...], int]:
    frame, offset = _text(data, STAMP_END)
    return (frame,), _align(offset, 4)


def _frame_of_imu(data: bytes) -> tuple[tuple[str, ...], int]:
    frame, offset = _text(data, STAMP_END)
    return (frame_name(frame),), _align(offset, 8)


_odometry_names = _Names(_frames_of_odometry)
_joint_names = _Names(_names_of_joints)
_scan_names = _Names(_frame_of_scan)
_imu_names = _Names(_frame_of_imu)


def read_odometry(data: bytes) -> tuple[Odometry]:
    """Return the pose of a nav_msgs/Odometry."""
    stamp_ns, (frame, child), offset = _odometry_names(data)
    _check(data, offset + POSE_BYTES + AFTER_POSE_BYTES)
    numbers = _POSE(data, offset)
    return (Odometry(stamp_ns, frame, child, pose_matrix(numbers[:3], numbers[3:], "odometry")),)


def read_imu(data: bytes) -> tuple[Imu]:
    """Return the angular velocity and the acceleration of a sensor_msgs/Imu."""
    stamp_ns, (frame,), offset = _imu_names(data)
    _check(data, offset + IMU_BYTES)
    rates = _VECTOR(data, offset + ORIENTATION_BYTES)
    acceleration = _VECTOR(data, offset + ORIENTATION_BYTES + VECTOR_BYTES)
    return (imu_record(stamp_ns, frame, rates, acceleration),)


def read_joint_sample(data: bytes) -> tuple[JointSample]:
    """Return the positions of a sensor_msgs/JointState."""
    stamp_ns, names, offset = _joint_names(data)
    positions, offset = _numbers(data, offset, "<f8", 8)
    _, offset = _numbers(data, offset, "<f8", 8)
    _, offset = _numbers(data, offset, "<f8", 8)
    _check(data, offset)
    return (joint_sample(stamp_ns, names, positions),)


def read_scan(data: bytes) -> tuple[Scan]:
    """Return the scan of a sensor_msgs/LaserScan."""
    stamp_ns, (frame,), offset = _scan_names(data)
    numbers = _BEAMS(data, offset)
    ranges, offset = _numbers(data, offset + BEAMS_BYTES, "<f4", 4)
    _, offset = _numbers(data, offset, "<f4", 4)
    _check(data, offset)
    return (scan_record(stamp_ns, frame, numbers, ranges),)


def read_transforms(data: bytes, *, is_static: bool = False) -> list[TransformSample]:
    """Return the transforms of a tf2_msgs/TFMessage."""
    (count,) = _U32(data, ORIGIN)
    offset = ORIGIN + 4
    found = []
    for _ in range(count):
        stamp_ns, parent, offset = _header(data, offset)
        child, offset = _text(data, offset)
        offset = _align(offset, 8)
        found.append((stamp_ns, (parent, child), _POSE(data, offset)))
        offset += POSE_BYTES
    _check(data, offset)
    rows = ((stamp_ns, frames, pose[:3], pose[3:]) for stamp_ns, frames, pose in found)
    return transform_samples(rows, is_static)
