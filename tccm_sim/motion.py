"""Motion of the base: a differential drive along waypoints, roll and pitch, wheel odometry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.random import Generator

from tccm_ros.arrays import Float64
from tccm_ros.kernels import kernel

# All chosen, in the range of small robots.
STEP = 0.01  # s, between the samples of a drive
SPEED, ACCELERATION = 0.5, 0.4  # m/s, m/s2
MAX_YAW_RATE, YAW_ACCELERATION = 0.9, 1.8  # rad/s, rad/s2
SETTLING_TIME = 1.0  # s, before a stop, in which the tilt from braking decays
TILT_TIME = 0.15  # s, time constant of the base's tilt
TILT_PER_ACCELERATION = 0.012  # rad per m/s2
STOP_TILT_TIME = 0.8  # s, in which the base's tilt at a stop builds up or decays
TILT_OF_FLOOR = 0.0012  # rad, amplitude of roll and pitch on an uneven floor


@dataclass(frozen=True)
class Waypoint:
    """A position to pass or to stop at.

    Attributes
    ----------
    x, y
        Position in the world, m.
    heading
        Yaw of the robot during a stop, rad; None for the yaw on arrival.
    pause
        Duration of the stop, s; 0 for none.
    """

    x: float
    y: float
    heading: float | None = None
    pause: float = 0.0


@dataclass(frozen=True)
class OdometryErrors:
    """Errors of wheel odometry.

    Attributes
    ----------
    scale, yaw_scale
        Factors of distances and of yaw changes.
    drift
        Yaw error per distance, rad/m.
    noise
        Position noise, m per square root of m.
    yaw_noise
        Yaw noise, rad per square root of m and of rad.
    """

    scale: float = 1.01
    yaw_scale: float = 0.995
    drift: float = 0.01
    noise: float = 0.004
    yaw_noise: float = 0.004


@dataclass(frozen=True)
class Drive:
    """The true motion of a base, linear between samples.

    Attributes
    ----------
    times
        float64 (T,), s.
    states
        float64 (T, 5): x, y in m, yaw (not wrapped), roll, pitch in rad.
    stops
        float64 (S, 2), start and end of each stop, s.
    """

    times: Float64
    states: Float64
    stops: Float64

    @cached_property
    def columns(self) -> Float64:
        """The states by column, float64 (5, T)."""
        return np.ascontiguousarray(self.states.T)

    def poses(self, times: Float64, height: float = 0.0) -> Float64:
        """Return T_world_base, float64 (B, 4, 4), at times (B,) in s; `height` is the base's z."""
        x, y, yaw, roll, pitch = (np.interp(times, self.times, column) for column in self.columns)
        cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
        cy, sy = np.cos(yaw), np.sin(yaw)
        T = np.zeros((len(times), 4, 4))
        T[:, 0, 0], T[:, 0, 1], T[:, 0, 2] = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
        T[:, 1, 0], T[:, 1, 1], T[:, 1, 2] = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
        T[:, 2, 0], T[:, 2, 1], T[:, 2, 2] = -sp, cp * sr, cp * cr
        T[:, 0, 3], T[:, 1, 3], T[:, 2, 3], T[:, 3, 3] = x, y, height, 1.0
        return T


def stand(duration: float) -> Drive:
    """Return the drive of a base standing at the origin for a time, s."""
    times = np.array([0.0, duration])
    return Drive(times, np.zeros((2, 5)), np.array([[0.0, duration]]))


def drive(route: Sequence[Waypoint], base_tilt: float = 1.0, speed: float = SPEED) -> Drive:
    """Return the drive along a route.

    Parameters
    ----------
    route
        Two or more waypoints; the first is the start, with its heading.
    base_tilt
        Factor of roll and pitch caused by acceleration and by the floor.
    speed
        Maximum speed, m/s.

    Returns
    -------
    Drive
    """
    goals = np.array(
        [(w.x, w.y, np.nan if w.heading is None else w.heading, w.pause) for w in route]
    )
    planar, speeds, stops = _follow(goals, speed)
    times = STEP * np.arange(len(planar), dtype=np.float64)
    states = np.column_stack([planar, base_tilt * _roll_pitch(planar, speeds)])
    return Drive(times, states, stops)


def tilted_at_stops(drive: Drive, sigma: float, random: Generator) -> Drive:
    """Return a drive with different roll and pitch of the base at each stop.

    They stand for a wheel on a door sill or an outstretched arm. They build up while the base
    stands, in `STOP_TILT_TIME` before a stop, and decay in the same time after it.

    Parameters
    ----------
    drive
        The drive.
    sigma
        Standard deviation of the added roll and pitch, rad.
    random
        Random generator.
    """
    if sigma == 0.0:
        return drive
    states, ramp = drive.states.copy(), [0.0, 1.0, 1.0, 0.0]
    for (start, end), added in zip(
        drive.stops, sigma * random.standard_normal((len(drive.stops), 2))
    ):
        around = [start - STOP_TILT_TIME, start, end, end + STOP_TILT_TIME]
        states[:, 3:] += np.outer(np.interp(drive.times, around, ramp), added)
    return replace(drive, states=states)


def _roll_pitch(planar: Float64, speeds: Float64) -> Float64:
    """Return roll and pitch (T, 2) from accelerations and from the floor's unevenness."""
    forward = np.gradient(speeds[:, 0], STEP)
    sideways = speeds[:, 0] * speeds[:, 1]
    roll, pitch = _low_pass(np.column_stack([sideways, -forward]), STEP / TILT_TIME).T
    x, y = planar[:, 0], planar[:, 1]
    rough = np.column_stack(
        [np.sin(2.1 * x + 0.7 * y + 0.4), np.sin(0.9 * x - 1.7 * y + 1.1)],
    )
    acceleration = np.column_stack([roll, pitch])
    return TILT_PER_ACCELERATION * acceleration + TILT_OF_FLOOR * rough


def wheel_odometry(
    true: Drive, errors: OdometryErrors, start: tuple[float, float, float], random: Generator
) -> Float64:
    """Return the wheel odometry at the drive's samples.

    Parameters
    ----------
    true
        The true motion.
    errors
        Errors of the odometry.
    start
        Initial x, y, yaw of the odometry, m and rad.
    random
        Random generator of noise.

    Returns
    -------
    float64 (T, 3)
        x, y, yaw in odom, m and rad.
    """
    states = true.states
    forward = np.cos(states[:-1, 2] + np.diff(states[:, 2]) / 2.0)
    left = np.sin(states[:-1, 2] + np.diff(states[:, 2]) / 2.0)
    step = forward * np.diff(states[:, 0]) + left * np.diff(states[:, 1])
    yaw_step = np.diff(states[:, 2])
    noise = random.standard_normal((len(step), 2))
    path, angle = np.abs(step), np.abs(yaw_step)
    step = errors.scale * step + errors.noise * np.sqrt(path) * noise[:, 0]
    yaw_step = errors.yaw_scale * yaw_step + errors.drift * path
    yaw_step += errors.yaw_noise * np.sqrt(path + angle) * noise[:, 1]
    yaw = start[2] + np.concatenate([[0.0], np.cumsum(yaw_step)])
    middle = yaw[:-1] + yaw_step / 2.0
    x = start[0] + np.concatenate([[0.0], np.cumsum(step * np.cos(middle))])
    y = start[1] + np.concatenate([[0.0], np.cumsum(step * np.sin(middle))])
    return np.column_stack([x, y, yaw])


@kernel
def _low_pass(values: Float64, gain: float) -> Float64:
    """Return a first-order low pass of each column."""
    result = np.zeros_like(values)
    for i in range(1, len(values)):
        result[i] = result[i - 1] + gain * (values[i] - result[i - 1])
    return result


@kernel
def _wrap(angle: float) -> float:
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@kernel
def _towards(value: float, wanted: float, limit: float) -> float:
    """Return the speed moved towards the desired one by at most `limit`."""
    return value + min(max(wanted - value, -limit), limit)


@kernel
def _follow(goals: Float64, top_speed: float) -> tuple[Float64, Float64, Float64]:
    """Follow waypoints (x, y, heading or nan, pause): states (T, 3), speeds (T, 2), stops (S, 2).

    The robot rotates on the spot if the direction to the waypoint differs much from its yaw;
    otherwise it steers while driving. Before a stop it brakes. At a stop it rotates to the heading.
    """
    x, y = goals[0, 0], goals[0, 1]
    yaw = 0.0 if np.isnan(goals[0, 2]) else goals[0, 2]
    v, w = 0.0, 0.0
    states, speeds = [(x, y, yaw)], [(v, w)]
    stops = [(0.0, goals[0, 3])]
    for _ in range(round(goals[0, 3] / STEP)):
        states.append((x, y, yaw))
        speeds.append((0.0, 0.0))
    for g in range(1, len(goals)):
        is_stop = goals[g, 3] > 0.0 or g == len(goals) - 1
        while True:  # drive
            dx, dy = goals[g, 0] - x, goals[g, 1] - y
            distance, error = np.hypot(dx, dy), _wrap(np.arctan2(dy, dx) - yaw)
            if distance < (0.02 if is_stop else 0.35) or (distance < 0.2 and abs(error) > 1.2):
                break
            wanted = 0.0
            if abs(error) < 0.8:
                wanted = top_speed * np.cos(error) ** 3
                if is_stop:
                    wanted = min(wanted, np.sqrt(2.0 * 0.7 * ACCELERATION * distance))
            v = _towards(v, wanted, ACCELERATION * STEP)
            yaw_rate = min(max(2.0 * error, -MAX_YAW_RATE), MAX_YAW_RATE)
            w = _towards(w, yaw_rate, YAW_ACCELERATION * STEP)
            x, y = (
                x + v * STEP * np.cos(yaw + w * STEP / 2),
                y + v * STEP * np.sin(yaw + w * STEP / 2),
            )
            yaw += w * STEP
            states.append((x, y, yaw))
            speeds.append((v, w))
        if not is_stop:
            continue
        heading, still = goals[g, 2], 0.0
        while still < SETTLING_TIME:  # brake, turn on the spot, settle
            error = 0.0 if np.isnan(heading) else _wrap(heading - yaw)
            v = _towards(v, 0.0, ACCELERATION * STEP)
            yaw_rate = np.sign(error) * min(
                np.sqrt(1.4 * YAW_ACCELERATION * abs(error)), MAX_YAW_RATE
            )
            if abs(error) < 0.004:
                yaw_rate = 0.0
            w = _towards(w, yaw_rate, YAW_ACCELERATION * STEP)
            x, y = x + v * STEP * np.cos(yaw), y + v * STEP * np.sin(yaw)
            yaw += w * STEP
            still = still + STEP if v == 0.0 and w == 0.0 and yaw_rate == 0.0 else 0.0
            states.append((x, y, yaw))
            speeds.append((v, w))
        if goals[g, 3] > 0.0:
            now = (len(states) - 1) * STEP
            stops.append((now, now + goals[g, 3]))
            for _ in range(round(goals[g, 3] / STEP)):
                states.append((x, y, yaw))
                speeds.append((0.0, 0.0))
    return np.array(states), np.array(speeds), np.array(stops)
