"""How far the base has turned, by its gyroscope: the bias is learnt while the wheels stand.

The rate about the base's vertical axis is integrated from one question to the next (trapezoids over
the samples). A MEMS gyroscope reports up to a degree per second while it rests, and that changes
with its temperature: until the base has stood for a while, and the bias is known, nothing is told.
Nor is it before a first turn in which the gyroscope agreed roughly with the wheels: an IMU that is
mounted another way than its frame says, or counts in degrees, is not used. All of it is a function
of the samples up to the stamp that is asked for.
"""

from __future__ import annotations

import math

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.records import Imu
from tccm_ros.robot.base_motion import BaseMotion, is_standing
from tccm_ros.robot.imu_mount import ImuMount
from tccm_ros.robot.tracks import Track

SETTLING_TIME, LEARNING_TIME, MEMORY = 0.5, 1.0, 60.0
"""The bias is learnt once the wheels have stood for the first time (s: the base rocks), is told
after the second, and is the mean of the last s of standing (chosen: it drifts over minutes)."""

MAX_BIAS = 0.05
"""A rate (rad/s) that is no bias: the base is turned while its wheels stand. Chosen: 3 deg/s, three
times what consumer gyroscopes have."""

MIN_TURNED, AGREEMENT = 0.3, (0.4, 2.5)
"""The gyroscope is believed once the wheels have turned by so much (rad) and its yaw has been
between these multiples of theirs (chosen: wheels that skid report up to twice the yaw)."""

MAX_TURNED = 6.0
"""Older turns count less beyond this sum, rad (chosen: one round)."""


class GyroHeading:
    """The yaw that the base has turned through, by what an IMU measures.

    Parameters
    ----------
    config
        Samples with more than half of `sync_timeout` between them bracket nothing.
    motion, mount
        Motion of the base, and how the IMU is fixed to it.

    Attributes
    ----------
    track
        Angular velocities float64 (3,), rad/s, in the frame of the IMU.
    bias
        Rate at rest about the base's vertical axis, rad/s.
    """

    def __init__(self, config: Config, motion: BaseMotion, mount: ImuMount) -> None:
        self.track = Track(3)
        self._motion, self._mount = motion, mount
        self._max_gap_ns = round(config.sync_timeout * 1e9) // 2
        self._frame = ""
        self.clear_samples()

    def clear_samples(self) -> None:
        """Forget everything that has a stamp, and the bias with it."""
        self.track.clear()
        self.bias, self._learnt_s, self._standing_s = 0.0, 0.0, 0.0
        self._heading, self._by_wheels, self._by_gyro = 0.0, 0.0, 0.0
        self._until_ns: int | None = None

    def add(self, record: Imu) -> bool:
        """Take a sample; return whether it is newer than the one before."""
        self._frame = record.frame_id
        return self.track.append(record.stamp_ns, record.angular_velocity)

    def brackets(self, stamp_ns: int) -> bool:
        """Return whether the samples tell the rate at a stamp."""
        return self.track.brackets(stamp_ns, stamp_ns, self._max_gap_ns)

    def at(self, stamp_ns: int) -> float | None:
        """Return the heading at a stamp that is later than the one asked for before.

        Returns
        -------
        rad, counter-clockwise from above, from a direction of its own; None while the bias is not
        known or the wheels have not confirmed it, where samples are missing since the question
        before, and where nothing tells how the IMU is mounted. Differences of two headings count
        where there is no None between them.
        """
        before_ns, self._until_ns = self._until_ns, stamp_ns
        T_base_imu = self._mount.pose(self._frame)
        if T_base_imu is None or before_ns is None:
            return None
        if not self.track.brackets(before_ns, stamp_ns, self._max_gap_ns):
            self._standing_s = 0.0
            return None
        seconds = (stamp_ns - before_ns) * 1e-9
        turned = self._integral(before_ns, stamp_ns, np.ascontiguousarray(T_base_imu[2, :3]))
        wheels = self._motion.step(before_ns, stamp_ns, self._max_gap_ns)
        if wheels is None or not is_standing(wheels) or abs(turned) > MAX_BIAS * seconds:
            self._standing_s = 0.0
        else:
            self._learn(turned / seconds, seconds)
        turned -= self.bias * seconds
        self._heading += turned
        if not self._learnt_s >= LEARNING_TIME:
            return None
        if wheels is not None:
            self._compare(turned, float(wheels[2]))
        return self._heading if self._is_believed() else None

    def _learn(self, rate: float, seconds: float) -> None:
        """Learn the bias from the mean rate of a time in which the base stands."""
        self._standing_s += seconds
        if self._standing_s >= SETTLING_TIME:
            self._learnt_s = min(self._learnt_s + seconds, MEMORY)
            self.bias += min(seconds / self._learnt_s, 1.0) * (rate - self.bias)

    def _compare(self, turned: float, wheels: float) -> None:
        """Add up the yaw of the wheels, and that of the gyroscope in the same direction."""
        self._by_wheels += abs(wheels)
        self._by_gyro += math.copysign(turned, turned * wheels)
        if self._by_wheels > MAX_TURNED:
            self._by_wheels, self._by_gyro = 0.5 * self._by_wheels, 0.5 * self._by_gyro

    def _is_believed(self) -> bool:
        low, high = AGREEMENT
        agrees = low * self._by_wheels < self._by_gyro < high * self._by_wheels
        return agrees and self._by_wheels >= MIN_TURNED

    def _integral(self, start_ns: int, end_ns: int, axis: Float64) -> float:
        stamps = self.track.stamps_ns
        first = int(np.searchsorted(stamps, start_ns, "right")) - 1
        last = int(np.searchsorted(stamps, end_ns)) + 1
        since, rates = stamps[first:last] - start_ns, self.track.values[first:last] @ axis
        at = np.union1d(np.clip(since, 0, end_ns - start_ns), [0, end_ns - start_ns])
        return float(np.trapezoid(np.interp(at, since, rates), at * 1e-9))
