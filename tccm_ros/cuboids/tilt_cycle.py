"""Tilt cycles from the samples of the tilt joint alone.

Time is divided into contiguous spans. A span is a tilt cycle, in which the joint moves in one
direction, or no cycle: the joint rests, its samples are missing, or it moved by less than
`cycle.min_sweep`. The limits of a span are final once it is closed; a beam belongs to the span that
contains its time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, StrEnum, auto
from itertools import count
from typing import Any

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.records import START_OF_TIME

NEAR_END = 0.25
"""Fraction of the dead band within which the joint is at its extreme angle. Chosen: above the
jitter of encoders."""

SURE_REVERSAL = 4.0
"""A joint near a known end has reversed if it is back by this multiple of its mean jitter. Chosen:
jitter alone hardly ever causes so large a step."""

JITTER_WEIGHT = 0.1
"""Weight of the newest sample in the mean jitter. Chosen: a mean over some ten samples."""


class CycleEnd(StrEnum):
    """Reason for the end of a tilt cycle."""

    REVERSAL = "turn"
    REST = "rest"
    GAP = "gap"
    TIME = "time"
    MOTION = "motion"
    END = "end"


class NoCycle(StrEnum):
    """Reason why a span is no tilt cycle."""

    BEFORE_JOINT_SAMPLES = "before joint samples"
    NO_JOINT_SAMPLES = "no joint samples"
    JOINT_RESTS = "joint rests"
    SHORT_CYCLE = "short tilt cycle"


class _State(Enum):
    """State of the joint."""

    SILENT = auto()
    STARTING = auto()
    MOVING = auto()
    RESTING = auto()


@dataclass(frozen=True, slots=True)
class Span:
    """A closed span of time [start_ns, end_ns).

    Attributes
    ----------
    start_ns, end_ns
        Limits; the first span begins at the start of time.
    cycle
        Number of the cycle, from 0; None for no cycle.
    reason
        Reason for the end of the cycle, or for no cycle.
    """

    start_ns: int
    end_ns: int
    cycle: int | None
    reason: CycleEnd | NoCycle


class TiltCycles:
    """Divides time at the reversals of the tilt joint.

    Parameters
    ----------
    config
        Group `cycle`; a change takes effect with the next sample.
    numbers
        Iterator of cycle numbers; from 0 by default.

    Attributes
    ----------
    closed
        Closed spans in order of time; the reader removes them.
    decided_ns
        Time up to which the open span is certain, whatever its final limits.
    """

    def __init__(self, config: Config, numbers: Iterator[int] | None = None) -> None:
        self._limits = config.cycle
        self.closed: deque[Span] = deque()
        self._numbers = count() if numbers is None else numbers
        self.clear()

    def clear(self) -> None:
        """Clear all samples, after a jump of the clock; cycle numbers continue."""
        self.closed.clear()
        self._state = _State.SILENT
        self._start_ns = START_OF_TIME
        self.decided_ns = START_OF_TIME
        self._last: tuple[int, float] | None = None
        self._ends: dict[int, float] = {}
        self._step, self._jitter = 0.0, self._limits.dead_band

    @property
    def is_moving(self) -> bool:
        """Whether the open span may become a cycle."""
        return self._state in (_State.STARTING, _State.MOVING)

    def advance_to(self, start_ns: int, T_odom_base: Float64) -> None:
        """Do nothing: tilt cycles are closed by the joint, not by records."""

    def is_certain(self, record: Any) -> bool:
        """Return whether a record is certain to belong to the open span."""
        return bool(record.end_ns < self.decided_ns)

    def add(self, stamp_ns: int, angle: float) -> None:
        """Add the next sample, in stamp order; angle in rad. Repeated stamps are ignored."""
        if self._last is not None:
            if stamp_ns <= self._last[0]:
                return
            if stamp_ns - self._last[0] > _ns(self._limits.max_gap):
                self._lose_joint()
        if self._state == _State.SILENT:
            is_first = self._last is None
            why = NoCycle.BEFORE_JOINT_SAMPLES if is_first else NoCycle.NO_JOINT_SAMPLES
            self._close(stamp_ns, why)
            self._begin(_State.STARTING, stamp_ns, angle)
        elif self._state == _State.STARTING:
            self._while_starting(stamp_ns, angle)
        elif self._state == _State.MOVING:
            self._while_moving(stamp_ns, angle)
        else:
            self._while_resting(stamp_ns, angle)
        if self._last is not None:
            self._update_jitter(angle - self._last[1])
        self._last = (stamp_ns, angle)

    def _update_jitter(self, step: float) -> None:
        """Update the mean jitter: the mean change of the joint's steps, including acceleration."""
        self._jitter += JITTER_WEIGHT * (abs(step - self._step) - self._jitter)
        self._step = step

    def advance(self, now_ns: int) -> None:
        """Close the open span if no further sample can continue it."""
        if self._last is not None and now_ns - self._last[0] > _ns(self._limits.max_gap):
            self._lose_joint()

    def finish(self) -> None:
        """Close the open span at the end of the input."""
        if self._state != _State.SILENT and self._last is not None:
            self._end_motion(CycleEnd.END)

    def _lose_joint(self) -> None:
        if self._state != _State.SILENT:
            self._end_motion(CycleEnd.GAP)

    def _end_motion(self, reason: CycleEnd) -> None:
        assert self._last is not None
        end_ns = self._last[0] + 1
        if self._state == _State.RESTING:
            self._close(end_ns, NoCycle.JOINT_RESTS)
        else:
            self._close_cycle(end_ns, reason)
        self._state = _State.SILENT
        self.decided_ns = end_ns

    def _close_cycle(self, end_ns: int, reason: CycleEnd) -> None:
        """Close the open span; it is a tilt cycle if the joint has moved far enough."""
        is_cycle = self._travel >= self._limits.min_sweep
        self._close(end_ns, reason if is_cycle else NoCycle.SHORT_CYCLE)

    def _close(self, end_ns: int, reason: CycleEnd | NoCycle) -> None:
        """Close the open span and begin the next one at its end."""
        if end_ns > self._start_ns:
            cycle = next(self._numbers) if isinstance(reason, CycleEnd) else None
            self.closed.append(Span(self._start_ns, end_ns, cycle, reason))
        self._start_ns = self.decided_ns = end_ns

    def _begin(self, state: _State, stamp_ns: int, angle: float) -> None:
        self._state = state
        self._direction = 0
        self._travel = 0.0
        self._leg_start = self._extreme = angle
        self._extreme_ns = stamp_ns
        self._anchor_at(stamp_ns, angle)

    def _anchor_at(self, stamp_ns: int, angle: float) -> None:
        """Set the anchor, where the joint last moved by more than the dead band."""
        self._anchor, self._anchor_ns = angle, stamp_ns
        self._since: deque[tuple[int, float]] = deque([(stamp_ns, angle)])

    def _while_starting(self, stamp_ns: int, angle: float) -> None:
        if abs(angle - self._anchor) > self._limits.dead_band:
            self._set_off(stamp_ns, angle)
        elif stamp_ns - self._anchor_ns > _ns(self._limits.rest_time):
            self._state = _State.RESTING
            self._still_ns = self.decided_ns = stamp_ns

    def _set_off(self, stamp_ns: int, angle: float) -> None:
        self._state = _State.MOVING
        self._direction = 1 if angle > self._anchor else -1
        self._leg_start = self._anchor
        self._extreme, self._extreme_ns = angle, stamp_ns
        self._anchor_at(stamp_ns, angle)
        self._travel = abs(angle - self._leg_start)
        self.decided_ns = stamp_ns

    def _while_resting(self, stamp_ns: int, angle: float) -> None:
        away = abs(angle - self._anchor)
        if away > self._limits.dead_band:
            self._close(self._still_ns, NoCycle.JOINT_RESTS)
            self._travel = 0.0
            self._set_off(stamp_ns, angle)
        elif away <= 0.5 * self._limits.dead_band:
            self._still_ns = self.decided_ns = stamp_ns

    def _while_moving(self, stamp_ns: int, angle: float) -> None:
        if self._direction * (angle - self._extreme) > 0.0:
            self._extreme, self._extreme_ns = angle, stamp_ns
            self._travel = max(self._travel, abs(angle - self._leg_start))
        if self._direction * (self._extreme - angle) > self._reversal_angle():
            self._reverse(stamp_ns, angle)
        elif abs(angle - self._anchor) > self._limits.dead_band:
            self._anchor_at(stamp_ns, angle)
        else:
            self._since.append((stamp_ns, angle))
        arrival_ns = self._arrival_ns()
        if stamp_ns - self._anchor_ns > _ns(self._limits.rest_time):
            self._rest(arrival_ns, stamp_ns, angle)
        elif stamp_ns - self._start_ns > _ns(self._limits.max_time):
            self._close_cycle(arrival_ns, CycleEnd.TIME)
            self._leg_start, self._travel = self._extreme, 0.0
        else:
            self.decided_ns = max(self.decided_ns, arrival_ns)

    def _reversal_angle(self) -> float:
        """Return the angle, rad, by which the joint must move back to have reversed.

        Near its last reversal the joint is expected to reverse again, and need not cross the whole
        dead band. If it continues instead, the cycle ends slightly early, and the remainder is too
        short to become a second cycle.
        """
        end, dead_band = self._ends.get(self._direction), self._limits.dead_band
        is_far_enough = abs(self._extreme - self._leg_start) >= self._limits.min_sweep
        if end is None or not is_far_enough or abs(self._extreme - end) > dead_band:
            return dead_band
        return min(max(NEAR_END * dead_band, SURE_REVERSAL * self._jitter), dead_band)

    def _arrival_ns(self) -> int:
        """Return when the joint came within `NEAR_END` of its extreme angle."""
        near = self._extreme - self._direction * NEAR_END * self._limits.dead_band
        while len(self._since) > 1 and self._direction * (self._since[0][1] - near) < 0.0:
            self._since.popleft()
        return min(self._since[0][0], self._extreme_ns)

    def _reverse(self, stamp_ns: int, angle: float) -> None:
        if abs(self._extreme - self._leg_start) >= self._limits.min_sweep:
            self._close(self._extreme_ns, CycleEnd.REVERSAL)
            self._ends[self._direction] = self._extreme
            self._travel = 0.0
        self._direction = -self._direction
        self._leg_start = self._extreme
        self._extreme, self._extreme_ns = angle, stamp_ns
        self._travel = max(self._travel, abs(angle - self._leg_start))
        self._anchor_at(stamp_ns, angle)

    def _rest(self, arrival_ns: int, stamp_ns: int, angle: float) -> None:
        self._close_cycle(arrival_ns, CycleEnd.REST)
        self._state = _State.RESTING
        self._anchor = angle
        self._still_ns = self.decided_ns = stamp_ns


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)
