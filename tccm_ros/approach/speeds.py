"""Velocity commands within limits, with compensation of latency and braking before the goal."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import between2, compose2, wrap_angle

HEADING_GAIN, OFFSET_GAIN = 1.5, 2.0
"""Gains: yaw rate per heading error, 1/s, and heading per offset from the line, rad/m. Chosen: with
a latency of 0.1 s to 0.2 s the linear system is stable by a factor of 3 (gain times latency below
0.5)."""

MAX_AIM_RAD = 0.5
"""Maximum angle to the line while the base corrects an offset from it, rad."""

SLOW_GAIN = 2.0
"""Velocity per distance near the end of a motion, 1/s: it prevents overshoot."""

HOLD_S = 0.3
"""Longest time that a command acts where the next one is late, s: one period of the loop, in which
it is computed, and 0.25 s, the timeout of the base's watchdog in docs/guides/approaching.md."""

MAX_DELAY_S = 1.0
"""Maximum age of commands in the history, s."""


class SpeedLimits(NamedTuple):
    """Limits of velocity and acceleration.

    Attributes
    ----------
    speed, yaw_rate
        m/s and rad/s.
    acceleration, yaw_acceleration
        m/s2 and rad/s2.
    """

    speed: float
    yaw_rate: float
    acceleration: float
    yaw_acceleration: float


class Speeds(NamedTuple):
    """Velocity command: forward, m/s, and yaw rate, counter-clockwise, rad/s."""

    forward: float = 0.0
    yaw_rate: float = 0.0


STOP = Speeds()


def braking_velocity(distance: float, top: float, acceleration: float) -> float:
    """Return the maximum velocity from which the base stops within a signed distance, m/s.

    Parameters
    ----------
    distance
        m; the velocity has its sign. Angles work alike.
    top, acceleration
        Maximum speed and deceleration, >= 0.
    """
    way = abs(distance)
    speed = min(top, math.sqrt(2.0 * acceleration * way), SLOW_GAIN * way)
    return math.copysign(speed, distance)


def safe_speed(way: float, top: float, acceleration: float) -> float:
    """Return the maximum speed that may act for `HOLD_S` and still stops within a distance, m/s.

    Parameters
    ----------
    way
        Free distance, m, >= 0. Angles work alike.
    top, acceleration
        Maximum speed and deceleration, >= 0.
    """
    held = acceleration * HOLD_S
    return min(top, math.sqrt(held * held + 2.0 * acceleration * way) - held)


def rotate_to(yaw_error: float, limits: SpeedLimits) -> Speeds:
    """Return the velocities of a turn in place by an angle, rad."""
    return Speeds(0.0, braking_velocity(yaw_error, limits.yaw_rate, limits.yaw_acceleration))


def along_line(pose: Float64, goal: Float64, limits: SpeedLimits, speed: float) -> Speeds:
    """Return the velocities that drive the base along the x axis of a goal pose, up to it.

    Parameters
    ----------
    pose, goal
        float64 (3,), planar poses of the base now and at the end.
    limits
        Velocity limits of the base.
    speed
        Maximum speed on this path, m/s.
    """
    x, y, yaw = between2(goal, pose).tolist()
    forward = braking_velocity(-x, min(speed, limits.speed), limits.acceleration)
    direction = math.copysign(1.0, forward)
    aim = -direction * math.copysign(min(abs(OFFSET_GAIN * y), MAX_AIM_RAD), y)
    # An offset can be corrected only while driving: near the end only the heading is controlled.
    aim *= min(abs(forward) / limits.speed * 4.0, 1.0)
    yaw_rate = HEADING_GAIN * float(wrap_angle(aim - yaw))
    return Speeds(forward, max(-limits.yaw_rate, min(yaw_rate, limits.yaw_rate)))


class CommandHistory:
    """Sent commands, from which the pose at the next command's effect is predicted.

    Parameters
    ----------
    limits
        Velocity limits of the base.
    latency_s
        Latency from a command to its motion, s.
    """

    def __init__(self, limits: SpeedLimits, latency_s: float):
        self._limits, self._latency_s = limits, latency_s
        self._sent: deque[tuple[float, Speeds]] = deque()

    @property
    def newest(self) -> Speeds:
        """The last command."""
        return self._sent[-1][1] if self._sent else STOP

    def predict_pose(self, pose: Float64, stamp_s: float, now_s: float) -> Float64:
        """Return the predicted pose (3,) of the base when a command sent now takes effect.

        Parameters
        ----------
        pose
            float64 (3,), pose of the base at `stamp_s`.
        stamp_s, now_s
            s, on the clock of the commands.
        """
        start = max(stamp_s, now_s - MAX_DELAY_S)
        edges = [(at + self._latency_s, speeds) for at, speeds in self._sent]
        ends = [at for at, _ in edges[1:]] + [now_s + self._latency_s]
        for (begin, speeds), end in zip(edges, ends):
            duration = min(end, now_s + self._latency_s) - max(begin, start)
            if duration > 0.0:
                pose = compose2(pose, _arc(speeds, duration))
        return pose

    def send(self, wanted: Speeds, now_s: float, period_s: float) -> Speeds:
        """Record and return the next command: the wanted one within the limits.

        Parameters
        ----------
        wanted
            Wanted velocities.
        now_s, period_s
            Time of the command, and the time to the next, s.
        """
        last, limits = self.newest, self._limits
        # Deceleration may be twice the acceleration limit.
        forward = _stepped(last.forward, wanted.forward, limits.acceleration * period_s)
        yaw_rate = _stepped(last.yaw_rate, wanted.yaw_rate, limits.yaw_acceleration * period_s)
        return self._note(Speeds(forward, yaw_rate), now_s)

    def stop(self, now_s: float) -> Speeds:
        """Record and return the zero command, without a limit of deceleration."""
        return self._note(STOP, now_s)

    def _note(self, speeds: Speeds, now_s: float) -> Speeds:
        limits = self._limits
        sent = Speeds(
            max(-limits.speed, min(speeds.forward, limits.speed)),
            max(-limits.yaw_rate, min(speeds.yaw_rate, limits.yaw_rate)),
        )
        self._sent.append((now_s, sent))
        while len(self._sent) > 1 and self._sent[1][0] < now_s - MAX_DELAY_S - self._latency_s:
            self._sent.popleft()
        return sent


def _stepped(last: float, wanted: float, step: float) -> float:
    """Return a velocity one step nearer to the wanted one; the step of deceleration is double."""
    is_slower = abs(wanted) < abs(last) and wanted * last >= 0.0
    step = 2.0 * step if is_slower else step
    return last + max(-step, min(wanted - last, step))


def _arc(speeds: Speeds, duration_s: float) -> Float64:
    """Return the planar motion (3,) at constant velocities."""
    angle = speeds.yaw_rate * duration_s
    way = speeds.forward * duration_s
    # sin(a) / a and (1 - cos(a)) / a, also at 0.
    x = way * float(np.sinc(angle / np.pi))
    y = way * 0.5 * angle * float(np.sinc(0.5 * angle / np.pi)) ** 2
    return np.array([x, y, angle])
