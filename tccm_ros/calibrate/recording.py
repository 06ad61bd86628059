"""Input of a calibration: scans of tilt cycles with the samples of their joints, and level scans.

The chains of joints are uncorrected; `RigModel` applies corrections, so that the same beams can be
transformed for any rig parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Bool, Float32, Float64, Int64
from tccm_ros.geometry import inverse, planar
from tccm_ros.robot.chain import JointReading, TransformChain

STILL_DISTANCE, STILL_YAW = 0.01, np.deg2rad(0.3)
"""Maximum change of position and yaw of a base at rest, m and rad (chosen: above the noise of
odometry at rest)."""


@dataclass(frozen=True, slots=True, eq=False)
class CycleScans:
    """The tilting laser's scans of one tilt cycle, or the rows of one depth image.

    Attributes
    ----------
    chain, tilt
        T_base_laser with its own copy of the samples, uncorrected, and the index of the tilt joint
        among its parts.
    stamps_ns
        int64 (R, B), time of each beam of each scan.
    ranges
        float32 (R, B), m; NaN for invalid ranges.
    directions
        float64 (1, B, 3) of a laser, (R, B, 3) of an image: unit vectors in the sensor's frame.
    T_odom_base
        float64 (R, 4, 4), pose of the base at the middle of each scan.
    span_ns
        First and last stamp.
    """

    chain: TransformChain
    tilt: int
    stamps_ns: Int64
    ranges: Float32
    directions: Float64
    T_odom_base: Float64
    span_ns: tuple[int, int]

    @property
    def is_image(self) -> bool:
        """Whether it is a depth image, in which each row has its own directions."""
        return len(self.directions) > 1

    @property
    def pan(self) -> int | None:
        """Index of the pan joint of a head among the parts of the chain; None without one."""
        turning = [
            number
            for number, (part, _) in enumerate(self.chain.parts[: self.tilt])
            if isinstance(part, JointReading) and part.is_revolute
        ]
        return turning[-1] if self.is_image and turning else None

    @property
    def place(self) -> Float64:
        """Pose of the base in the middle of the tilt cycle, float64 (3,): x, y, yaw in odom."""
        return planar(self.T_place)

    @property
    def T_place(self) -> Float64:
        """T_odom_base in the middle of the tilt cycle, float64 (4, 4)."""
        T: Float64 = self.T_odom_base[len(self.T_odom_base) // 2]
        return T

    @property
    def is_still(self) -> bool:
        """Whether the base was at rest."""
        return bool(is_near(planar(self.T_odom_base), self.place).all())

    def T_place_base(self) -> Float64:
        """Return the base during each scan relative to `place`, float64 (R, 4, 4)."""
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
        float64 (N, 4, 4), pose of the base at each point's scan relative to the place.
    ranges
        float64 (N,), m.
    """

    points: Float64
    T_base_laser: Float64
    T_place_base: Float64
    ranges: Float64


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationRecording:
    """The used scans of one or several bags.

    Attributes
    ----------
    bags
        Names of the bags.
    cycles
        Tilt cycles by bag, in order of time within a bag.
    places
        int64 (S,), place of each tilt cycle: consecutive tilt cycles have one place while the base
        is at rest.
    bag
        int64 (P,), bag of each place.
    poses
        float64 (P, 3), x, y, yaw of the base at each place, relative to the first place of its bag.
    level
        Scans of the level laser by place.
    base, footprint_z
        Name of the base frame, and the height in it (m) of a frame on the floor by its name
        (``base_footprint``, REP-120); None without one.
    moving
        Whether tilt cycles of a moving base had to be used.
    """

    bags: tuple[str, ...]
    cycles: Sequence[CycleScans]
    places: Int64
    bag: Int64
    poses: Float64
    level: Mapping[int, LevelScans]
    base: str
    footprint_z: float | None
    moving: bool

    def cycles_of(self, bag: int) -> tuple[int, int]:
        """Return the range of a bag's tilt cycles: the first, and one past the last."""
        mine = np.flatnonzero(self.bag[self.places] == bag)
        return int(mine[0]), int(mine[-1]) + 1


def evenly(count: int, max_count: int) -> Int64:
    """Return up to `max_count` of the indices 0 to `count` - 1, evenly spaced, int64 (N,)."""
    if count <= max_count:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, min(count, max_count)).astype(np.int64))


def is_near(poses: Float64, place: Float64) -> Bool:
    """Return a mask of poses float64 (..., 3), x, y, yaw, equal to a place (3,) within noise."""
    distance = np.hypot(poses[..., 0] - place[0], poses[..., 1] - place[1])
    yaw = np.abs(np.angle(np.exp(1j * (poses[..., 2] - place[2]))))
    return (distance < STILL_DISTANCE) & (yaw < STILL_YAW)
