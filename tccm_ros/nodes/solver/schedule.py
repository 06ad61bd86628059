"""Schedule of map solutions.

A solution is due after a new view, detection or some keyframes, and a final one once input stops.
Solutions are spaced so that solving takes a bounded fraction of the time, and none is made between
the messages of one view (`ViewMessages`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import get_args

from tccm_ros.records import Event, ObjectBoxes, Odometry, SurfaceCloud, ViewIntervals
from tccm_ros.sensors.detections import PosedDetections

PERIOD_S = 2.0
"""Minimum time between two solutions, s. Chosen."""

FRACTION = 0.3
"""Maximum fraction of the time for solving: long solutions are less frequent. Chosen."""

KEYFRAMES = 5
"""Number of new keyframes after which the map is solved without a new view. Chosen."""

QUIET_S = 2.0
"""Time without a record after which a final solution is due, s. Chosen."""

ViewMessage = SurfaceCloud | ViewIntervals | ObjectBoxes
"""A message of a view: one of each is published together."""

MESSAGES = len(get_args(ViewMessage))
"""Number of messages of a view."""

PATIENCE_S = 0.5
"""Maximum time to wait for the missing messages, s. Chosen: they are published together, and a
publisher of only some of them delays a solution by no more than this."""


class ViewMessages:
    """Tracks which messages of the newest view have arrived.

    A tilt cycle arrives as three messages: points, free intervals and object boxes. A map solved
    between them contains the points of the cycle but not its free space: a table that was moved
    would appear at both places, as one.
    """

    def __init__(self) -> None:
        self._stamps_ns: dict[type, int] = {}
        self._until_s = 0.0

    def note(self, message: ViewMessage, now_s: float) -> None:
        """Note a message of a view at a time of a monotonic clock, s."""
        self._stamps_ns[type(message)] = message.stamp_ns
        is_whole = len(self._stamps_ns) == MESSAGES and len(set(self._stamps_ns.values())) == 1
        self._until_s = 0.0 if is_whole else now_s + PATIENCE_S

    def are_coming(self, now_s: float) -> bool:
        """Return whether to wait for further messages of a view."""
        return now_s < self._until_s


class SolveSchedule:
    """Decides when to solve, on a monotonic clock.

    Parameters
    ----------
    now_s
        Time at the start, s.
    """

    def __init__(self, now_s: float):
        self._last_s = now_s
        self._next_s = 0.0
        self._new: Counter[str] = Counter()
        self._view_messages = ViewMessages()

    def note(self, event: Event | ViewMessage | PosedDetections, now_s: float) -> None:
        """Note an event that the next solution will contain."""
        self._last_s = now_s
        if type(event) is not Odometry:
            self._new["records"] += 1
        if isinstance(event, ViewMessage):
            self._new["view parts"] += 1
            self._view_messages.note(event, now_s)
        if isinstance(event, PosedDetections):
            self._new["detections"] += 1

    def note_mapped(self, before: Mapping[str, int], after: Mapping[str, int]) -> None:
        """Note the clouds and keyframes that one event has added, from counts before and after."""
        for counted in ("clouds", "keyframes"):
            self._new[counted] += after.get(counted, 0) - before.get(counted, 0)

    def request(self) -> None:
        """Request a solution as soon as the period allows."""
        self._new["keyframes"] += KEYFRAMES

    def note_asked(self, now_s: float) -> None:
        """Note that a solution was requested from the solver."""
        self._new.clear()
        self._next_s = now_s + PERIOD_S

    def note_solved(self, duration_s: float, now_s: float) -> None:
        """Note the duration of a finished solution, s."""
        self._next_s = now_s + max(PERIOD_S - duration_s, duration_s * (1.0 / FRACTION - 1.0))

    def forget(self) -> None:
        """Discard the noted events, at the start of another map."""
        self._new.clear()

    def is_due(self, now_s: float) -> bool:
        """Return whether a solution is due now."""
        has_seen = any(self._new[what] for what in ("clouds", "view parts", "detections"))
        return (has_seen or self._new["keyframes"] >= KEYFRAMES) and self._may_solve(now_s)

    def is_final_due(self, now_s: float, *, is_batch: bool) -> bool:
        """Return whether input has stopped and a final solution is due now.

        Parameters
        ----------
        now_s
            Time, s.
        is_batch
            Whether the newest solution is final already.
        """
        has_more = bool(self._new["records"]) or not is_batch
        return has_more and now_s - self._last_s > QUIET_S and self._may_solve(now_s)

    def _may_solve(self, now_s: float) -> bool:
        return now_s >= self._next_s and not self._view_messages.are_coming(now_s)
