"""Yaw of the base by integration of its gyroscope; the bias is estimated while the wheels stand.

The rate about the base's vertical axis is integrated from one query to the next (trapezoidal rule).
A MEMS gyroscope at rest reports up to a degree per second, and this bias changes with temperature:
there is no heading until the base has stood long enough to estimate the bias. The wheels must also
have roughly confirmed the gyroscope in a first turn: this rejects an IMU that is mounted
differently from its frame, or reports degrees. The result depends only on the samples up to the
query's stamp.
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
"""Times of the bias estimation at rest, s: `SETTLING_TIME` is ignored (the base rocks), the bias is
used after `LEARNING_TIME`, and averaged over `MEMORY` (chosen: the bias drifts over minutes)."""

MAX_BIAS = 0.05
"""A larger rate (rad/s) is no bias: the base is rotated while its wheels stand. Chosen: 3 deg/s,
three times the bias of consumer gyroscopes."""

MIN_TURNED, AGREEMENT = 0.3, (0.4, 2.5)
"""The gyroscope is used once the wheels have rotated by `MIN_TURNED`, rad, if the ratio of
gyroscope to wheel yaw is within `AGREEMENT` (chosen: skidding wheels report up to twice the
yaw)."""

MAX_TURNED = 6.0
"""Sum of rotations above which older ones lose weight, rad (chosen: one revolution)."""


class GyroHeading:
    """Integrated yaw of the base from an IMU.

    Parameters
    ----------
    config
        A gap between samples wider than half of `sync_timeout` interrupts the heading.
    motion, mount
        Motion of the base, and pose of the IMU on it.

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
        """Clear all time-stamped data and the bias."""
        self.track.clear()
        self.bias, self._learnt_s, self._standing_s = 0.0, 0.0, 0.0
        self._heading, self._by_wheels, self._by_gyro = 0.0, 0.0, 0.0
        self._until_ns: int | None = None

    def add(self, record: Imu) -> bool:
        """Add a sample; return whether it is newer than the previous one."""
        self._frame = record.frame_id
        return self.track.append(record.stamp_ns, record.angular_velocity)

    def brackets(self, stamp_ns: int) -> bool:
        """Return whether samples bracket a stamp."""
        return self.track.brackets(stamp_ns, stamp_ns, self._max_gap_ns)

    def at(self, stamp_ns: int) -> float | None:
        """Return the heading at a stamp that is later than that of the previous call.

        Returns
        -------
        rad, counter-clockwise seen from above, with an arbitrary zero; None while the bias is
        unknown or the wheels have not confirmed the gyroscope, where samples are missing since the
        previous call, and where the mount of the IMU is unknown. Differences of two headings are
        valid if there was no None between them.
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
        """Update the bias with the mean rate of an interval at rest."""
        self._standing_s += seconds
        if self._standing_s >= SETTLING_TIME:
            self._learnt_s = min(self._learnt_s + seconds, MEMORY)
            self.bias += min(seconds / self._learnt_s, 1.0) * (rate - self.bias)

    def _compare(self, turned: float, wheels: float) -> None:
        """Accumulate the yaw of the wheels, and of the gyroscope in the same direction."""
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
        times = np.union1d(np.clip(since, 0, end_ns - start_ns), [0, end_ns - start_ns])
        return float(np.trapezoid(np.interp(times, since, rates), times * 1e-9))
