"""Roll and pitch of the base by its IMU: accelerometer at rest, gyroscope while driving.

The vertical by an accelerometer has a constant error of a degree or two, from its bias and its
mount. Roll and pitch are therefore relative to their usual value, that of drives: from stop to stop
a base gains no speed, so the mean specific force of a drive, minus the accelerations due to yaw, is
gravity. The usual value is the median over all drives of this run. Once a base has driven, its
inclination at a stop is known (on a door sill, on a ramp, with an arm stretched out).

During a drive, accelerations mask gravity, and the rates of the gyroscope are integrated. This is
accurate for some seconds straight ahead. A turn of the base rotates the mount error from roll into
pitch, so that after a turn there is no estimate until the next stop.

Insignificant angles are set to exactly 0, so that poses are byte-identical to those without an IMU.
If odometry contains roll or pitch itself, the IMU is not used.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.config import Config
from tccm_ros.geometry import between2
from tccm_ros.records import Imu, RollPitch
from tccm_ros.robot.base_motion import BaseMotion, MotionSource, is_standing
from tccm_ros.robot.gravity import (
    AVERAGED_STEPS,
    GRAVITIES,
    StopGravity,
    UsualRollPitch,
    nearest_gravity,
    roll_pitch_of,
)
from tccm_ros.robot.imu_mount import ImuMount
from tccm_ros.robot.tracks import ScalarTrack, Track

STEP_NS = 20_000_000
"""Roll and pitch are computed for each multiple of this (chosen: bases rock at some Hz), and
interpolated linearly."""

STANDING_NS = 100_000_000
"""A base is at rest if it has not moved for this time."""

SETTLING_STEPS = 25
"""A stopped base rocks for 0.5 s (chosen); gravity is averaged afterwards."""

BIAS_STEPS, MIN_BIAS_STEPS = 500, 50
"""The bias of the gyroscope is the median of its rates in the last 10 s at rest, available after 1
s: a base that sinks to one side meanwhile does not change it (chosen)."""

GRAVITY_SIGMA, USUAL_SIGMA = 0.001, 0.001
"""Standard deviations, rad, of roll and pitch by gravity at a stop, and of the usual values.
Chosen: 1 mg each, the bias stability of cheap accelerometers, at rest and with vibration of the
wheels.
"""

RATE_NOISE, RATE_SIGMA = 0.0005, 0.0003
"""Noise of integrated rates, rad/s^0.5, and standard deviation of their bias, rad/s (chosen: cheap
gyroscopes after a rest)."""

AXIS_SIGMA = 0.02
"""Fraction of a yaw that leaks into roll and pitch. Chosen: 1 deg error of the mount or of the
gravity direction."""

MAX_SIGMA = 0.02
"""Roll and pitch with a larger standard deviation (rad) are not used (chosen)."""

DELAY_STEPS = 10
"""Gravity is used with a delay of 0.2 s of rest, as wheels show motion late. Chosen: at 0.3 m/s2,
0.5 mm take 0.06 s, in addition to `STANDING_NS`."""

NO_GRAVITY = "imu: acceleration is not gravity"
"""Reason for unused samples of a base at rest."""

NONE_BELOW, ALL_FROM = 2.5, 4.0
"""Standard deviations below which roll and pitch are set to zero, and above which they are kept
unchanged (chosen: noise exceeds the first in one of 23 cases)."""

EVENT_STEPS = 5
"""Steps per event: 10 Hz (chosen)."""


def significant(roll_pitch: Float64, sigma: Float64 | float) -> Float64:
    """Return roll and pitch where they exceed the noise, else exactly 0.

    Firm shrinkage (Gao, Bruce: WaveShrink with firm shrinkage. Statistica Sinica, 1997) of the
    angle between the base and its usual attitude: continuous, and without bias for large angles.

    Parameters
    ----------
    roll_pitch
        float64 (..., 2), relative to the usual value, rad.
    sigma
        float64 (...), standard deviation of each component, rad.

    Returns
    -------
    float64 (..., 2), rad
    """
    angle = np.linalg.norm(roll_pitch, axis=-1)
    noise = np.asarray(sigma, float)
    none_below, all_from = NONE_BELOW * noise, ALL_FROM * noise
    kept = all_from * (angle - none_below) / np.maximum(angle * (all_from - none_below), 1e-300)
    return np.asarray(roll_pitch * np.clip(kept, 0.0, 1.0)[..., None])


class BaseRollPitch:
    """Roll and pitch of the base over time.

    Parameters
    ----------
    config
        A gap between samples wider than half of `sync_timeout` interrupts the estimate.
    motion, mount
        Motion of the base, and pose of the IMU on it.
    refuse
        Callback with the reason for an unused sample of a base at rest.

    Attributes
    ----------
    track
        float64 (6,): angular velocity, rad/s, and specific force, in the frame of the IMU.
    bias
        Rates at rest float64 (3,), rad/s, in the base; None while unknown.
    """

    def __init__(
        self, config: Config, motion: BaseMotion, mount: ImuMount, refuse: Callable[[str], None]
    ) -> None:
        self.track = Track(6)
        self._reported = ScalarTrack(), ScalarTrack()
        self._motion, self._mount, self._refuse = motion, mount, refuse
        self._max_gap_ns = round(config.sync_timeout * 1e9) // 2
        self._frame = ""
        self.clear_samples()

    def clear_samples(self) -> None:
        """Clear all time-stamped data, and the estimates of the IMU's errors."""
        self.track.clear()
        for track in self._reported:
            track.clear()
        self.bias: Float64 | None = None
        self._rates: deque[Float64] = deque(maxlen=BIAS_STEPS)
        self._until_ns: int | None = None
        self._has_tilting_odometry = False
        # Measured roll and pitch, including the accelerometer's bias; None while unknown.
        self._now: Float64 | None = None
        # Integral of the rates, rad; offset between gravity and the integral; magnitude of gravity.
        self._integral, self._gravity, self._g = np.zeros(2), StopGravity(), GRAVITIES[0]
        # At a stop: steps at rest so far, and gravity offsets within the delay.
        self._standing = 0
        self._waiting: deque[Float64] = deque()
        self._recent: deque[Float64] = deque(maxlen=DELAY_STEPS)
        # Since the last stop: time (s) and yaw (rad).
        self._moved_s, self._yaw = 0.0, 0.0
        self._usual = UsualRollPitch()
        self._events: list[RollPitch] = []

    def add(self, record: Imu) -> bool:
        """Add a sample; return whether it is newer than the previous one."""
        self._frame = record.frame_id
        force = np.full(3, np.nan) if record.acceleration is None else record.acceleration
        return self.track.append(record.stamp_ns, np.concatenate([record.angular_velocity, force]))

    def at(self, stamps_ns: Int64) -> Float64 | None:
        """Return roll and pitch relative to the usual value, rad, float64 (K, 2).

        The newest values are held for the widest allowed gap of samples. None if all are 0, or
        unknown.
        """
        last_ns = self._reported[0].latest_ns
        if last_ns is None or stamps_ns[-1] > last_ns + self._max_gap_ns:
            return None
        known_ns = np.minimum(stamps_ns, last_ns)
        if not self._reported[0].brackets(int(known_ns[0]), int(known_ns[-1]), self._max_gap_ns):
            return None
        found = np.column_stack([track.at(known_ns, wraps=False) for track in self._reported])
        return found if found.any() else None

    def awaited(self, stamp_ns: int) -> tuple[int, list[Track]]:
        """Return the stamp and the tracks that roll and pitch at a stamp wait for.

        Returns
        -------
        The stamp in ns, and the tracks that have no sample at or after it yet; none where the IMU
        is not used, or its clock is far off.
        """
        needed_ns, heard_ns = _step_after(stamp_ns), self.track.latest_ns
        if self._until_ns is None or heard_ns is None or self._has_tilting_odometry:
            return needed_ns, []
        if abs(needed_ns - heard_ns) > 2 * self._max_gap_ns:
            return needed_ns, []
        tracks = [self.track, *self._motion.tracks("")]
        return needed_ns, [t for t in tracks if t.latest_ns is None or t.latest_ns < needed_ns]

    def take(self) -> list[RollPitch]:
        """Process all samples of IMU and odometry so far; return the new events."""
        newest_ns = self._newest_ns()
        if newest_ns is None:
            return []
        T_base_imu = self._mount.pose(self._frame)
        if T_base_imu is None:
            return []
        if self._until_ns is None:
            self._until_ns = _step_after(int(self.track.stamps_ns[0]))
        while self._until_ns + STEP_NS <= newest_ns and not self._has_tilting_odometry:
            self._step(self._until_ns, T_base_imu)
        events, self._events = self._events, []
        return events

    def _newest_ns(self) -> int | None:
        """Return the time until which both the IMU and odometry are known."""
        if self._motion.source is not MotionSource.ODOMETRY or not len(self.track):
            return None
        imu_ns, odometry_ns = self.track.latest_ns, self._motion.latest_ns
        return None if imu_ns is None or odometry_ns is None else min(imu_ns, odometry_ns)

    def _step(self, start_ns: int, T_base_imu: Float64) -> None:
        """Process one step."""
        end_ns = start_ns + STEP_NS
        self._until_ns = end_ns
        if self._motion.has_roll_pitch:
            self._has_tilting_odometry = True
            return
        if not self.track.brackets(start_ns, end_ns, self._max_gap_ns):
            self._lose()
            stamps = self.track.stamps_ns
            self._until_ns = _step_after(int(stamps[np.searchsorted(stamps, end_ns)]))
            return
        mean = self._mean(start_ns, end_ns)
        rates, force = T_base_imu[:3, :3] @ mean[:3], T_base_imu[:3, :3] @ mean[3:]
        moved = self._motion.step(end_ns - STANDING_NS, end_ns, self._max_gap_ns)
        self._integrate(rates)
        if moved is None:
            self._lose()
        elif is_standing(moved):
            self._stand(rates, force)
        else:
            self._drive(moved, rates, force, T_base_imu[:3, 3])
        self._record(end_ns)

    def _mean(self, start_ns: int, end_ns: int) -> Float64:
        """Return the mean sample (6,) of a step, or of the samples around an empty step."""
        stamps = self.track.stamps_ns
        first, last = np.searchsorted(stamps, [start_ns, end_ns], "right")
        if first == last:
            first, last = first - 1, last + 1
        return np.asarray(self.track.values[first:last].mean(axis=0))

    def _integrate(self, rates: Float64) -> None:
        """Integrate the rates (3,) of the base over one step."""
        seconds = STEP_NS * 1e-9
        self._moved_s += seconds
        if self._now is None or self.bias is None:
            return
        x, y, yaw = (rates - self.bias) * seconds
        roll, pitch = self._now - (self._now if self._usual.value is None else self._usual.value)
        step = np.array([x + pitch * yaw, y - roll * yaw])
        self._integral, self._now = self._integral + step, self._now + step
        self._yaw += abs(yaw)

    def _stand(self, rates: Float64, force: Float64) -> None:
        """Estimate gravity, and the bias of the gyroscope, at rest."""
        self._usual.end()
        self._standing += 1
        self._recent.append(force)
        if self._standing <= SETTLING_STEPS:
            return
        self._rates.append(rates)
        if len(self._rates) >= MIN_BIAS_STEPS and self._standing % MIN_BIAS_STEPS == 0:
            self.bias = np.median(np.array(self._rates), axis=0)
        measured = roll_pitch_of(force)
        if measured is None:
            if np.isfinite(force).all():
                self._refuse(NO_GRAVITY)
            return
        self._g = nearest_gravity(force)
        self._waiting.append(measured - self._integral)
        if len(self._waiting) > DELAY_STEPS:
            self._average(self._waiting.popleft())

    def _average(self, offset: Float64) -> None:
        """Average the offset (2,), rad, between gravity and the integral of the rates."""
        if self._gravity.add(offset):
            self._now = self._integral + self._gravity.offset
            if self._gravity.is_averaged:
                self._moved_s, self._yaw = 0.0, 0.0
        elif not self._gravity.is_measured:
            self._now = None

    def _drive(self, moved: Float64, rates: Float64, force: Float64, arm: Float64) -> None:
        """Add the specific force of a step to a drive that began at a stop.

        Parameters
        ----------
        moved
            float64 (3,), motion by odometry in `STANDING_NS`, m and rad.
        rates, force
            float64 (3,), in the base frame.
        arm
            float64 (3,), position of the accelerometer in the base, m.
        """
        if self._standing:
            self._leave()
        if self.bias is None or not self._usual.is_driving:
            return
        yaw_rate, half = float(rates[2] - self.bias[2]), 0.5 * float(moved[2])
        # The chord of an arc is parallel to the heading in the middle of the arc.
        x, y, _ = between2([0.0, 0.0, half], moved) * (1e9 / STANDING_NS)
        of_yaw = yaw_rate * np.array([-y, x, 0.0]) - yaw_rate**2 * arm * [1.0, 1.0, 0.0]
        of_yaw *= self._g / GRAVITIES[0]
        self._usual.add(force, of_yaw)

    def _leave(self) -> None:
        """Begin a drive; the base starts to move slightly before the wheels show it."""
        if self._gravity.is_measured and not self._gravity.is_averaged:
            self._now = None
        self._standing = 0
        self._gravity.begin()
        self._waiting.clear()
        self._usual.begin([*self._recent])
        self._recent.clear()

    def _lose(self) -> None:
        """Discard roll and pitch until the next stop."""
        self._leave()
        self._usual.lose()
        self._now = None

    @property
    def _sigma(self) -> float:
        """Standard deviation of roll and pitch, rad."""
        gravity = self._gravity
        if self._now is None or (gravity.is_measured and not gravity.is_averaged):
            return math.inf
        by_gravity = GRAVITY_SIGMA**2 + USUAL_SIGMA**2 + gravity.scatter / AVERAGED_STEPS
        if self._moved_s == 0.0:
            return math.sqrt(by_gravity)
        if self.bias is None:
            return math.inf
        drift = (RATE_SIGMA * self._moved_s) ** 2 + (AXIS_SIGMA * self._yaw) ** 2
        return math.sqrt(by_gravity + RATE_NOISE**2 * self._moved_s + drift)

    def _record(self, stamp_ns: int) -> None:
        """Record roll and pitch at the end of a step."""
        sigma, now, usual, found = self._sigma, self._now, self._usual.value, np.zeros(2)
        if now is not None and usual is not None and sigma <= MAX_SIGMA:
            found = significant(now - usual, sigma)
        if now is not None and sigma <= MAX_SIGMA and stamp_ns // STEP_NS % EVENT_STEPS == 0:
            known = None if usual is None else _pair(usual)
            self._events.append(RollPitch(stamp_ns, _pair(now), sigma, known))
        for track, value in zip(self._reported, found.tolist()):
            track.append(stamp_ns, value)


def _pair(values: Float64) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _step_after(stamp_ns: int) -> int:
    """Return the first multiple of a step at or after a stamp."""
    return -(-stamp_ns // STEP_NS) * STEP_NS
