"""Height, roll and pitch of the base, which are not variables of the pose graph.

The graph estimates x, y and yaw. Wheel odometry has no other components; odometry of a legged robot
also contains the height of the base above the ground, and its roll and pitch, as does an IMU.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from tccm_ros.arrays import Float64, Int64
from tccm_ros.geometry import pose_from_roll_pitch, spatial
from tccm_ros.records import RollPitch
from tccm_ros.robot.roll_pitch import significant
from tccm_ros.robot.tracks import Track, bracket

Attitude = tuple[float, float, float]
"""Height (m), roll and pitch (rad) of the base in the odometry frame."""

LEVEL: Attitude = (0.0, 0.0, 0.0)

MAX_GAP_NS = 500_000_000
"""Maximum gap between samples for interpolation (chosen)."""

QUANTUM = 0.00025
"""Quantisation step of the usual roll and pitch, rad. Chosen: 0.75 mm at 3 m; avoids small motions
of all views after each drive."""

UNBOUNDED_NS = 2**62
"""History of the samples: unlimited, as all views of a run may be solved again."""


def attitude_of(T_odom_base: Float64) -> Attitude:
    """Return the attitude of a pose float64 (4, 4)."""
    x, y, z, height = np.asarray(T_odom_base, float)[2].tolist()
    return height + 0.0, math.atan2(y, z) + 0.0, math.asin(min(max(-x, -1.0), 1.0)) + 0.0  # no -0.0


def with_attitude(poses: ArrayLike, attitudes: ArrayLike) -> Float64:
    """Return poses (..., 4, 4) of planar poses (..., 3) with attitudes (..., 3)."""
    T, given = spatial(poses), np.asarray(attitudes, float)
    if given.any():
        T[..., 2, 3] = given[..., 0]
        T = T @ pose_from_roll_pitch(given[..., 1:])
    return T


def interpolate(stamps_ns: Int64, values: Float64, asked_ns: ArrayLike) -> Float64:
    """Return values at stamps, linear between samples, held at the ends; 0 without samples.

    Parameters
    ----------
    stamps_ns, values
        int64 (N,), increasing, and float64 (N, 3), the samples.
    asked_ns
        int64 (M,).

    Returns
    -------
    float64 (M, 3)
    """
    asked = np.atleast_1d(np.asarray(asked_ns, np.int64))
    if not len(values):
        return np.zeros((len(asked), 3))
    # Relative to the first stamp, nanoseconds are exact in float64 for a hundred days.
    wanted, known = (asked - stamps_ns[0]).astype(float), (stamps_ns - stamps_ns[0]).astype(float)
    return np.stack([np.interp(wanted, known, column) for column in values.T], axis=1)


class AttitudeTrack:
    """Height, roll and pitch of the base over time; samples are added in stamp order."""

    def __init__(self) -> None:
        self._samples = Track(3, UNBOUNDED_NS)
        self._newest_ns = 0

    def add(self, stamp_ns: int, attitude: Attitude) -> None:
        """Add a sample; runs of equal samples are stored as their first and last one."""
        value, known = np.array(attitude), self._samples
        if not len(known) or not np.array_equal(known.values[-1], value):
            if len(known):
                known.append(self._newest_ns, known.values[-1].copy())
            known.append(stamp_ns, value)
        self._newest_ns = max(self._newest_ns, stamp_ns)

    def at(self, stamps_ns: Sequence[int] | Int64) -> Float64:
        """Return attitudes float64 (N, 3) at N stamps.

        They are interpolated linearly, held at the ends, and 0 without samples.
        """
        return interpolate(self._samples.stamps_ns, self._samples.values, stamps_ns)


class RollPitchTrack:
    """Roll and pitch of the base at views by its IMU, relative to the mean over the whole run.

    When a tilt cycle is posed, later drives are unknown. A solution uses all drives, so that views
    of the first stop have roll and pitch as well.
    """

    def __init__(self) -> None:
        self._samples = Track(3, UNBOUNDED_NS)
        self._usual: Float64 | None = None

    def __len__(self) -> int:
        return len(self._samples)

    def add(self, sample: RollPitch) -> None:
        """Add a sample; one that is not newer than the previous one is dropped."""
        is_newer = self._samples.append(sample.stamp_ns, np.array([*sample.measured, sample.sigma]))
        if is_newer and sample.usual is not None:
            self._usual = np.round(np.array(sample.usual) / QUANTUM) * QUANTUM

    def at(self, stamps_ns: Sequence[int]) -> Float64:
        """Return roll and pitch relative to the usual value at V stamps, rad, float64 (V, 2).

        They are exactly 0 where they are insignificant or unknown.
        """
        found = np.zeros((len(stamps_ns), 2))
        if self._usual is None:
            return found
        times, values = self._samples.stamps_ns, self._samples.values
        for v, stamp in enumerate(stamps_ns):
            if not self._samples.brackets(stamp, stamp, MAX_GAP_NS):
                continue
            first, last, fraction = bracket(times, stamp)
            mixed = values[first, :2] + fraction * (values[last, :2] - values[first, :2])
            found[v] = significant(mixed - self._usual, max(values[first, 2], values[last, 2]))
        return found
