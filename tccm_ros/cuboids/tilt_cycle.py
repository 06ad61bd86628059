"""Tilt cycles from the samples of the tilt joint alone.

Time is cut into spans that follow each other without gaps: sweeps, which make cycles, and spans
that belong to no cycle because the joint rests, its samples are missing, or the sweep is too short.
A span's limits are final once it is given; beams belong to the span of their own time.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from tccm_ros.config import Config

__all__ = ["Span", "TiltCycles"]

START_OF_TIME = -(2**62)

NEAR = 0.25
"""As near to where the joint is furthest as this share of the dead band, it is there."""

SURE = 4.0
"""A joint at a known end has turned when it is back by this many times its usual unsteadiness."""

MEMORY = 0.1
"""Share of the newest sample in the mean unsteadiness: it is that of the last ten samples."""


@dataclass(frozen=True, slots=True)
class Span:
    """A closed span of time [start_ns, end_ns).

    Attributes
    ----------
    start_ns, end_ns
        Limits; the first span of all begins at the start of time.
    cycle
        Number of its cycle, from 0; None if it belongs to none.
    reason
        Why it belongs to none: ``before joint samples``, ``joint rests``, ``no joint samples`` or
        ``short sweep``; or why the cycle ended: ``turn``, ``rest``, ``gap``, ``time``, ``end``.
    """

    start_ns: int
    end_ns: int
    cycle: int | None
    reason: str


class TiltCycles:
    """Cuts time at the turning points of the tilt joint.

    Parameters
    ----------
    config
        Group `cycle`; a change counts from the next sample on.
    first_cycle
        Number of the first cycle.

    Attributes
    ----------
    closed
        Closed spans that nobody has taken yet, in order of time.
    """

    def __init__(self, config: Config, first_cycle: int = 0) -> None:
        self._limits = config.cycle
        self.closed: deque[Span] = deque()
        self._cycle = first_cycle
        self.clear()

    def clear(self) -> None:
        """Forget all samples, as after a jump of the clock; cycles are counted on."""
        self.closed.clear()
        self._state = "silent"
        self._start_ns = START_OF_TIME
        self._decided_ns = START_OF_TIME
        self._last: tuple[int, float] | None = None
        self._ends: dict[int, float] = {}
        self._step, self._unsteady = 0.0, self._limits.dead_band

    @property
    def decided_ns(self) -> int:
        """Whatever limits the open span gets, time before this belongs to it."""
        return self._decided_ns

    @property
    def sweeping(self) -> bool:
        """Whether the open span may become a cycle."""
        return self._state in ("starting", "moving")

    def add(self, stamp_ns: int, angle: float) -> None:
        """Take the next sample, in stamp order; angle in rad. Repeated stamps are ignored."""
        if self._last is not None:
            if stamp_ns <= self._last[0]:
                return
            if stamp_ns - self._last[0] > _ns(self._limits.max_gap):
                self._lose_joint()
        if self._state == "silent":
            known = self._last is not None
            self._close(stamp_ns, "no joint samples" if known else "before joint samples", False)
            self._begin("starting", stamp_ns, angle)
        elif self._state == "starting":
            self._while_starting(stamp_ns, angle)
        elif self._state == "moving":
            self._while_moving(stamp_ns, angle)
        else:
            self._while_resting(stamp_ns, angle)
        if self._last is not None:
            self._note_step(angle - self._last[1])
        self._last = (stamp_ns, angle)

    def _note_step(self, step: float) -> None:
        """Follow how unsteady the joint's steps are: jitter, but acceleration as well."""
        self._unsteady += MEMORY * (abs(step - self._step) - self._unsteady)
        self._step = step

    def advance(self, now_ns: int) -> None:
        """Close the open sweep if no sample can come any more that would go on with it."""
        if self._last is not None and now_ns - self._last[0] > _ns(self._limits.max_gap):
            self._lose_joint()

    def finish(self) -> None:
        """Close the open span: the input has ended."""
        if self._state != "silent" and self._last is not None:
            self._end_motion("end")

    def _lose_joint(self) -> None:
        if self._state != "silent":
            self._end_motion("gap")

    def _end_motion(self, reason: str) -> None:
        assert self._last is not None
        end_ns = self._last[0] + 1
        if self._state == "resting":
            self._close(end_ns, "joint rests", False)
        else:
            self._close(end_ns, reason, self._sweep >= self._limits.min_sweep)
        self._state = "silent"
        self._decided_ns = end_ns

    def _close(self, end_ns: int, reason: str, is_cycle: bool) -> None:
        """Close the open span and begin the next one where it ends."""
        if end_ns > self._start_ns:
            if is_cycle:
                self.closed.append(Span(self._start_ns, end_ns, self._cycle, reason))
                self._cycle += 1
            else:
                why = "short sweep" if self.sweeping else reason
                self.closed.append(Span(self._start_ns, end_ns, None, why))
        self._start_ns = self._decided_ns = end_ns

    def _begin(self, state: str, stamp_ns: int, angle: float) -> None:
        self._state = state
        self._direction = 0
        self._sweep = 0.0
        self._leg_start = self._extreme = angle
        self._extreme_ns = stamp_ns
        self._anchor_at(stamp_ns, angle)

    def _anchor_at(self, stamp_ns: int, angle: float) -> None:
        """Remember where the joint last moved on by more than the dead band."""
        self._anchor, self._anchor_ns = angle, stamp_ns
        self._since: deque[tuple[int, float]] = deque([(stamp_ns, angle)])

    def _while_starting(self, stamp_ns: int, angle: float) -> None:
        if abs(angle - self._anchor) > self._limits.dead_band:
            self._set_off(stamp_ns, angle)
        elif stamp_ns - self._anchor_ns > _ns(self._limits.rest_time):
            self._state = "resting"
            self._still_ns = self._decided_ns = stamp_ns

    def _set_off(self, stamp_ns: int, angle: float) -> None:
        self._state = "moving"
        self._direction = 1 if angle > self._anchor else -1
        self._leg_start = self._anchor
        self._extreme, self._extreme_ns = angle, stamp_ns
        self._anchor_at(stamp_ns, angle)
        self._sweep = abs(angle - self._leg_start)
        self._decided_ns = stamp_ns

    def _while_resting(self, stamp_ns: int, angle: float) -> None:
        away = abs(angle - self._anchor)
        if away > self._limits.dead_band:
            self._close(self._still_ns, "joint rests", False)
            self._sweep = 0.0
            self._set_off(stamp_ns, angle)
        elif away <= 0.5 * self._limits.dead_band:
            self._still_ns = self._decided_ns = stamp_ns

    def _while_moving(self, stamp_ns: int, angle: float) -> None:
        if self._direction * (angle - self._extreme) > 0.0:
            self._extreme, self._extreme_ns = angle, stamp_ns
            self._sweep = max(self._sweep, abs(angle - self._leg_start))
        if self._direction * (self._extreme - angle) > self._reversal():
            self._turn(stamp_ns, angle)
        elif abs(angle - self._anchor) > self._limits.dead_band:
            self._anchor_at(stamp_ns, angle)
        else:
            self._since.append((stamp_ns, angle))
        arrival_ns = self._arrival_ns()
        if stamp_ns - self._anchor_ns > _ns(self._limits.rest_time):
            self._rest(arrival_ns, stamp_ns, angle)
        elif stamp_ns - self._start_ns > _ns(self._limits.max_time):
            self._close(arrival_ns, "time", self._sweep >= self._limits.min_sweep)
            self._leg_start, self._sweep = self._extreme, 0.0
        else:
            self._decided_ns = max(self._decided_ns, arrival_ns)

    def _reversal(self) -> float:
        """Return how far back the joint must be to have turned.

        Where it turned the last time it is sure to turn again, and need not go all through the
        dead band. If it does go on, the cycle has ended that much too early and no other is made:
        the rest is too short for a sweep.
        """
        end, dead_band = self._ends.get(self._direction), self._limits.dead_band
        is_sweep = abs(self._extreme - self._leg_start) >= self._limits.min_sweep
        if end is None or not is_sweep or abs(self._extreme - end) > dead_band:
            return dead_band
        return min(max(NEAR * dead_band, SURE * self._unsteady), dead_band)

    def _arrival_ns(self) -> int:
        """When the joint came to where it now is furthest, within a quarter of the dead band."""
        near = self._extreme - self._direction * NEAR * self._limits.dead_band
        while len(self._since) > 1 and self._direction * (self._since[0][1] - near) < 0.0:
            self._since.popleft()
        return min(self._since[0][0], self._extreme_ns)

    def _turn(self, stamp_ns: int, angle: float) -> None:
        if abs(self._extreme - self._leg_start) >= self._limits.min_sweep:
            self._close(self._extreme_ns, "turn", True)
            self._ends[self._direction] = self._extreme
            self._sweep = 0.0
        self._direction = -self._direction
        self._leg_start = self._extreme
        self._extreme, self._extreme_ns = angle, stamp_ns
        self._sweep = max(self._sweep, abs(angle - self._leg_start))
        self._anchor_at(stamp_ns, angle)

    def _rest(self, arrival_ns: int, stamp_ns: int, angle: float) -> None:
        self._close(arrival_ns, "rest", self._sweep >= self._limits.min_sweep)
        self._state = "resting"
        self._anchor = angle
        self._still_ns = self._decided_ns = stamp_ns


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)
