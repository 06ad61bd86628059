"""Who is who: identities that stay with a surface while views replace each other.

A patch is numbered over all views in stamp order. A surface is called by its oldest patch; where
a newer view of the same place replaced that patch, its heir carries the name on. Names follow from
the views alone, not from the order in which they arrived or how often the map was built.

What a surface took are the names that its other patches have, or had before they were replaced:
whatever poses an earlier solution had, a surface that has gone into this one is among them, and one
that parts from it is not any more. `changes` says so of two solutions.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from tccm_ros.records import Surface
from tccm_ros.surfaces.carving import Survivors
from tccm_ros.surfaces.merged_patches import Members
from tccm_ros.surfaces.views import View, first_numbers

__all__ = ["Change", "Lineage", "changes"]


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
        self._names: dict[int, set[int]] = {}
        self._first_seen: dict[int, int] = {}
        self._last_seen: dict[int, int] = {}
        first = first_numbers(views)
        for start, view in zip(first, views):
            for p, patch in enumerate(view.patches):
                number, seen = patch.number, patch.first_seen_ns
                self._names[start + p] = {start + (p if number is None else number)}
                self._first_seen[start + p] = view.stamp_ns if seen is None else seen
                self._last_seen[start + p] = view.stamp_ns
        for v, view in enumerate(views):
            for p in range(len(view.patches)):
                if (v, p) in left.heirs and not left.keep[v][p].any():
                    w, q = left.heirs[v, p]
                    self._inherit(first[v] + p, first[w] + q)

    def _inherit(self, older: int, heir: int) -> None:
        self._names[heir] |= self._names[older]
        self._first_seen[heir] = min(self._first_seen[heir], self._first_seen[older])

    def _names_of(self, members: Members) -> set[int]:
        return set().union(*(self._names[member.number] for member in members))

    def name(self, members: Members) -> int:
        """Return the id of a surface."""
        return min(self._names_of(members))

    def took(self, members: Members) -> tuple[int, ...]:
        """Return the other names of its patches: ids of surfaces that are part of this one now."""
        return tuple(sorted(self._names_of(members))[1:])

    def first_seen_ns(self, members: Members) -> int:
        """Return the stamp of the first view that saw the surface."""
        return min(self._first_seen[member.number] for member in members)

    def last_seen_ns(self, members: Members) -> int:
        """Return the stamp of the last view that saw the surface."""
        return max(self._last_seen[member.number] for member in members)


class Change(NamedTuple):
    """What became of a surface.

    Attributes
    ----------
    id
        Of the surface as it is now.
    took
        Ids of surfaces that there were, and that are part of it now.
    parted_from
        Id of the surface that it was part of; None where it was there, or is new.
    """

    id: int
    took: tuple[int, ...]
    parted_from: int | None

    def __str__(self) -> str:
        parts = [f"took {', '.join(map(str, self.took))}"] if self.took else []
        if self.parted_from is not None:
            parts.append(f"parted from {self.parted_from}")
        return f"surface {self.id} " + " and ".join(parts)


def changes(before: Sequence[Surface], after: Sequence[Surface]) -> list[Change]:
    """Return the merges and splits between two solutions of one map, by id.

    Views must not have come in between the older ones: numbers of patches are counted.
    """
    known = {surface.id for surface in before}
    owners = {name: surface.id for surface in before for name in surface.took}
    found = []
    for surface in after:
        took = tuple(name for name in surface.took if name in known)
        parted_from = None if surface.id in known else owners.get(surface.id)
        if took or parted_from is not None:
            found.append(Change(surface.id, took, parted_from))
    return found
