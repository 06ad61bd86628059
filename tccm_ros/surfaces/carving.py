"""Carving: points of older views are removed where a newer view saw something else.

A point of an older view is *gone* where a newer view looked through its position and measured no
surface there; it is *replaced* where a newer view from the same pose measured that surface again. A
point that the newer view did not see, because a person stood in front of it, stays.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import shapely

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.config import Config
from tccm_ros.cuboids.free_columns import KEY_STEP, column_keys
from tccm_ros.geometry import inverse, planar, transform, wrap_angle
from tccm_ros.surfaces.patch_planes import fit_plane, is_line
from tccm_ros.surfaces.views import Patch, View

GONE_FRACTION = 0.7
"""A patch of which this fraction is gone is removed as a whole, however small it is; chosen."""

REPLACED_FRACTION = 0.95
"""A patch of which a newer view from the same pose measured or looked through this fraction is
replaced as a whole, with its rim; chosen."""

BLOCK_SPACING = 1.2
"""Columns in which the older points are counted are this many point spacings wide, so that a column
of a surface is not empty by chance; chosen."""

TILT_MARGIN = 0.006
"""Uncertainty of heights per metre of distance: 0.3 deg of roll and pitch of the base; chosen."""

MAJORITY = 0.5
"""A column is removed where more than this fraction of its points is gone; chosen."""


@dataclass(slots=True)
class Survivors:
    """The points and patches that carving leaves.

    Attributes
    ----------
    keep
        For each view, for each patch: bool (N,) over the thinned points.
    replaced_by
        ``replaced_by[v, p] = (w, q)``: patch p of view v was replaced by patch q of the newer
        view w.
    """

    keep: list[list[Bool]]
    replaced_by: dict[tuple[int, int], tuple[int, int]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class _ViewPair:
    """An older view in the frame of a newer one that may have looked where it did."""

    older: View
    newer: View
    T_newer_older: Float64
    is_same_pose: bool


def carve(views: list[View], T_map_view: Float64, config: Config) -> Survivors:
    """Remove from each view the points that newer views contradict or replace.

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
    poses, same = planar(T_map_view), config.views
    for w, newer in enumerate(views):
        distance = np.hypot(*(poses[:w, :2] - poses[w, :2]).T)
        for v, older in enumerate(views[:w]):
            if distance[v] > newer.max_range + older.max_range:
                continue
            yaw = abs(wrap_angle(poses[v, 2] - poses[w, 2]))
            is_same_pose = distance[v] <= same.place_distance and yaw <= same.place_angle
            T_newer_older = inverse(T_map_view[w]) @ T_map_view[v]
            pair = _ViewPair(older, newer, T_newer_older, bool(is_same_pose))
            for p, patch in enumerate(older.patches):
                gone, q = _carve_patch(pair, patch, left.keep[v][p], config)
                left.keep[v][p][gone] = False
                if q is not None:
                    left.replaced_by[v, p] = w, q
    return left


def find_replacements(older: View, newer: View, config: Config) -> dict[int, int] | None:
    """Find the patches that replace those of an older view which a newer one makes redundant.

    The older view is redundant where carving leaves none of its patches and where the newer view
    looked through all columns that the older one did. Patches that are single scan lines do not
    count: they cover no area, and the newer view has its own.

    Parameters
    ----------
    older, newer
        Two views between which the base did not move.
    config
        Uses the groups ``views`` and ``surfaces``.

    Returns
    -------
    dict of int to int, or None
        For each patch of the older view that was measured again, the index of the patch that
        replaced it; None where the older view is not redundant.
    """
    known = np.isin(older.free.keys, newer.free.keys)
    if np.count_nonzero(known) < REPLACED_FRACTION * len(known):
        return None
    left = carve([older, newer], np.stack([np.eye(4)] * 2), config)
    rest = zip(older.patches, left.keep[0], strict=True)
    if any(mask.any() and not is_line(patch.cov) for patch, mask in rest):
        return None
    return {p: q for (_, p), (_, q) in left.replaced_by.items()}


def _carve_patch(
    pair: _ViewPair, patch: Patch, keep: Bool, config: Config
) -> tuple[Int64, int | None]:
    """Find the points of a patch of the older view that the newer view of a pair removes.

    Returns
    -------
    gone : int64 (G,)
        Indices of thinned points, among those that are kept so far, that are removed.
    replaced_by : int or None
        The patch of the newer view that replaced this one, in whole or in part.
    """
    kept = np.flatnonzero(keep)
    points = transform(pair.T_newer_older, patch.points[kept])
    distance = np.hypot(points[:, 0], points[:, 1])
    near = distance <= pair.newer.max_range
    total, kept, points, distance = len(kept), kept[near], points[near], distance[near]
    if len(kept) == 0:
        return kept, None
    margin = config.views.clear_margin + TILT_MARGIN * distance
    through = pair.newer.free.contains(points, margin)
    if not pair.is_same_pose and not through.any():
        return kept[:0], None
    rim = config.surfaces.merge_distance
    owner = _measured_by(points, pair.newer.patches, margin, 0.5 * rim)
    gone = through & (owner < 0)
    block = max(config.views.cell_size, BLOCK_SPACING * patch.spacing)
    if gone.sum() < GONE_FRACTION * total:
        gone &= _in_block(points, gone, block)
    if not pair.is_same_pose or not (owner >= 0).any():
        return kept[gone], None
    again = _measured_by(points, pair.newer.patches, margin, -rim) >= 0
    rest = ~gone & ~again
    if np.count_nonzero(gone | (owner >= 0)) >= REPLACED_FRACTION * total:
        gone[:] = True
    gone |= again | (rest & ~_in_block(points, rest & (owner < 0), block))
    return kept[gone], int(np.bincount(owner[owner >= 0]).argmax())


def _measured_by(
    points: Float64, patches: tuple[Patch, ...], margin: Float64, grow: float
) -> Int64:
    """Return the patch that covers each point (N, 3) of the same frame, int64 (N,), -1 = none.

    A patch covers its outline, grown by `grow` m. Where it is negative, a replaced patch keeps a
    rim, so that its remaining points still touch the patch that replaced it.
    """
    owner = np.full(len(points), -1, np.int64)
    margin_xy = max(grow, 0.0)
    low, high = points[:, :2].min(axis=0) - margin_xy, points[:, :2].max(axis=0) + margin_xy
    for q, patch in enumerate(patches):
        bounds = np.array(patch.outline.bounds)
        if np.isnan(bounds).any() or np.any(bounds[:2] > high) or np.any(bounds[2:] < low):
            continue
        normal, _ = fit_plane(patch.cov)
        height = (points - patch.mean) @ normal
        near = np.flatnonzero((np.abs(height) <= margin) & (owner < 0))
        area = patch.outline.buffer(grow, quad_segs=2)
        shapely.prepare(area)
        owner[near[shapely.contains_xy(area, points[near, 0], points[near, 1])]] = q
    return owner


def _in_block(points: Float64, chosen: Bool, cell_size: float) -> Bool:
    """Return which points are in a square of 2 x 2 columns where most points are chosen.

    Along an edge, the view looked through columns that the surface covers in part: they form a
    strip one column wide. A region that is really gone is wider.
    """
    keys, group = np.unique(column_keys(points, cell_size), return_inverse=True)
    fraction = np.bincount(group, chosen, len(keys)) / np.bincount(group, minlength=len(keys))
    full = keys[fraction > MAJORITY]
    block = np.zeros(len(keys), bool)
    for dx in (-1, 0):
        for dy in (-1, 0):
            corner = keys + dx * KEY_STEP + dy
            square = [np.isin(corner + a * KEY_STEP + b, full) for a in (0, 1) for b in (0, 1)]
            block |= np.logical_and.reduce(square)
    return block[group]
