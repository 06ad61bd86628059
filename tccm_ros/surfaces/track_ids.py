"""Track ids: a surface keeps its id while newer views replace older ones, and where it is carried.

A patch is numbered over all views in stamp order. The id of a surface is the number of its oldest
patch; the patch of a newer view that replaced that patch inherits the number. So ids follow from
the views alone, not from the order in which they arrived or from how often the map was built. A
surface that is recognised elsewhere (`recognition`) adopts the numbers that it had where it stood.

The merged ids of a surface are the numbers that its other patches have or inherited. They contain
the id of each surface of an earlier solution that is part of this one, whatever poses that solution
had. A surface that is split off is not among them any more.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.surfaces.carving import Survivors
from tccm_ros.surfaces.displacement import Footprint, footprint_in_map, is_displaced
from tccm_ros.surfaces.merging import Members
from tccm_ros.surfaces.views import View, first_numbers

CUT = 0.1
"""A patch that lost more than this fraction of its points may show where its surface was before.
Chosen: edges that are looked through in part are less."""


class SightKey(NamedTuple):
    """When something was seen, in the order of views; stamps may repeat over sessions."""

    session: int
    stamp_ns: int


class TrackIds:
    """Ids and dates of surfaces, from the numbers that patches have and inherited.

    Parameters
    ----------
    views
        In stamp order.
    T_map_view
        float64 (V, 4, 4), their poses.
    left
        Of `carve`, for these views: which patch replaced which.
    """

    def __init__(self, views: list[View], T_map_view: Float64, left: Survivors):
        self._views, self._T_map_view = views, T_map_view
        self._ids: dict[int, set[int]] = {}
        self._first_seen: dict[int, SightKey] = {}
        self._last_seen: dict[int, SightKey] = {}
        self._placed: dict[int, SightKey] = {}
        self._cut: dict[int, Footprint] = {}
        first = first_numbers(views)
        for start, view in zip(first, views):
            for p, patch in enumerate(view.patches):
                number, seen, placed = patch.number, patch.first_seen_ns, patch.placed_ns
                own = SightKey(view.session, view.stamp_ns)
                self._ids[start + p] = {start + (p if number is None else number)}
                self._first_seen[start + p] = own if seen is None else own._replace(stamp_ns=seen)
                self._placed[start + p] = own if placed is None else own._replace(stamp_ns=placed)
                self._last_seen[start + p] = own
        for v, view in enumerate(views):
            for p in range(len(view.patches)):
                kept = left.keep[v][p]
                if (v, p) in left.replaced_by and not kept.any():
                    w, q = left.replaced_by[v, p]
                    self._inherit((v, p), (w, q), first)
                elif kept.any() and not kept.all() and np.mean(kept) < 1.0 - CUT:
                    self._cut[first[v] + p] = self._footprint(v, p)

    def _inherit(self, old: tuple[int, int], new: tuple[int, int], first: list[int]) -> None:
        older, newer = first[old[0]] + old[1], first[new[0]] + new[1]
        self._ids[newer] |= self._ids[older]
        self._first_seen[newer] = min(self._first_seen[newer], self._first_seen[older])
        if not is_displaced(self._footprint(*old), self._footprint(*new)):
            self._placed[newer] = min(self._placed[newer], self._placed[older])

    def _footprint(self, v: int, p: int) -> Footprint:
        patch = self._views[v].patches[p]
        return footprint_in_map(patch.outline, patch.mean, patch.spacing, self._T_map_view[v])

    def adopt(self, members: Members, older: Members) -> None:
        """Give a surface the ids and the first sight of one that it is, and that stood elsewhere.

        Parameters
        ----------
        members
            The surface.
        older
            The patches that showed it where it stood.
        """
        first = members[0].number
        for member in older:
            self._ids[first] |= self._ids[member.number]
            self._first_seen[first] = min(self._first_seen[first], self._first_seen[member.number])

    def all_ids(self, members: Members) -> list[int]:
        """Return the id of a surface and those of the surfaces merged into it, ascending."""
        return sorted(set().union(*(self._ids[member.number] for member in members)))

    def track_id(self, members: Members) -> int:
        """Return the id of a surface."""
        return self.all_ids(members)[0]

    def merged_ids(self, members: Members) -> tuple[int, ...]:
        """Return the ids of the surfaces that are merged into this one."""
        return tuple(self.all_ids(members)[1:])

    def first_seen(self, members: Members) -> SightKey:
        """Return when a view saw the surface first."""
        return min(self._first_seen[member.number] for member in members)

    def last_seen(self, members: Members) -> SightKey:
        """Return when a view saw the surface last."""
        return max(self._last_seen[member.number] for member in members)

    def placed(self, members: Members, now: Footprint) -> SightKey:
        """Return when a view first showed the surface where it is now.

        Parameters
        ----------
        members, now
            The surface and its outline. A patch of which a part was looked through may show it
            where it was before.
        """
        stamps = [
            self._placed[member.number]
            for member in members
            if member.number not in self._cut or not is_displaced(self._cut[member.number], now)
        ]
        return min(stamps, default=self.last_seen(members))
