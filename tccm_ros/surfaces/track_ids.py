"""Track ids: a surface keeps its id while newer views replace older ones.

A patch is numbered over all views in stamp order. The id of a surface is the number of its oldest
patch; the patch of a newer view that replaced that patch inherits the number. So ids follow from
the views alone, not from the order in which they arrived or from how often the map was built.

The merged ids of a surface are the numbers that its other patches have or inherited. They contain
the id of each surface of an earlier solution that is part of this one, whatever poses that solution
had. A surface that is split off is not among them any more. `changes` lists merges and splits
between two solutions.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from tccm_ros.records import Surface
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


class SurfaceChange(NamedTuple):
    """A merge or a split of a surface between two solutions.

    Attributes
    ----------
    id
        Id of the surface in the later solution.
    merged_ids
        Ids of surfaces of the earlier solution that are merged into it.
    split_from
        Id of the surface of the earlier solution that it was part of; None where there is none.
    """

    id: int
    merged_ids: tuple[int, ...]
    split_from: int | None

    def __str__(self) -> str:
        parts = [f"merged {', '.join(map(str, self.merged_ids))}"] if self.merged_ids else []
        if self.split_from is not None:
            parts.append(f"was split from {self.split_from}")
        return f"surface {self.id} " + " and ".join(parts)


def changes(before: Sequence[Surface], after: Sequence[Surface]) -> list[SurfaceChange]:
    """Return the merges and splits between two solutions of one map, by id.

    Between the two, no view may have been added before an older one: that would renumber patches.
    """
    known = {surface.id for surface in before}
    owners = {merged: surface.id for surface in before for merged in surface.merged_ids}
    found = []
    for surface in after:
        merged_ids = tuple(merged for merged in surface.merged_ids if merged in known)
        split_from = None if surface.id in known else owners.get(surface.id)
        if merged_ids or split_from is not None:
            found.append(SurfaceChange(surface.id, merged_ids, split_from))
    return found
