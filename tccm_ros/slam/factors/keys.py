"""The names of the graph's variables."""

from __future__ import annotations

import math
from typing import NamedTuple

import gtsam
import numpy as np

from tccm_ros.arrays import Float64

__all__ = [
    "Key",
    "building_key",
    "corner_key",
    "keyframe_key",
    "observer_key",
    "surface_key",
    "turn_matrix",
    "view_key",
    "wall_key",
]


class Key(NamedTuple):
    """A variable of the graph: its kind (a letter) and number.

    The graph's variable of a keyframe is its pose turned by `turn` (rad) about z: GTSAM's basis of
    a plane's normal flips where the normal lies along x or y of the pose that sees it, and a
    keyframe is turned until none of its walls is near that case.
    """

    kind: str
    number: int
    turn: float = 0.0

    @property
    def symbol(self) -> int:
        """GTSAM's integer for this variable."""
        return gtsam.symbol(self.kind, self.number)

    def turned(self, T: Float64) -> gtsam.Pose3:
        """Return the graph's value for the pose T_map_frame (4, 4)."""
        return gtsam.Pose3(np.asarray(T, float) @ turn_matrix(self.turn))

    def unturned(self, value: gtsam.Pose3) -> Float64:
        """Return T_map_frame (4, 4) of the graph's value."""
        return value.matrix() @ turn_matrix(-self.turn)


def turn_matrix(angle: float) -> Float64:
    """Return the turn by `angle` (rad) about z, float64 (4, 4)."""
    T = np.eye(4)
    T[0, 0] = T[1, 1] = math.cos(angle)
    T[1, 0] = math.sin(angle)
    T[0, 1] = -T[1, 0]
    return T


def keyframe_key(index: int, turn: float = 0.0) -> Key:
    """Name the pose of a keyframe."""
    return Key("x", index, turn)


def view_key(index: int) -> Key:
    """Name the pose of a view: its index in the views given to `WallSlam.solve`."""
    return Key("v", index)


def observer_key(index: int) -> Key:
    """Name the pose from which landmarks were observed."""
    return Key("o", index)


def wall_key(index: int) -> Key:
    """Name a wall."""
    return Key("w", index)


def surface_key(index: int) -> Key:
    """Name a surface plane; the index is the caller's."""
    return Key("s", index)


def corner_key(index: int) -> Key:
    """Name a corner."""
    return Key("c", index)


def building_key() -> Key:
    """Name the building's frame, turned so that its walls are off its axes."""
    return Key("f", 0, 0.25 * math.pi)
