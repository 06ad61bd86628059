"""When the map is solved again.

A solution is due after a new view, detection or some keyframes, and a final one once input stops.
Solutions are spaced so that solving takes a bounded fraction of the time, and none is made between
the messages of one view (`ViewParts`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from tccm_ros.nodes.view_parts import ViewPart, ViewParts
from tccm_ros.records import Event, ObjectBoxes, Odometry, SurfaceCloud, ViewIntervals
from tccm_ros.sensors.detections import PosedDetections

PERIOD_S = 2.0
"""Shortest time between two solutions, s. Chosen."""

FRACTION = 0.3
"""Fraction of the time that solving may take: a long solution is made less often. Chosen."""

KEYFRAMES = 5
"""Without a new view the map is solved anew after so many keyframes. Chosen."""

QUIET_S = 2.0
"""After this time without a record, s, everything that has come is solved. Chosen."""


class SolveSchedule:
    """Decides when to solve, on a clock that never goes back.

    Parameters
    ----------
    now_s
        Time at the start, s.
    """

    def __init__(self, now_s: float):
        self._last_s = now_s
        self._next_s = 0.0
        self._new: Counter[str] = Counter()
        self._parts = ViewParts()

    def note(self, event: Event | ViewPart | PosedDetections, now_s: float) -> None:
        """Note an event that the next solution will contain."""
        self._last_s = now_s
        if type(event) is not Odometry:
            self._new["records"] += 1
        if isinstance(event, (SurfaceCloud, ViewIntervals, ObjectBoxes)):
            self._parts.note(event, now_s)
            self._new["view parts"] += 1
        elif isinstance(event, PosedDetections):
            self._new["detections"] += 1

    def note_mapped(self, before: Mapping[str, int], after: Mapping[str, int]) -> None:
        """Note the clouds and keyframes that tracking one event has added, from its counts."""
        for counted in ("clouds", "keyframes"):
            self._new[counted] += after.get(counted, 0) - before.get(counted, 0)

    def request(self) -> None:
        """Ask for a solution as soon as the period allows."""
        self._new["keyframes"] += KEYFRAMES

    def note_asked(self, now_s: float) -> None:
        """Note that a solution was asked for."""
        self._new.clear()
        self._next_s = now_s + PERIOD_S

    def note_solved(self, duration_s: float, now_s: float) -> None:
        """Note how long a solution took, s."""
        self._next_s = now_s + max(PERIOD_S - duration_s, duration_s * (1.0 / FRACTION - 1.0))

    def forget(self) -> None:
        """Begin another map."""
        self._new.clear()

    def is_due(self, now_s: float) -> bool:
        """Return whether something new is worth a solution now."""
        has_seen = any(self._new[what] for what in ("clouds", "view parts", "detections"))
        return (has_seen or self._new["keyframes"] >= KEYFRAMES) and self._may_solve(now_s)

    def is_final_due(self, now_s: float, *, is_batch: bool) -> bool:
        """Return whether input has stopped, and a final solution would change the map.

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
        return now_s >= self._next_s and not self._parts.are_coming(now_s)
