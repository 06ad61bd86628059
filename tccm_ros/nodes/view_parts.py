"""Whether parts of a view are still on their way.

A tilt cycle arrives as three messages: points, free intervals and boxes of objects. A map that was
solved between them has what the cycle saw, but not yet what it looked through: a table that was
moved would stand at both places, as one.
"""

from __future__ import annotations

from tccm_ros.records import ObjectBoxes, SurfaceCloud, ViewIntervals

ViewPart = SurfaceCloud | ViewIntervals | ObjectBoxes

PARTS = 3

PATIENCE_S = 0.5
"""Longest time that the missing parts are waited for, s. Chosen: they are published together, and
a publisher that gives only some of them delays a solution by no more."""


class ViewParts:
    """Notes the parts of views as they come."""

    def __init__(self) -> None:
        self._stamps_ns: dict[type, int] = {}
        self._until_s = 0.0

    def note(self, part: ViewPart, now_s: float) -> None:
        """Note a part that came, at a time of a clock that never goes back, s."""
        self._stamps_ns[type(part)] = part.stamp_ns
        is_whole = len(self._stamps_ns) == PARTS and len(set(self._stamps_ns.values())) == 1
        self._until_s = 0.0 if is_whole else now_s + PATIENCE_S

    def are_coming(self, now_s: float) -> bool:
        """Return whether to wait for the rest of a view."""
        return now_s < self._until_s
