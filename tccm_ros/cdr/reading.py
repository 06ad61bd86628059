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


def _align(at: int, size: int) -> int:
    return (at - ORIGIN + size - 1 & -size) + ORIGIN


def _text(data: bytes, at: int) -> tuple[str, int]:
    """Return the string at an offset (after alignment) and its end."""
    at = _align(at, 4)
    (length,) = _U32(data, at)
    end = at + 4 + length
    if length < 1 or end > len(data) or data[end - 1]:
        raise NotPlain
    return data[at + 4 : end - 1].decode(), end


def _header(data: bytes, at: int) -> tuple[int, str, int]:
    """Return stamp in ns, frame, and the end of the header."""
    at = _align(at, 4)
    sec, nanosec = _STAMP(data, at)
    frame, end = _text(data, at + 8)
    return sec * 1_000_000_000 + nanosec, frame, end


def _numbers(data: bytes, at: int, dtype: str, size: int) -> tuple[NDArray[Any], int]:
    """Return a sequence of numbers of `size` bytes as a view, and its end."""
    at = _align(at, 4)
    (count,) = _U32(data, at)
    if count == 0:
        return np.zeros(0, dtype), at + 4
    start = _align(at + 4, size)
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
    frame, at = _text(data, STAMP_END)
    child, at = _text(data, at)
    return (frame_name(frame), frame_name(child)), _align(at, 8)


def _names_of_joints(data: bytes) -> tuple[tuple[str, ...], int]:
    _, at = _text(data, STAMP_END)
    at = _align(at, 4)
    (count,) = _U32(data, at)
    at += 4
    names = []
    for _ in range(count):
        name, at = _text(data, at)
        names.append(name)
    return tuple(names), at


def _frame_of_scan(data: bytes) -> tuple[tuple[str, ...], int]:
    frame, at = _text(data, STAMP_END)
    return (frame,), _align(at, 4)


def _frame_of_imu(data: bytes) -> tuple[tuple[str, ...], int]:
    frame, at = _text(data, STAMP_END)
    return (frame_name(frame),), _align(at, 8)


_odometry_names = _Names(_frames_of_odometry)
_joint_names = _Names(_names_of_joints)
_scan_names = _Names(_frame_of_scan)
_imu_names = _Names(_frame_of_imu)


def read_odometry(data: bytes) -> tuple[Odometry]:
    """Return the pose of a nav_msgs/Odometry."""
    stamp_ns, (frame, child), at = _odometry_names(data)
    _check(data, at + POSE_BYTES + AFTER_POSE_BYTES)
    numbers = _POSE(data, at)
    return (Odometry(stamp_ns, frame, child, pose_matrix(numbers[:3], numbers[3:], "odometry")),)


def read_imu(data: bytes) -> tuple[Imu]:
    """Return the angular velocity and the acceleration of a sensor_msgs/Imu."""
    stamp_ns, (frame,), at = _imu_names(data)
    _check(data, at + IMU_BYTES)
    rates = _VECTOR(data, at + ORIENTATION_BYTES)
    acceleration = _VECTOR(data, at + ORIENTATION_BYTES + VECTOR_BYTES)
    return (imu_record(stamp_ns, frame, rates, acceleration),)


def read_joint_sample(data: bytes) -> tuple[JointSample]:
    """Return the positions of a sensor_msgs/JointState."""
    stamp_ns, names, at = _joint_names(data)
    positions, at = _numbers(data, at, "<f8", 8)
    _, at = _numbers(data, at, "<f8", 8)
    _, at = _numbers(data, at, "<f8", 8)
    _check(data, at)
    return (joint_sample(stamp_ns, names, positions),)


def read_scan(data: bytes) -> tuple[Scan]:
    """Return the scan of a sensor_msgs/LaserScan."""
    stamp_ns, (frame,), at = _scan_names(data)
    numbers = _BEAMS(data, at)
    ranges, at = _numbers(data, at + BEAMS_BYTES, "<f4", 4)
    _, at = _numbers(data, at, "<f4", 4)
    _check(data, at)
    return (scan_record(stamp_ns, frame, numbers, ranges),)


def read_transforms(data: bytes, *, is_static: bool = False) -> list[TransformSample]:
    """Return the transforms of a tf2_msgs/TFMessage."""
    (count,) = _U32(data, ORIGIN)
    at = ORIGIN + 4
    found = []
    for _ in range(count):
        stamp_ns, parent, at = _header(data, at)
        child, at = _text(data, at)
        at = _align(at, 8)
        found.append((stamp_ns, (parent, child), _POSE(data, at)))
        at += POSE_BYTES
    _check(data, at)
    rows = ((stamp_ns, frames, pose[:3], pose[3:]) for stamp_ns, frames, pose in found)
    return transform_samples(rows, is_static)
