"""Speeds of the base: bounded, braking in time, for where it will be when they act."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import between2, compose2, wrap_angle

HEADING_GAIN, OFFSET_GAIN = 1.5, 2.0
"""Of the turn, 1/s per rad of heading, and rad of heading per m of offset from the line. Chosen:
with 0.1 s to 0.2 s of delay the linear system is stable by a factor of 3 (gain times delay below
0.5)."""

MAX_AIM_RAD = 0.5
"""Greatest angle at which an offset from the line is driven off, rad."""

SLOW_GAIN = 2.0
"""Near its end a motion slows down as distance times this, 1/s, so that it does not overshoot."""

MAX_DELAY_S = 1.0
"""Older commands are forgotten, s."""


class Limits(NamedTuple):
    """What the base is never driven beyond.

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
    """A command: straight ahead, m/s, and counter-clockwise, rad/s."""

    ahead: float = 0.0
    yaw_rate: float = 0.0


STOP = Speeds()


def braked(distance: float, top: float, acceleration: float) -> float:
    """Return the speed from which the base still stops within a distance; both have its sign."""
    way = abs(distance)
    speed = min(top, math.sqrt(2.0 * acceleration * way), SLOW_GAIN * way)
    return math.copysign(speed, distance)


def rotate_to(yaw_error: float, limits: Limits) -> Speeds:
    """Return the speeds that turn the base in place by an angle, rad."""
    return Speeds(0.0, braked(yaw_error, limits.yaw_rate, limits.yaw_acceleration))


def along_line(pose: Float64, goal: Float64, limits: Limits, speed: float) -> Speeds:
    """Return the speeds that drive the base along the x axis of a goal pose, up to it.

    Parameters
    ----------
    pose, goal
        float64 (3,), planar poses of the base now and at the end.
    limits
        Of the base.
    speed
        Greatest speed on this way, m/s.
    """
    x, y, yaw = between2(goal, pose).tolist()
    ahead = braked(-x, min(speed, limits.speed), limits.acceleration)
    direction = math.copysign(1.0, ahead)
    aim = -direction * math.copysign(min(abs(OFFSET_GAIN * y), MAX_AIM_RAD), y)
    # An offset is driven off by driving: at the end the heading alone counts.
    aim *= min(abs(ahead) / limits.speed * 4.0, 1.0)
    yaw_rate = HEADING_GAIN * float(wrap_angle(aim - yaw))
    return Speeds(ahead, max(-limits.yaw_rate, min(yaw_rate, limits.yaw_rate)))


class CommandHistory:
    """The commands that were sent: they tell where the base will be when the next one acts.

    Parameters
    ----------
    limits
        Of the base.
    latency_s
        Between a command and the motion that it makes, s.
    """

    def __init__(self, limits: Limits, latency_s: float):
        self._limits, self._latency_s = limits, latency_s
        self._sent: deque[tuple[float, Speeds]] = deque()

    @property
    def newest(self) -> Speeds:
        """The last command."""
        return self._sent[-1][1] if self._sent else STOP

    def ahead_of(self, pose: Float64, stamp_s: float, now_s: float) -> Float64:
        """Return where the base will be when a command of now acts.

        Parameters
        ----------
        pose
            float64 (3,), of the base at `stamp_s`.
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
        """Return the next command: as wanted, within the limits, and note it.

        Parameters
        ----------
        wanted
            Speeds; those of `STOP` are approached at full deceleration.
        now_s, period_s
            Time of the command, and until the next, s.
        """
        last, limits = self.newest, self._limits
        # Brakes may be harder than starts: a command to stop is obeyed within twice the limit.
        ahead = _stepped(last.ahead, wanted.ahead, limits.acceleration * period_s)
        yaw_rate = _stepped(last.yaw_rate, wanted.yaw_rate, limits.yaw_acceleration * period_s)
        return self._note(Speeds(ahead, yaw_rate), now_s)

    def stop(self, now_s: float) -> Speeds:
        """Return the command to stand, whatever the last one, and note it."""
        return self._note(STOP, now_s)

    def _note(self, speeds: Speeds, now_s: float) -> Speeds:
        limits = self._limits
        sent = Speeds(
            max(-limits.speed, min(speeds.ahead, limits.speed)),
            max(-limits.yaw_rate, min(speeds.yaw_rate, limits.yaw_rate)),
        )
        self._sent.append((now_s, sent))
        while len(self._sent) > 1 and self._sent[1][0] < now_s - MAX_DELAY_S - self._latency_s:
            self._sent.popleft()
        return sent


def _stepped(last: float, wanted: float, step: float) -> float:
    """Return a speed one step nearer to the wanted one; slowing down takes double steps."""
    is_slower = abs(wanted) < abs(last) and wanted * last >= 0.0
    step = 2.0 * step if is_slower else step
    return last + max(-step, min(wanted - last, step))


def _arc(speeds: Speeds, duration_s: float) -> Float64:
    """Return the planar motion (3,) at constant speeds."""
    angle = speeds.yaw_rate * duration_s
    way = speeds.ahead * duration_s
    # sin(a) / a and (1 - cos(a)) / a, also at 0.
    x = way * float(np.sinc(angle / np.pi))
    y = way * 0.5 * angle * float(np.sinc(0.5 * angle / np.pi)) ** 2
    return np.array([x, y, angle])
