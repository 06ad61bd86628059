"""Who is who: identities that stay with a surface while views replace each other.

A patch is numbered over all views in stamp order. A surface is called by its oldest patch; where
a newer view of the same place replaced that patch, its heir carries the name on. Names follow from
the views alone, not from the order in which they arrived or how often the map was built.
"""

from __future__ import annotations

from tccm_ros.surfaces.carving import Survivors
from tccm_ros.surfaces.drafts import Group
from tccm_ros.surfaces.views import View, first_numbers

__all__ = ["Lineage"]


class Lineage:
    """The patches of all views with those that they replaced.

    Parameters
    ----------
    views
        In stamp order.
    left
        Whose heirs say which patch replaced which.
    """

    def __init__(self, views: list[View], left: Survivors):
        self._oldest: dict[int, int] = {}
        self._first_seen: dict[int, int] = {}
        self._last_seen: dict[int, int] = {}
        first = first_numbers(views)
        for start, view in zip(first, views):
            for p, patch in enumerate(view.patches):
                number, seen = patch.number, patch.first_seen_ns
                self._oldest[start + p] = start + (p if number is None else number)
                self._first_seen[start + p] = view.stamp_ns if seen is None else seen
                self._last_seen[start + p] = view.stamp_ns
        for v, view in enumerate(views):
            for p in range(len(view.patches)):
                if (v, p) in left.heirs and not left.keep[v][p].any():
                    w, q = left.heirs[v, p]
                    self._inherit(first[v] + p, first[w] + q)

    def _inherit(self, older: int, heir: int) -> None:
        self._oldest[heir] = min(self._oldest[heir], self._oldest[older])
        self._first_seen[heir] = min(self._first_seen[heir], self._first_seen[older])

    def name(self, group: Group) -> int:
        """Return the id of a surface."""
        return min(self._oldest[member.number] for member in group.members)

    def took(self, group: Group) -> tuple[int, ...]:
        """Return the ids of the surfaces that merged into this one."""
        names = {self._oldest[number] for number in group.founders}
        return tuple(sorted(names - {self.name(group)}))

    def first_seen_ns(self, group: Group) -> int:
        """Return the stamp of the first view that saw the surface."""
        return min(self._first_seen[member.number] for member in group.members)

    def last_seen_ns(self, group: Group) -> int:
        """Return the stamp of the last view that saw the surface."""
        return max(self._last_seen[member.number] for member in group.members)
