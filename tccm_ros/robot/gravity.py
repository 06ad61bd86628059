"""Roll and pitch of the base from gravity: accelerometer readings at stops and over drives."""

from __future__ import annotations

import math

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import wrap_angle

AVERAGED_STEPS = 50
"""Steps (`roll_pitch.STEP_NS`) over which gravity is averaged at a stop; the mean is used after
half of them. Chosen: 1 s."""

MAX_OFF = 0.03
"""A gravity direction that differs from the gyroscope's by more than this (rad) is an outlier: the
base is pushed, or the clock of the IMU is off. After many outliers the average restarts. Chosen:
0.3 m/s2, several times the noise of cheap accelerometers."""

MIN_DRIVE_STEPS = 100
"""Shorter drives do not contribute to the usual roll and pitch. Chosen: 2 s."""

MAX_USUAL = 0.2
"""Larger roll or pitch (rad) is no accelerometer bias. Chosen: 11 deg; the IMU is mounted
differently from its frame, or the base has fallen over."""

GRAVITIES, TOLERANCE = (9.81, 1.0), 0.05
"""Magnitude of gravity in m/s2, and in g as some drivers report it; forces that differ by more than
this fraction are not gravity (chosen)."""


class StopGravity:
    """Mean offset at a stop between gravity and the integral of the gyroscope's rates.

    Attributes
    ----------
    offset
        Roll and pitch float64 (2,), rad, to add to the integral.
    scatter
        Variance of a single measurement, rad2.
    """

    def __init__(self) -> None:
        self.offset, self.scatter = np.zeros(2), 0.0
        self.begin()

    def begin(self) -> None:
        """Begin a new stop."""
        self._measured, self._contradictions = 0, 0

    @property
    def is_measured(self) -> bool:
        """Whether this stop has a mean."""
        return self._measured > 0

    @property
    def is_averaged(self) -> bool:
        """Whether the mean of this stop has enough samples."""
        return 2 * self._measured >= AVERAGED_STEPS

    def add(self, offset: Float64) -> bool:
        """Add the offset of a step, float64 (2,), rad; return whether it is an inlier.

        Outliers are left out; after half of `AVERAGED_STEPS` outliers in a row, the mean is dropped
        instead.
        """
        if self._measured and np.abs(offset - self.offset).max() > MAX_OFF:
            self._contradictions += 1
            if self._contradictions >= AVERAGED_STEPS // 2:
                self._measured = 0
            return False
        self._measured, self._contradictions = self._measured + 1, 0
        if self._measured == 1:
            self.offset, self.scatter = offset, 0.0
        difference, gain = offset - self.offset, 1.0 / min(self._measured, AVERAGED_STEPS)
        self.offset = self.offset + gain * difference
        self.scatter += gain * (0.5 * float(difference @ difference) - self.scatter)
        return True


class UsualRollPitch:
    """Mean roll and pitch of drives: from stop to stop, the mean specific force is gravity.

    Attributes
    ----------
    value
        Median over the drives float64 (2,), rad; None before the first drive has ended.
    """

    def __init__(self) -> None:
        self.value: Float64 | None = None
        self._steps, self._forces = -1, np.zeros(3)
        self._drives: list[Float64] = []

    @property
    def is_driving(self) -> bool:
        """Whether a drive began at a stop and has no gaps so far."""
        return self._steps > 0

    def begin(self, forces: list[Float64]) -> None:
        """Begin a drive at a stop; the first steps have specific forces float64 (3,)."""
        if self._steps == 0:
            self._steps, self._forces = len(forces), np.sum(forces, axis=0)

    def add(self, force: Float64, of_yaw: Float64) -> None:
        """Add the specific force of a step, and the part due to yaw motion, float64 (3,)."""
        self._steps, self._forces = self._steps + 1, self._forces + force - of_yaw

    def end(self) -> None:
        """End the drive at a stop; it is used if it has `MIN_DRIVE_STEPS`."""
        if self._steps >= MIN_DRIVE_STEPS:
            measured = roll_pitch_of(self._forces / self._steps)
            if measured is not None:
                self._drives.append(measured)
                self.value = np.median(np.array(self._drives), axis=0)
        self._steps, self._forces = 0, np.zeros(3)

    def lose(self) -> None:
        """Discard the drive, as part of it is unknown."""
        self._steps = -1


def roll_pitch_of(force: Float64) -> Float64 | None:
    """Return the roll and pitch (2,), rad, of the base from a specific force (3,) at rest.

    Roll is positive where the left side is up, pitch where the front is down (REP-103). None where
    the force is not gravity, or far from the vertical.
    """
    length = float(np.linalg.norm(force))
    if not any(abs(length - g) <= TOLERANCE * g for g in GRAVITIES):
        return None
    x, y, z = force.tolist()
    found = wrap_angle([math.atan2(y, z), math.atan2(-x, math.hypot(y, z))])
    return found if np.abs(found).max() <= MAX_USUAL else None


def nearest_gravity(force: Float64) -> float:
    """Return the value of `GRAVITIES` nearest to the magnitude of a specific force (3,)."""
    return min(GRAVITIES, key=lambda g: abs(g - float(np.linalg.norm(force))))
