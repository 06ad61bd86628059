"""Track ids: a surface keeps its id while newer views replace older ones.

A patch is numbered over all views in stamp order. The id of a surface is the number of its oldest
patch; the patch of a newer view that replaced that patch inherits the number. So ids follow from
the views alone, not from the order in which they arrived or from how often the map was built.

The merged ids of a surface are the numbers that its other patches have or inherited. They contain
the id of each surface of an earlier solution that is part of this one, whatever poses that solution
had. A surface that is split off is not among them any more.
"""

from __future__ import annotations

from tccm_ros.surfaces.carving import Survivors
from tccm_ros.surfaces.merging import Members
from tccm_ros.surfaces.views import View, first_numbers


class TrackIds:
    """Ids and dates of surfaces, from the numbers that patches have and inherited.

    Parameters
    ----------
    views
        In stamp order.
    left
        Of `carve`, for these views: which patch replaced which.
    """

    def __init__(self, views: list[View], left: Survivors):
        self._ids: dict[int, set[int]] = {}
        self._first_seen: dict[int, int] = {}
        self._last_seen: dict[int, int] = {}
        first = first_numbers(views)
        for start, view in zip(first, views):
            for p, patch in enumerate(view.patches):
                number, seen = patch.number, patch.first_seen_ns
                self._ids[start + p] = {start + (p if number is None else number)}
                self._first_seen[start + p] = view.stamp_ns if seen is None else seen
                self._last_seen[start + p] = view.stamp_ns
        for v, view in enumerate(views):
            for p in range(len(view.patches)):
                if (v, p) in left.replaced_by and not left.keep[v][p].any():
                    w, q = left.replaced_by[v, p]
                    self._inherit(first[v] + p, first[w] + q)

    def _inherit(self, older: int, newer: int) -> None:
        self._ids[newer] |= self._ids[older]
        self._first_seen[newer] = min(self._first_seen[newer], self._first_seen[older])

    def _sorted_ids(self, members: Members) -> list[int]:
        return sorted(set().union(*(self._ids[member.number] for member in members)))

    def track_id(self, members: Members) -> int:
        """Return the id of a surface."""
        return self._sorted_ids(members)[0]

    def merged_ids(self, members: Members) -> tuple[int, ...]:
        """Return the ids of the surfaces that are merged into this one."""
        return tuple(self._sorted_ids(members)[1:])

    def first_seen_ns(self, members: Members) -> int:
        """Return the stamp of the first view that saw the surface."""
        return min(self._first_seen[member.number] for member in members)

    def last_seen_ns(self, members: Members) -> int:
        """Return the stamp of the last view that saw the surface."""
        return max(self._last_seen[member.number] for member in members)
