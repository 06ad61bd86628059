"""What a recording holds for calibration: sweeps with all that places their beams, and level scans.

Sweeps hold an uncorrected rig; whatever corrects it is applied by `RigModel`, so that the same
beams can be placed again and again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Bool, Float32, Float64, Int64
from tccm_ros.geometry import inverse, planar
from tccm_ros.robot.chain import Chain

__all__ = ["LevelScans", "Recording", "TiltSweep", "is_near"]

#: A sweep in which the base moves further than this (m) or turns more (rad) is not standing.
STILL_DISTANCE, STILL_TURN = 0.01, np.deg2rad(0.3)


@dataclass(frozen=True, slots=True, eq=False)
class TiltSweep:
    """One sweep of the tilting laser.

    Attributes
    ----------
    chain, tilt
        T_base_laser with its own copy of the samples, uncorrected, and the index of the tilt
        joint among its parts.
    stamps_ns
        int64 (R, B), time of each beam of each scan.
    ranges
        float32 (R, B), m; nan where nothing valid was seen.
    bearings
        float64 (B,), rad.
    T_odom_base
        float64 (R, 4, 4), the base at the middle of each scan.
    span_ns
        First and last stamp.
    """

    chain: Chain
    tilt: int
    stamps_ns: Int64
    ranges: Float32
    bearings: Float64
    T_odom_base: Float64
    span_ns: tuple[int, int]

    @property
    def place(self) -> Float64:
        """The base in the middle of the sweep, float64 (3,): x, y, yaw in odom."""
        return planar(self.T_place)

    @property
    def T_place(self) -> Float64:
        """Return T_odom_base in the middle of the sweep, float64 (4, 4)."""
        T: Float64 = self.T_odom_base[len(self.T_odom_base) // 2]
        return T

    @property
    def is_still(self) -> bool:
        """Whether the base stood."""
        return bool(is_near(planar(self.T_odom_base), self.place).all())

    def T_place_base(self) -> Float64:
        """Return the base during each scan seen from `place`, float64 (R, 4, 4)."""
        return inverse(self.T_place) @ self.T_odom_base


@dataclass(frozen=True, slots=True, eq=False)
class LevelScans:
    """Scans of the level laser at one place.

    Attributes
    ----------
    points
        float64 (N, 3), m, in the laser's frame.
    T_base_laser
        float64 (4, 4), uncorrected.
    T_place_base
        float64 (N, 4, 4), the base at each point's scan seen from the place.
    ranges
        float64 (N,), m.
    """

    points: Float64
    T_base_laser: Float64
    T_place_base: Float64
    ranges: Float64


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """What is used of one or several bags.

    Attributes
    ----------
    bags
        Names of the bags.
    sweeps
        By bag, each bag's in order of time.
    places
        int64 (S,), the place of each sweep: sweeps from where the base stood still are together.
    bag
        int64 (P,), the bag of each place.
    poses
        float64 (P, 3), x, y, yaw of the base at each place, seen from the first place of its bag.
    level
        Scans of the level laser by place.
    base, footprint_z
        Name of the base frame, and the height in it of a frame that lies on the floor by its name
        (``base_footprint``, REP-120), None if there is none.
    moving
        Whether sweeps had to be used in which the base moved.
    """

    bags: tuple[str, ...]
    sweeps: Sequence[TiltSweep]
    places: Int64
    bag: Int64
    poses: Float64
    level: Mapping[int, LevelScans]
    base: str
    footprint_z: float | None
    moving: bool

    def sweeps_of(self, bag: int) -> tuple[int, int]:
        """Return the numbers of a bag's first sweep and of the one after its last."""
        mine = np.flatnonzero(self.bag[self.places] == bag)
        return int(mine[0]), int(mine[-1]) + 1


def is_near(poses: Float64, place: Float64) -> Bool:
    """Return which poses float64 (..., 3), x, y, yaw, are where a base at a place (3,) stands."""
    distance = np.hypot(poses[..., 0] - place[0], poses[..., 1] - place[1])
    turn = np.abs(np.angle(np.exp(1j * (poses[..., 2] - place[2]))))
    return (distance < STILL_DISTANCE) & (turn < STILL_TURN)
