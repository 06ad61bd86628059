"""Recognition of surfaces that were moved, by height, size and shape.

A surface has vacated a place if views measured it there and later views looked through all of it. A
surface with the same height and size that was first seen after the old one was last seen is the
same surface and adopts its id. Of several candidates, the one that was seen first is taken, then
the nearest. A surface that was slightly lifted or lowered at its place is the same surface as well:
its old height is too close to the new one to be looked through, or is occluded by it. The result
depends only on the views and their poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.surfaces.displacement import (
    BORDER,
    MIN_LIFT,
    HorizontalOutline,
    is_in_place,
    is_of_one_size,
    line_of_sight,
)
from tccm_ros.surfaces.identity.track_ids import TrackIds, ViewKey
from tccm_ros.surfaces.merging.carving import MIN_RECOGNISED_AREA, Survivors, may_be_recognised
from tccm_ros.surfaces.merging.merged_surface import MergedSurface, fit_surface
from tccm_ros.surfaces.merging.merging import Members, NumberedPatch, merge_coplanar
from tccm_ros.surfaces.merging.occluded_areas import EDGE_FRACTION
from tccm_ros.surfaces.views.stray_points import MAX_FRACTION
from tccm_ros.surfaces.views.views import View, first_numbers

MAX_LIFT = 0.15
"""Max change of height of a surface at its place, m. Chosen: boards of shelves are at least 0.2 m
from each other."""


class PastPose(NamedTuple):
    """The previous pose of a surface.

    Attributes
    ----------
    surface
        The surface at that pose.
    last_seen_ns
        Stamp of the last view that showed it there.
    """

    surface: MergedSurface
    last_seen_ns: int


class _PlacedSurface(NamedTuple):
    """A surface at one place, from its first to its last view there.

    `whole` is the union of its outlines in all views there; `is_former` is true if it has left the
    place.
    """

    surface: MergedSurface
    footprint: HorizontalOutline
    whole: HorizontalOutline
    first: ViewKey
    placed: ViewKey
    last: ViewKey
    is_former: bool

    def follows(self, old: _PlacedSurface, margin: float) -> bool:
        """Return whether this can be the surface `old` after it was moved.

        At the same place, views of the old height may have been merged into this surface, so that
        `placed` is compared instead of `first`. `margin` is `views.clear_margin`, m.
        """
        if self.footprint.outline.area < MIN_RECOGNISED_AREA:
            return False
        if self.placed > old.last and old.lies_close_to(self, margin):
            return True
        if not is_of_one_size(old.whole, self.whole):
            return False
        step = abs(self.footprint.z - old.footprint.z)
        if is_in_place(old.footprint, self.footprint):
            return self.placed > old.last and step <= MAX_LIFT
        return self.first > old.last and step <= MIN_LIFT

    def was_lifted_to(self, new: _PlacedSurface, margin: float) -> bool:
        """Return whether it is the surface `new` at an earlier height."""
        step = abs(new.footprint.z - self.footprint.z)
        is_at_its_place = is_in_place(self.footprint, new.footprint) and step > MIN_LIFT
        is_close = new.placed > self.last and self.lies_close_to(new, margin)
        return (is_close or is_at_its_place) and new.follows(self, margin)

    def lies_close_to(self, new: _PlacedSurface, margin: float) -> bool:
        """Return whether the vertical gap to another surface is too small for both to exist.

        Points at the old height are not looked through up to twice `margin`, m, from the new one.
        """
        old, other = self.footprint, new.footprint
        if not MIN_LIFT < abs(old.z - other.z) <= 2.0 * margin:
            return False
        beside = old.outline.difference(other.outline.buffer(BORDER)).area
        return bool(beside <= EDGE_FRACTION * old.outline.area)


def adopt_ids(
    surfaces: Sequence[MergedSurface],
    ids: TrackIds,
    views: list[View],
    poses: tuple[Float64, Float64],
    survivors: Survivors,
    config: Config,
) -> tuple[list[MergedSurface], dict[Members, PastPose]]:
    """Assign their earlier ids to surfaces that were recognised.

    Parameters
    ----------
    surfaces
        Surfaces of the current map.
    ids
        Ids of the same views; updated.
    views, survivors
        Views in stamp order, and the result of carving them.
    poses
        float64 (V, 4, 4), poses of the views, and (V, 3, 3), covariances of z, roll and pitch.
    config
        Uses `views.clear_margin` and the group ``surfaces``.

    Returns
    -------
    surfaces : list of MergedSurface
        The surfaces without remainders at an earlier height.
    previous : dict of Members to PastPose
        Previous pose of each recognised surface.
    """
    former = _former_patches(views, poses[0], survivors, ids, [s.height for s in surfaces])
    candidates = [
        fit_surface(members, views, poses[0], config)
        for members in merge_coplanar(former, *poses, config)
    ]
    T = poses[0]
    old_surfaces = [s for s in candidates if s is not None and s.has_area]
    placed = [_placed_surface(s, ids, T, is_former=True) for s in old_surfaces]
    now = [_placed_surface(s, ids, T, is_former=False) for s in surfaces]
    margin = config.views.clear_margin
    for s in now:
        is_former = any(s.was_lifted_to(new, margin) for new in now)
        placed.append(s._replace(is_former=is_former))
    found = {}
    for i, j in sorted(_successors(placed, margin).items(), key=lambda pair: placed[pair[0]].last):
        old, new = placed[i], placed[j]
        ids.adopt(new.surface.members, old.surface.members)
        if not new.is_former:
            found[new.surface.members] = PastPose(old.surface, old.last.stamp_ns)
    gone = {id(p.surface) for p in placed if p.is_former}
    return [s for s in surfaces if id(s) not in gone], found


def _former_patches(
    views: list[View],
    T_map_view: Float64,
    survivors: Survivors,
    ids: TrackIds,
    heights: Sequence[float],
) -> list[NumberedPatch]:
    """Return the patches that were looked through as a whole, near the height of a surface.

    Patches that they replaced are included, as the last view of a place may have few scan lines
    there.
    """
    first, found = first_numbers(views), set()
    for v, view in enumerate(views):
        for p, patch in enumerate(view.patches):
            is_kept = survivors.keep[v][p].any() or (v, p) in survivors.replaced_by
            if is_kept or not may_be_recognised(patch):
                continue
            z = float(T_map_view[v, 2, :3] @ patch.mean + T_map_view[v, 2, 3])
            if any(abs(z - height) <= MAX_LIFT for height in heights):
                found |= {(v, p), *ids.earlier_indices((v, p), first[v] + p)}
    return [NumberedPatch(first[v] + p, v, views[v].patches[p]) for v, p in sorted(found)]


def _placed_surface(
    surface: MergedSurface, ids: TrackIds, T_map_view: Float64, *, is_former: bool
) -> _PlacedSurface:
    footprint = footprint_of(surface, T_map_view)
    min_area = MAX_FRACTION * surface.polygon.area
    seen = tuple(m for m in surface.members if m.patch.outline.area >= min_area)
    return _PlacedSurface(
        surface,
        footprint,
        ids.outline_in_place(surface.members, footprint),
        ids.first_seen(surface.members),
        ids.placed(surface.members, footprint),
        ids.last_seen(seen or surface.members),
        is_former,
    )


def footprint_of(surface: MergedSurface, T_map_view: Float64) -> HorizontalOutline:
    """Return the footprint of a surface, with the blur of the view with the finest scan lines.

    Parameters
    ----------
    surface
        Surface in map.
    T_map_view
        float64 (V, 4, 4), poses of the views.
    """
    finest = min(surface.members, key=lambda m: (m.patch.spacing or np.inf, m.number))
    blur = T_map_view[finest.view, :2, :2] @ line_of_sight(finest.patch.mean, finest.patch.spacing)
    return HorizontalOutline(surface.polygon, surface.height, tuple(blur.tolist()))


def _successors(placed: Sequence[_PlacedSurface], margin: float) -> dict[int, int]:
    """Associate former surfaces with their successors, one to one; return indices of `placed`."""
    pairs = [
        (new.first, float(np.linalg.norm(new.footprint.middle - old.footprint.middle)), i, j)
        for i, old in enumerate(placed)
        if old.is_former
        for j, new in enumerate(placed)
        if new.follows(old, margin)
    ]
    chosen: dict[int, int] = {}
    for _, _, i, j in sorted(pairs):
        if i not in chosen and j not in chosen.values():
            chosen[i] = j
    return chosen
