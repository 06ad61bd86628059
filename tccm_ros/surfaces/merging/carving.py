"""Carving: remove points of older views that newer views contradict or measure again.

A point of an older view is *gone* if a newer view looked through its position and measured no
surface there. It is *replaced* if a newer view from the same pose measured the surface again. A
point that is occluded in the newer view, for example by a person, stays.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from hashlib import blake2b
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.config import Config
from tccm_ros.cuboids.free_columns import KEY_STEP, column_keys
from tccm_ros.geometry import inverse, planar, pose_from_rpy, wrap_angle
from tccm_ros.robust import MAJORITY
from tccm_ros.surfaces.displacement import (
    BORDER,
    blurred,
    footprint_in_map,
    is_displaced,
    line_of_sight,
)
from tccm_ros.surfaces.merging.free_grid import FreeGrid, blocks_of
from tccm_ros.surfaces.merging.patch_planes import fit_plane, is_line
from tccm_ros.surfaces.merging.recent_cache import RecentCache
from tccm_ros.surfaces.views.stray_points import GAP, MAX_FRACTION
from tccm_ros.surfaces.views.views import SurfacePatch, View

TILT_MARGIN = 0.006
"""Height uncertainty per metre of distance: 0.3 deg of roll and pitch of the base; chosen."""

STEPS = np.array([0.002, 0.002, 0.002, 0.0005, 0.0005, 0.0005])
"""Quantisation of the relative pose of two views, m and rad: a fraction of the range noise and of
`TILT_MARGIN`; chosen."""

MIN_RECOGNISED_AREA = 0.1
"""Min area of a surface that is recognised at another place, m2. Chosen: below a stool's seat;
boxes and shoulders of people come and go."""


@dataclass(slots=True)
class Survivors:
    """Result of carving: the points that remain, and the patches that were replaced.

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
class _PatchIndex:
    """Index of a newer patch to find the points that it measured.

    Attributes
    ----------
    bounds
        float64 (4,), bounding box of its outline; NaN if it has no outline.
    mean, normal
        Its plane, float64 (3,).
    patch
        The patch.
    extent
        Area in which the patch may be, given the distance of its scan lines (`spacing`).
    areas
        Its outline buffered by the key, m.
    """

    bounds: Float64
    mean: Float64
    normal: Float64
    patch: SurfacePatch
    extent: BaseGeometry
    areas: dict[float, BaseGeometry] = field(default_factory=dict)

    @classmethod
    def of(cls, patch: SurfacePatch) -> _PatchIndex:
        """Return the index of a patch."""
        blur = line_of_sight(patch.mean, patch.spacing)
        extent = blurred(patch.outline, BORDER, (float(blur[0]), float(blur[1])))
        shapely.prepare(extent)
        bounds = np.array(patch.outline.bounds)
        return cls(bounds, patch.mean, fit_plane(patch.cov)[0], patch, extent)

    def area(self, grow: float) -> BaseGeometry:
        """Return the outline buffered by `grow` m, prepared."""
        if grow not in self.areas:
            self.areas[grow] = self.patch.outline.buffer(grow, quad_segs=2)
            shapely.prepare(self.areas[grow])
        return self.areas[grow]


@dataclass(frozen=True, slots=True, eq=False)
class _ViewIndex:
    """Pose-independent index of a view for comparisons with other views."""

    view: View
    free: FreeGrid
    patches: tuple[_PatchIndex, ...]
    blocks: tuple[Float64, ...]

    @classmethod
    def of(cls, view: View) -> _ViewIndex:
        blocks = tuple(blocks_of(p.points, view.free.cell_size) for p in view.patches)
        return cls(view, FreeGrid.of(view.free), tuple(map(_PatchIndex.of, view.patches)), blocks)


class _Carved(NamedTuple):
    """Result of carving a patch by a newer view: removed points, and the replacing patch.

    `before` identifies the mask to which the result applies, and `gone` has indices of thinned
    points.
    """

    before: bytes
    gone: Int64
    replaced_by: int | None


@dataclass(frozen=True, slots=True, eq=False)
class _ViewPair:
    """An older view in the frame of a newer view with a possibly overlapping field of view.

    Attributes
    ----------
    older, newer
        The views.
    step
        int64 (6,), their relative pose in steps of `STEPS`.
    is_same_pose
        Whether both were taken at the same pose.
    touched
        Patches of the older view of which the newer view may remove points.
    carved
        The last carving result of each patch.
    """

    older: View
    newer: _ViewIndex
    step: Int64
    is_same_pose: bool
    touched: tuple[int, ...]
    carved: dict[int, _Carved]


class Carver:
    """Carves views, with a cache of the result of each pair of views.

    Relative poses are quantised in steps of `STEPS`. Between two solutions most relative poses
    change by less, and their pairs are not compared again. The cache does not affect the result.

    Parameters
    ----------
    config
        Uses the groups ``views`` and ``surfaces``.
    """

    def __init__(self, config: Config):
        self._config = config
        self._indices = RecentCache[_ViewIndex]()
        self._pairs = RecentCache[_ViewPair]()

    @property
    def compared(self) -> int:
        """Number of pairs that the last `carve` compared because they were not in the cache."""
        return self._pairs.made

    def carve(self, views: list[View], T_map_view: Float64) -> Survivors:
        """Remove from each view the points that newer views contradict or replace.

        Parameters
        ----------
        views
            V views in stamp order.
        T_map_view
            float64 (V, 4, 4).
        """
        self._indices.begin_round()
        self._pairs.begin_round()
        settings = repr((self._config.views, self._config.surfaces))
        survivors = Survivors([[np.ones(len(p.points), bool) for p in v.patches] for v in views])
        mask_hashes = [[b""] * len(view.patches) for view in views]
        indices = [self._indices.get(view, partial(_ViewIndex.of, view)) for view in views]
        for w, newer in enumerate(indices):
            for v, step, is_same_pose in _neighbours(views, T_map_view, w, self._config):
                key = views[v], newer.view, settings, step.tobytes(), is_same_pose
                compare = partial(self._compare, indices[v], newer, step, is_same_pose)
                pair = self._pairs.get(key, compare)
                for p in pair.touched:
                    self._carve_patch(pair, (v, p, w), mask_hashes, survivors)
        return survivors

    def _compare(
        self, older: _ViewIndex, newer: _ViewIndex, step: Int64, is_same_pose: bool
    ) -> _ViewPair:
        """Return a pair of views at a relative pose."""
        T = pose_from_rpy(step * STEPS)
        margins, limit = (self._config.views.clear_margin, TILT_MARGIN), newer.view.max_range
        touched = tuple(
            p
            for p, blocks in enumerate(older.blocks)
            if is_same_pose or newer.free.may_touch(blocks, T, limit, margins)
        )
        return _ViewPair(older.view, newer, step, is_same_pose, touched, {})

    def _carve_patch(
        self,
        pair: _ViewPair,
        indices: tuple[int, int, int],
        mask_hashes: list[list[bytes]],
        survivors: Survivors,
    ) -> None:
        """Remove the points of patch p of view v that view w contradicts or replaces.

        Parameters
        ----------
        pair
            Views v and w.
        indices
            (v, p, w).
        mask_hashes
            Hash of the mask of each patch, updated.
        survivors
            Result so far, updated.
        """
        v, p, w = indices
        keep = survivors.keep[v][p]
        carved = pair.carved.get(p)
        if carved is None or carved.before != mask_hashes[v][p]:
            gone, q = _points_to_carve(pair, pair.older.patches[p], keep, self._config)
            gone = _with_strays(gone, keep)
            carved = pair.carved[p] = _Carved(mask_hashes[v][p], gone, q)
        if len(carved.gone):
            keep[carved.gone] = False
            mask_hashes[v][p] = blake2b(keep.tobytes(), digest_size=16).digest()
        if carved.replaced_by is not None:
            survivors.replaced_by[v, p] = w, carved.replaced_by


def carve(views: list[View], T_map_view: Float64, config: Config) -> Survivors:
    """Carve views once, without a cache.

    Parameters
    ----------
    views, T_map_view, config
        As for `Carver`.
    """
    return Carver(config).carve(views, T_map_view)


def _neighbours(
    views: list[View], T_map_view: Float64, w: int, config: Config
) -> Iterator[tuple[int, Int64, bool]]:
    """Yield (v, step, is_same_pose) of each older view v in range of view w.

    `step` is the pose of v in w in steps of `STEPS`.
    """
    poses, same = planar(T_map_view[: w + 1]), config.views
    distance = np.hypot(*(poses[:w, :2] - poses[w, :2]).T)
    yaw = np.abs(wrap_angle(poses[:w, 2] - poses[w, 2]))
    ranges = np.array([view.max_range for view in views[: w + 1]])
    is_same = (distance <= same.place_distance) & (yaw <= same.place_angle)
    steps = np.rint(_rpy(inverse(T_map_view[w]) @ T_map_view[:w]) / STEPS).astype(np.int64)
    for v in np.flatnonzero(distance <= ranges[w] + ranges[:w]).tolist():
        yield v, steps[v], bool(is_same[v])


def _rpy(T: Float64) -> Float64:
    """Return poses (N, 4, 4) as (N, 6) of (x, y, z, roll, pitch, yaw)."""
    roll = np.arctan2(T[:, 2, 1], T[:, 2, 2])
    pitch = -np.arcsin(np.clip(T[:, 2, 0], -1.0, 1.0))
    yaw = np.arctan2(T[:, 1, 0], T[:, 0, 0])
    return np.column_stack([T[:, :3, 3], roll, pitch, yaw])


def may_be_recognised(patch: SurfacePatch) -> bool:
    """Return whether a patch is large enough to be recognised at another place."""
    return patch.outline.area >= MIN_RECOGNISED_AREA and not is_line(patch.cov)


def find_replacements(older: View, newer: View, config: Config) -> dict[int, int] | None:
    """Find the patches that replace those of an older view that a newer view makes redundant.

    The older view is redundant if carving leaves none of its patches and if the newer view looked
    through the columns that the older one looked through, but for 5 % (`MAX_FRACTION`). Single
    scan lines do not count: they cover no area, and the newer view has its own. A view with a large
    patch that was looked through is not redundant: its surface may be recognised elsewhere.

    Parameters
    ----------
    older, newer
        Two views between which the base did not move.
    config
        Uses the groups ``views`` and ``surfaces``.

    Returns
    -------
    dict of int to int, or None
        Index of the replacing patch, by the patch of the older view that was measured again; None
        if the older view is not redundant.
    """
    known = np.isin(older.free.keys, newer.free.keys)
    if np.count_nonzero(~known) > MAX_FRACTION * len(known):
        return None
    survivors = carve([older, newer], np.stack([np.eye(4)] * 2), config)
    rest = zip(older.patches, survivors.keep[0], strict=True)
    if any(mask.any() and not is_line(patch.cov) for patch, mask in rest):
        return None
    replaced_by = {p: q for (_, p), (_, q) in survivors.replaced_by.items()}
    if any(may_be_recognised(p) for k, p in enumerate(older.patches) if k not in replaced_by):
        return None
    return replaced_by


def _points_to_carve(
    pair: _ViewPair, patch: SurfacePatch, keep: Bool, config: Config
) -> tuple[Int64, int | None]:
    """Find the points of a patch of the older view that the newer view of a pair removes.

    Returns
    -------
    gone : int64 (G,)
        Indices of the thinned points to remove, among those kept so far.
    replaced_by : int or None
        The patch of the newer view that replaces this one, as a whole or in part.
    """
    total, cell_size = int(np.count_nonzero(keep)), config.views.cell_size
    limits = pair.newer.view.max_range, (config.views.clear_margin, TILT_MARGIN)
    T_newer_older = pose_from_rpy(pair.step * STEPS)
    points, through, margin = pair.newer.free.look(patch.points, T_newer_older, *limits)
    near = margin >= 0.0
    there = keep & near
    kept = np.flatnonzero(there)
    if len(kept) == 0 or not (pair.is_same_pose or through[kept].any()):
        return kept[:0], None
    rim = config.surfaces.merge_distance
    owner = _measured_by(points[near], pair.newer.patches, margin[near], 0.5 * rim)
    # The motion test uses all points in range, including those that other views removed.
    if _was_moved(pair, patch, points[near], (through[near] & (owner < 0), owner), cell_size):
        return kept, _main_owner(owner)
    owner, points, through, margin = owner[there[near]], points[kept], through[kept], margin[kept]
    gone = through & (owner < 0)
    # No column of the surface is then empty by chance.
    block = max(cell_size, GAP * patch.spacing)
    if total - gone.sum() > MAX_FRACTION * total:
        gone &= _in_block(points, gone, block)
    if not pair.is_same_pose or not (owner >= 0).any():
        return kept[gone], None
    again = _measured_by(points, pair.newer.patches, margin, -rim) >= 0
    rest = ~gone & ~again
    if total - np.count_nonzero(gone | (owner >= 0)) <= MAX_FRACTION * total:
        gone[:] = True
    gone |= again | (rest & ~_in_block(points, rest & (owner < 0), block))
    return kept[gone], _main_owner(owner)


def _with_strays(gone: Int64, keep: Bool) -> Int64:
    """Return `gone`, or all kept points if too few would remain to be a surface.

    Parameters
    ----------
    gone
        int64 (G,), indices of the thinned points of a patch that a view removes.
    keep
        bool (N,), whether each of its points was kept before.
    """
    kept = np.flatnonzero(keep)
    is_gone = len(gone) > 0 and len(kept) - len(gone) <= MAX_FRACTION * len(keep)
    return kept if is_gone else gone


def _measured_by(
    points: Float64, patches: tuple[_PatchIndex, ...], margin: Float64, grow: float
) -> Int64:
    """Return the patch that covers each point (N, 3) of the same frame, int64 (N,), -1 = none.

    A patch covers its outline, buffered by `grow` m. With a negative value, a replaced patch keeps
    a rim, so that its remaining points still touch the patch that replaced it.
    """
    owner = np.full(len(points), -1, np.int64)
    margin_xy = max(grow, 0.0)
    low, high = points[:, :2].min(axis=0) - margin_xy, points[:, :2].max(axis=0) + margin_xy
    for q, patch in enumerate(patches):
        # False for the NaN bounds of a patch without outline.
        if not (np.all(patch.bounds[:2] <= high) and np.all(patch.bounds[2:] >= low)):
            continue
        height = (points - patch.mean) @ patch.normal
        near = np.flatnonzero((np.abs(height) <= margin) & (owner < 0))
        inside = shapely.contains_xy(patch.area(grow), points[near, 0], points[near, 1])
        owner[near[inside]] = q
    return owner


def _was_moved(
    pair: _ViewPair,
    patch: SurfacePatch,
    points: Float64,
    looked_at: tuple[Bool, Int64],
    cell_size: float,
) -> bool:
    """Return whether a patch has vacated one strip and covers another one in the newer view.

    The newer view may look through columns that the surface covers in part. Only columns or points
    outside of the possible extent of the newer patch count as vacated.

    Parameters
    ----------
    pair, patch
        The two views, and a patch of the older one.
    points
        float64 (N, 3), its points in the newer view, m.
    looked_at
        Whether each point is gone, bool (N,), and the patch that measured it, int64 (N,),
        -1 = none.
    cell_size
        Edge of a column, m.
    """
    gone, owner = looked_at
    min_count = MAX_FRACTION * len(points)
    if np.count_nonzero(gone) <= min_count or not (owner >= 0).any():
        return False
    patch_there = pair.newer.patches[_main_owner(owner)]
    # A column that the extent does not touch is not covered in part. A narrow strip has no such
    # columns: its points are counted instead.
    points_outside = ~shapely.contains_xy(patch_there.extent, points[:, 0], points[:, 1])
    for outside in (_columns_outside(patch_there.extent, points, cell_size), points_outside):
        if np.count_nonzero(gone & outside) > max(min_count, MAJORITY * outside.sum()):
            break
    else:
        return False
    T_newer_older = pose_from_rpy(pair.step * STEPS)
    before = footprint_in_map(patch.outline, patch.mean, patch.spacing, T_newer_older)
    new = patch_there.patch
    return is_displaced(before, footprint_in_map(new.outline, new.mean, new.spacing, np.eye(4)))


def _columns_outside(extent: BaseGeometry, points: Float64, cell_size: float) -> Bool:
    """Return whether each point (N, 3) is in a column that the extent does not touch, bool (N,)."""
    keys, column = np.unique(column_keys(points, cell_size), return_inverse=True)
    first = np.zeros(len(keys), np.int64)
    first[column] = np.arange(len(points))
    x, y = cell_size * np.floor(points[first, :2] / cell_size).T
    is_cut = shapely.intersects(extent, shapely.box(x, y, x + cell_size, y + cell_size))
    return np.asarray(~is_cut[column])


def _main_owner(owner: Int64) -> int:
    """Return the patch that measured most points; -1 in `owner` stands for no patch."""
    return int(np.bincount(owner[owner >= 0]).argmax())


def _in_block(points: Float64, chosen: Bool, cell_size: float) -> Bool:
    """Return whether each point is in a square of 2 x 2 columns whose points are mostly chosen.

    Along an edge, the view looks through columns that the surface covers in part. They form a strip
    one column wide. A region that is really gone is wider.
    """
    if not chosen.any():
        return chosen
    keys, group = np.unique(column_keys(points, cell_size), return_inverse=True)
    fraction = np.bincount(group, chosen, len(keys)) / np.bincount(group, minlength=len(keys))
    full = keys[fraction > MAJORITY]
    beside = np.array([dx * KEY_STEP + dy for dx in (-1, 0, 1) for dy in (-1, 0, 1)])
    is_full = _is_among(keys + beside[:, None], full).reshape(3, 3, -1)
    squares = [is_full[x : x + 2, y : y + 2].all(axis=(0, 1)) for x in (0, 1) for y in (0, 1)]
    return np.logical_or.reduce(squares)[group]


def _is_among(keys: Int64, known: Int64) -> Bool:
    """Return whether each key is in the sorted array `known`."""
    if not len(known):
        return np.zeros(keys.shape, bool)
    return known[np.minimum(np.searchsorted(known, keys), len(known) - 1)] == keys
