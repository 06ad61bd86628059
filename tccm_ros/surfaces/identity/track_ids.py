"""Track ids: a surface keeps its id when newer views replace older ones, and when it is moved.

Patches are numbered over all views in stamp order. The id of a surface is the number of its oldest
patch; the patch of a newer view that replaces it inherits the number. So ids depend only on the
views, not on their order of arrival or on the number of solutions. A surface that is recognised at
another place (`recognition`) adopts the numbers of its old place.

The merged ids of a surface are the numbers that its other patches have or inherited. They contain
the id of each surface of an earlier solution that is part of this one, for any poses of that
solution. A surface that was split off is no longer among them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np
import shapely

from tccm_ros.arrays import Float64
from tccm_ros.surfaces.displacement import HorizontalOutline, footprint_in_map, is_displaced
from tccm_ros.surfaces.merging.carving import Survivors
from tccm_ros.surfaces.merging.merging import Members
from tccm_ros.surfaces.merging.occluded_areas import EDGE_FRACTION
from tccm_ros.surfaces.polygons import GRID
from tccm_ros.surfaces.views.views import View, first_numbers


class ViewKey(NamedTuple):
    """Session and stamp of a view, in the order of views; stamps may repeat over sessions."""

    session: int
    stamp_ns: int


class TrackIds:
    """Ids and stamps of surfaces, from the numbers that their patches have and inherited.

    Parameters
    ----------
    views
        Views in stamp order.
    T_map_view
        float64 (V, 4, 4), their poses.
    survivors
        Result of `carve` for these views, with the replacements of patches.
    """

    def __init__(self, views: list[View], T_map_view: Float64, survivors: Survivors):
        self._views, self._T_map_view = views, T_map_view
        self._ids: dict[int, set[int]] = {}
        self._first_seen: dict[int, ViewKey] = {}
        self._last_seen: dict[int, ViewKey] = {}
        self._indices: dict[int, set[tuple[int, int]]] = {}
        self._may_be_elsewhere: set[tuple[int, int]] = set()
        self._known: dict[Members, list[list[tuple[int, int]]]] = {}
        first = first_numbers(views)
        for v, (start, view) in enumerate(zip(first, views)):
            for p, patch in enumerate(view.patches):
                number, seen = patch.number, patch.first_seen_ns
                own = ViewKey(view.session, view.stamp_ns)
                self._ids[start + p] = {start + (p if number is None else number)}
                self._first_seen[start + p] = own if seen is None else own._replace(stamp_ns=seen)
                self._last_seen[start + p] = own
                self._indices[start + p] = {(v, p)}
        for v, view in enumerate(views):
            for p in range(len(view.patches)):
                kept = survivors.keep[v][p]
                if (v, p) in survivors.replaced_by and not kept.any():
                    w, q = survivors.replaced_by[v, p]
                    self._inherit(first[v] + p, first[w] + q)
                if np.mean(kept) < 1.0 - EDGE_FRACTION:
                    self._may_be_elsewhere.add((v, p))

    def _inherit(self, older: int, newer: int) -> None:
        self._ids[newer] |= self._ids[older]
        self._first_seen[newer] = min(self._first_seen[newer], self._first_seen[older])
        self._indices[newer] |= self._indices[older]

    def adopt(self, members: Members, older: Members) -> None:
        """Add the ids and the first view of a surface at its old place to those at its new place.

        Parameters
        ----------
        members
            Patches of the surface at its new place.
        older
            Patches of the surface at its old place.
        """
        first = members[0].number
        for member in older:
            self._ids[first] |= self._ids[member.number]
            self._first_seen[first] = min(self._first_seen[first], self._first_seen[member.number])

    def earlier_indices(self, index: tuple[int, int], number: int) -> list[tuple[int, int]]:
        """Return the patches (view, patch) that a patch replaced at the same place.

        Parameters
        ----------
        index, number
            The patch as (view, patch), and its number.
        """
        now = self._footprint([index])
        earlier = sorted(self._indices[number] - {index})
        return [other for other in earlier if not is_displaced(self._footprint([other]), now)]

    def all_ids(self, members: Members) -> list[int]:
        """Return the id of a surface and those of the surfaces merged into it, ascending."""
        return sorted(set().union(*(self._ids[member.number] for member in members)))

    def track_id(self, members: Members) -> int:
        """Return the id of a surface."""
        return self.all_ids(members)[0]

    def merged_ids(self, members: Members) -> tuple[int, ...]:
        """Return the ids of the surfaces merged into this one."""
        return tuple(self.all_ids(members)[1:])

    def first_seen(self, members: Members) -> ViewKey:
        """Return the key of the first view that saw the surface."""
        return min(self._first_seen[member.number] for member in members)

    def last_seen(self, members: Members) -> ViewKey:
        """Return the key of the last view that saw the surface."""
        return max(self._last_seen[member.number] for member in members)

    def placed(self, members: Members, now: HorizontalOutline) -> ViewKey:
        """Return the key of the first view that showed the surface at its current place.

        Parameters
        ----------
        members, now
            The surface and its footprint.
        """
        stamps = [self._own_placed(group) for group in self._in_place(members, now)]
        return min([self.last_seen(members), *stamps])

    def outline_in_place(self, members: Members, now: HorizontalOutline) -> HorizontalOutline:
        """Return the union of the outlines of the surface in all views of its current place.

        The patch that replaced older ones may have few scan lines.

        Parameters
        ----------
        members, now
            The surface and its footprint.
        """
        seen = [self._footprint(group).outline for group in self._in_place(members, now)]
        return now._replace(outline=shapely.union_all([now.outline, *seen], grid_size=GRID))

    def _in_place(self, members: Members, now: HorizontalOutline) -> list[list[tuple[int, int]]]:
        """Return the result of `_indices_in_place`, cached by surface."""
        if members not in self._known:
            self._known[members] = list(self._indices_in_place(members, now))
        return self._known[members]

    def _indices_in_place(
        self, members: Members, now: HorizontalOutline
    ) -> Iterator[list[tuple[int, int]]]:
        """Yield the patches of each view of the surface at its current place, newest view first.

        These are all views after the last one that showed it at another place. The patches of a
        view are tested together, as one strip of a moved table may still be within its outline.
        """
        indices = sorted(set().union(*(self._indices[member.number] for member in members)))
        for _, group in reversed([(v, list(g)) for v, g in groupby(indices, lambda s: s[0])]):
            if self._may_be_elsewhere.intersection(group) and is_displaced(
                self._footprint(group), now
            ):
                return
            yield group

    def _own_placed(self, indices: Sequence[tuple[int, int]]) -> ViewKey:
        """Return the key since which patches of a view are at their place.

        Removed views that the view replaced are included.
        """
        view = self._views[indices[0][0]]
        placed = [view.patches[p].placed_ns for _, p in indices]
        stamps = [view.stamp_ns if stamp_ns is None else stamp_ns for stamp_ns in placed]
        return ViewKey(view.session, max(stamps))

    def _footprint(self, indices: Sequence[tuple[int, int]]) -> HorizontalOutline:
        """Return the common footprint of patches of one view."""
        patches = [self._views[v].patches[p] for v, p in indices]
        T = self._T_map_view[indices[0][0]]
        parts = [footprint_in_map(p.outline, p.mean, p.spacing, T) for p in patches]
        outline = shapely.union_all([part.outline for part in parts])
        z = np.average([part.z for part in parts], weights=[p.count for p in patches])
        blur = max((part.blur for part in parts), key=lambda b: float(np.hypot(*b)))
        return HorizontalOutline(outline, float(z), blur)
