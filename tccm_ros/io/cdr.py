"""Records straight from CDR bytes, for the three types that most of a bag's messages have.

A bag has ten odometry, joint and tf messages for each scan; building a message object for each of
them would be most of the time of a replay. What is not plain little-endian CDR of the expected
size is left to the typestore, which reads it or says what is wrong.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tccm_ros.io.typestore import MAX_TRAILING_BYTES
from tccm_ros.messages import (
    Record,
    frame_name,
    joint_sample,
    transform_sample,
)
from tccm_ros.messages.types import pose_matrix
from tccm_ros.records import JointSample, Odometry, TransformSample

__all__ = ["FAST_READERS", "NotPlain"]

ENCAPSULATION = b"\0\1"
ORIGIN = 4
"""Alignment counts from behind the encapsulation header."""

AFTER_POSE_BYTES = 8 * (36 + 6 + 36)
"""Covariance of the pose, twist and its covariance."""

_U32 = struct.Struct("<I").unpack_from
_STAMP = struct.Struct("<iI").unpack_from
_POSE = struct.Struct("<7d").unpack_from
POSE_BYTES = 56


class NotPlain(ValueError):
    """Bytes that are left to the typestore."""


def _align(at: int, size: int) -> int:
    return (at - ORIGIN + size - 1 & -size) + ORIGIN


def _text(data: bytes, at: int) -> tuple[str, int]:
    """Return a string at a place (aligned first) and where it ends."""
    at = _align(at, 4)
    (length,) = _U32(data, at)
    end = at + 4 + length
    if length < 1 or end > len(data) or data[end - 1]:
        raise NotPlain
    return data[at + 4 : end - 1].decode(), end


def _header(data: bytes, at: int) -> tuple[int, str, int]:
    """Return stamp in ns, frame, and where the header ends."""
    at = _align(at, 4)
    sec, nanosec = _STAMP(data, at)
    frame, end = _text(data, at + 8)
    return sec * 1_000_000_000 + nanosec, frame, end


def _doubles(data: bytes, at: int) -> tuple[NDArray[np.float64], int]:
    """Return a sequence of float64, and where it ends."""
    at = _align(at, 4)
    (count,) = _U32(data, at)
    if count == 0:
        return np.zeros(0), at + 4
    start = _align(at + 4, 8)
    end = start + 8 * count
    if end > len(data):
        raise NotPlain
    return np.frombuffer(data, "<f8", count, start), end


def _check(data: bytes, end: int) -> None:
    if data[:2] != ENCAPSULATION or not 0 <= len(data) - end <= MAX_TRAILING_BYTES:
        raise NotPlain


def _odometry(data: bytes) -> tuple[Odometry]:
    stamp_ns, frame, at = _header(data, ORIGIN)
    child, at = _text(data, at)
    at = _align(at, 8)
    _check(data, at + POSE_BYTES + AFTER_POSE_BYTES)
    numbers = _POSE(data, at)
    T = pose_matrix(numbers[:3], numbers[3:], "odometry")
    return (Odometry(stamp_ns, frame_name(frame), frame_name(child), T),)


def _joint_sample(data: bytes) -> tuple[JointSample]:
    stamp_ns, _, at = _header(data, ORIGIN)
    at = _align(at, 4)
    (count,) = _U32(data, at)
    at += 4
    names = []
    for _ in range(count):
        name, at = _text(data, at)
        names.append(name)
    positions, at = _doubles(data, at)
    _, at = _doubles(data, at)
    _, at = _doubles(data, at)
    _check(data, at)
    return (joint_sample(stamp_ns, names, positions),)


def _transforms(data: bytes, is_static: bool = False) -> list[TransformSample]:
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
    return [
        transform_sample(stamp_ns, frames, numbers[:3], numbers[3:], is_static)
        for stamp_ns, frames, numbers in found
    ]


FAST_READERS: Mapping[str, Callable[[bytes], Sequence[Record]]] = {
    "joint_states": _joint_sample,
    "odom": _odometry,
    "tf": _transforms,
    "tf_static": lambda data: _transforms(data, is_static=True),
}
"""By role; they raise NotPlain, struct.error or UnicodeDecodeError for what the typestore shall
read, and MessageError as the readers of messages do."""
