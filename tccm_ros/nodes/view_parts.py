"""Detection of views whose messages have not all arrived.

A tilt cycle arrives as three messages: points, free intervals and object boxes. A map solved
between them contains the points of the cycle but not its free space: a table that was moved would
appear at both places, as one.
"""

from __future__ import annotations

from tccm_ros.records import ObjectBoxes, SurfaceCloud, ViewIntervals

ViewPart = SurfaceCloud | ViewIntervals | ObjectBoxes

PARTS = 3

PATIENCE_S = 0.5
"""Maximum time to wait for the missing messages, s. Chosen: they are published together, and a
publisher of only some of them delays a solution by no more than this."""


class ViewParts:
    """Tracks which messages of the newest view have arrived."""

    def __init__(self) -> None:
        self._stamps_ns: dict[type, int] = {}
        self._until_s = 0.0

    def note(self, part: ViewPart, now_s: float) -> bool:
        """Note a message of a view at a time of a monotonic clock, s; return whether all came."""
        self._stamps_ns[type(part)] = part.stamp_ns
        is_whole = len(self._stamps_ns) == PARTS and len(set(self._stamps_ns.values())) == 1
        self._until_s = 0.0 if is_whole else now_s + PATIENCE_S
        return is_whole

    def are_coming(self, now_s: float) -> bool:
        """Return whether to wait for further messages of a view."""
        return now_s < self._until_s
