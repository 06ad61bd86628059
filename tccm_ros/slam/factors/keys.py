"""Keys of the graph's variables."""

from __future__ import annotations

import math
from typing import NamedTuple

import gtsam
import numpy as np

from tccm_ros.arrays import Float64

SYMBOL_BITS = 56
"""Number of bits of the number of a variable in GTSAM's symbols."""


class Key(NamedTuple):
    """A variable of the graph.

    The variable of a keyframe is its pose, rotated about z: GTSAM's basis of a plane's normal flips
    where the normal is along x or y of the observing pose, so a keyframe is rotated to keep its
    walls away from that case.

    Attributes
    ----------
    kind
        Letter of the kind.
    number
        Index among the variables of its kind.
    yaw_offset
        Rotation of the variable relative to its frame, rad.
    """

    kind: str
    number: int
    yaw_offset: float = 0.0

    @property
    def symbol(self) -> int:
        """GTSAM's integer for this variable."""
        return gtsam.symbol(self.kind, self.number)

    def to_value(self, T: Float64) -> gtsam.Pose3:
        """Return the graph's value for the pose T_map_frame (4, 4)."""
        return gtsam.Pose3(np.asarray(T, float) @ rotation_z(self.yaw_offset))

    def from_value(self, value: gtsam.Pose3) -> Float64:
        """Return T_map_frame (4, 4) of the graph's value."""
        return value.matrix() @ rotation_z(-self.yaw_offset)


def rotation_z(angle: float) -> Float64:
    """Return the rotation by `angle` (rad) about z, float64 (4, 4)."""
    T = np.eye(4)
    T[0, 0] = T[1, 1] = math.cos(angle)
    T[1, 0] = math.sin(angle)
    T[0, 1] = -T[1, 0]
    return T


def keyframe_key(index: int, yaw_offset: float = 0.0) -> Key:
    """Return the key of a keyframe's pose."""
    return Key("x", index, yaw_offset)


def view_key(stamp_ns: int) -> Key:
    """Return the key of a view's pose, by its stamp."""
    return Key("v", stamp_ns % 2**SYMBOL_BITS)


def observer_key(index: int) -> Key:
    """Return the key of an observer pose of landmarks."""
    return Key("o", index)


def wall_key(index: int) -> Key:
    """Return the key of a wall."""
    return Key("w", index)


def corner_key(a: int, b: int) -> Key:
    """Return the key of the corner of two walls, by their indices."""
    return Key("c", (a << SYMBOL_BITS // 2) + b)
