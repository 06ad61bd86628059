"""What is still there: a newer view decides wherever it looked.

A point of an older view is *gone* where a newer view looked through its place and measured no
surface there; it is *replaced* where a view of the same place measured that surface again. What a
newer view did not see, because a person stood before it, stays.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import shapely
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.geometry import inverse, planar, transform, wrap_angle
from tccm_ros.surfaces.patch_planes import fit_plane, is_line
from tccm_ros.surfaces.views import KEY_STEP, Patch, View, column_keys

__all__ = ["Survivors", "carve", "superseded"]

Float64 = NDArray[np.float64]
Mask = NDArray[np.bool_]

WHOLE = 0.7
"""A patch of which this share is gone is gone, however small it is."""

REPLACED = 0.95
"""A patch of which a view of the same place measured this share again, or looked through it, is
replaced as a whole, with its rim."""

BLOCK_SPACING = 1.2
"""Columns in which the older points are counted are this many of their spacings wide."""

LEAN_MARGIN = 0.006
"""The base leans: heights are this uncertain per metre of distance (0.3 deg)."""


@dataclass(slots=True)
class Survivors:
    """What is left of the patches.

    Attributes
    ----------
    keep
        For each view, for each patch: bool (N,) over the thinned points.
    heirs
        ``heirs[v, p] = (w, q)``: patch p of view v was replaced by patch q of the newer view w.
    """

    keep: list[list[Mask]]
    heirs: dict[tuple[int, int], tuple[int, int]] = field(default_factory=dict)


def carve(views: list[View], T_map_view: Float64, config: Config) -> Survivors:
    """Take from each view what newer views saw otherwise.

    Parameters
    ----------
    views
        V views in stamp order.
    T_map_view
        float64 (V, 4, 4).
    config
        Uses the groups ``views`` and ``surfaces``.
    """
    left = Survivors([[np.ones(len(p.points), bool) for p in view.patches] for view in views])
    places = planar(T_map_view)
    for w, newer in enumerate(views):
        apart = np.hypot(*(places[:w, :2] - places[w, :2]).T)
        for v in range(w):
            if apart[v] <= newer.reach + views[v].reach:
                turn = abs(wrap_angle(places[v, 2] - places[w, 2]))
                same = apart[v] <= config.views.place_distance and turn <= config.views.place_angle
                T_newer_older = inverse(T_map_view[w]) @ T_map_view[v]
                for p in range(len(views[v].patches)):
                    _carve_patch(left, views, (v, p), w, T_newer_older, bool(same), config)
    return left


def superseded(older: View, newer: View, config: Config) -> dict[int, int] | None:
    """Tell whether a newer view of the same place, taken without a move, makes an older one idle.

    It does where nothing is left of the older one's patches and where it looked through all that
    the older one did. Single lines of a sweep do not count: they cover nothing, and the newer view
    has its own.

    Returns
    -------
    For each patch of the older view that was measured again, the patch that replaced it; None
    where the older view still tells something.
    """
    known = np.isin(older.free.keys, newer.free.keys)
    if np.count_nonzero(known) < REPLACED * len(known):
        return None
    left = carve([older, newer], np.stack([np.eye(4)] * 2), config)
    rest = zip(older.patches, left.keep[0], strict=True)
    if any(mask.any() and not is_line(patch.cov) for patch, mask in rest):
        return None
    return {p: q for (v, p), (_, q) in left.heirs.items() if v == 0}


def _carve_patch(
    left: Survivors,
    views: list[View],
    older: tuple[int, int],
    w: int,
    T_newer_older: Float64,
    same_place: bool,
    config: Config,
) -> None:
    """Take from one patch what view `w` saw otherwise."""
    v, p = older
    keep = left.keep[v][p]
    alive = np.flatnonzero(keep)
    points = transform(T_newer_older, views[v].patches[p].points[alive])
    near = np.hypot(points[:, 0], points[:, 1]) <= views[w].reach
    alive, points = alive[near], points[near]
    if len(alive) == 0:
        return
    margin = config.views.clear_margin + LEAN_MARGIN * np.hypot(points[:, 0], points[:, 1])
    through = views[w].free.contains(points, margin)
    if not same_place and not through.any():
        return
    reach = config.surfaces.merge_distance
    owner = _measured_by(points, views[w].patches, margin, 0.5 * reach)
    gone = through & (owner < 0)
    total = int(keep.sum())
    block = max(config.views.cell_size, BLOCK_SPACING * views[v].patches[p].spacing)
    if gone.sum() < WHOLE * total:
        gone &= _in_block(points, gone, block)
    if same_place and (owner >= 0).any():
        left.heirs[older] = (w, int(np.bincount(owner[owner >= 0]).argmax()))
        again = _measured_by(points, views[w].patches, margin, -reach) >= 0
        rest = ~gone & ~again
        if np.count_nonzero(gone | (owner >= 0)) >= REPLACED * total:
            gone[:] = True
        gone |= again | (rest & ~_in_block(points, rest & (owner < 0), block))
    keep[alive[gone]] = False


def _measured_by(
    points: Float64, patches: tuple[Patch, ...], margin: Float64, grow: float
) -> NDArray[np.int64]:
    """Return the patch that covers each point (N, 3) of the same frame, int64 (N,), -1 = none.

    A patch covers what its outline covers, grown by `grow` m: a replaced patch keeps a rim, so
    that what is left of it still touches what replaced it.
    """
    owner = np.full(len(points), -1, np.int64)
    reach = max(grow, 0.0)
    low, high = points[:, :2].min(axis=0) - reach, points[:, :2].max(axis=0) + reach
    for q, patch in enumerate(patches):
        bounds = np.array(patch.outline.bounds)
        if np.isnan(bounds).any() or np.any(bounds[:2] > high) or np.any(bounds[2:] < low):
            continue
        normal, _ = fit_plane(patch.cov)
        height = (points - patch.mean) @ normal
        level = np.flatnonzero((np.abs(height) <= margin) & (owner < 0))
        area = patch.outline.buffer(grow, quad_segs=2)
        shapely.prepare(area)
        owner[level[shapely.contains_xy(area, points[level, 0], points[level, 1])]] = q
    return owner


def _in_block(points: Float64, chosen: Mask, cell_size: float) -> Mask:
    """Return which points stand in a square of 2 x 2 columns where most points are chosen.

    Along an edge, columns are seen through that the surface covers in part: those are one column
    wide, what has really gone is wider.
    """
    keys, group = np.unique(column_keys(points, cell_size), return_inverse=True)
    share = np.bincount(group, chosen, len(keys)) / np.bincount(group, minlength=len(keys))
    full = keys[share > 0.5]
    block = np.zeros(len(keys), bool)
    for dx in (-1, 0):
        for dy in (-1, 0):
            corner = keys + dx * KEY_STEP + dy
            square = [np.isin(corner + a * KEY_STEP + b, full) for a in (0, 1) for b in (0, 1)]
            block |= np.logical_and.reduce(square)
    return block[group]
