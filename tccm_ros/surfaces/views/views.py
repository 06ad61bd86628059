"""Views: the surfaces that one tilt cycle measured, in the base frame of its stamp.

A view keeps the exact moments of each patch, its outline, a thinned cloud, and the free intervals
that the tilt cycle looked through. The recording is not read again.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely import MultiPolygon, Polygon

from tccm_ros.arrays import Float32, Float64, Int32, Int64
from tccm_ros.config import Config
from tccm_ros.cuboids.free_columns import FreeColumns
from tccm_ros.records import ObjectBoxes, SensorKind, SurfaceCloud, ViewIntervals
from tccm_ros.sensors.noise import systematic_errors
from tccm_ros.surfaces.displacement import HorizontalOutline, footprint_in_map, is_displaced
from tccm_ros.surfaces.object_labels import SeenDetection, merge_detections
from tccm_ros.surfaces.views.outline import horizontal_outline
from tccm_ros.surfaces.views.plane_errors import fit_covariance, systematic_planes
from tccm_ros.surfaces.views.stray_points import mark_strays
from tccm_ros.surfaces.views.thinning import thin_cloud


@dataclass(frozen=True, slots=True, eq=False)
class SurfacePatch:
    """The part of a surface that one view measured, in the base frame of the view.

    Attributes
    ----------
    points
        float32 (N, 3), thinned, m.
    weights
        int32 (N,), number of measured points that each thinned point represents.
    count
        Number of measured points.
    mean
        float64 (3,), mean of the measured points, m.
    cov
        float64 (3, 3), covariance of the measured points, m2.
    outline
        Outline in x and y of the base frame, m.
    spacing
        Distance between neighbouring points or scan lines, m.
    cov_plane
        float64 (3, 3), covariance of (z, dz/dx, dz/dy) of the plane at `mean`, due to the patch's
        own points.
    systematic
        float64 (3, K), error of the same for each component of the view's systematic error, at one
        sigma.
    number
        Number of the oldest removed patch that this one replaced, relative to the first patch of
        its view (negative); None: it replaced none.
    first_seen_ns
        Stamp of the oldest removed patch that this one replaced; None: it replaced none.
    placed_ns
        Stamp of the oldest removed patch that this one replaced at the same place; None: it
        replaced none there.
    """

    points: Float32
    weights: Int32
    count: int
    mean: Float64
    cov: Float64
    outline: MultiPolygon
    spacing: float
    cov_plane: Float64
    systematic: Float64 = field(default_factory=lambda: np.zeros((3, 0)))
    number: int | None = None
    first_seen_ns: int | None = None
    placed_ns: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class SeenObject:
    """An object on a surface in one view, a prism in the base frame of the view.

    Attributes
    ----------
    footprint
        float64 (H, 2), convex hull of its points seen from above, an open ring, m.
    low, high
        Height of its lower and upper end, m.
    points
        Number of points on it.
    number
        Number of the oldest removed box that this one replaced, relative to the first box of its
        view (negative); None: it replaced none.
    first_seen_ns
        Stamp of that box; None: it replaced none.
    views
        Number of views that measured it, including removed views.
    """

    footprint: Float64
    low: float
    high: float
    points: int
    number: int | None = None
    first_seen_ns: int | None = None
    views: int = 1


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One surface cloud with the free intervals and the objects of its tilt cycle.

    Attributes
    ----------
    stamp_ns
        Stamp of the base frame.
    patches
        Patches in the order of the cloud's surface indices.
    free
        Columns of free space, in the base frame.
    max_range
        Max horizontal distance of a point or a free column from the base, m.
    session
        Session of the view, counted from 0; stamps may repeat over sessions.
    forgotten
        Number of patches of removed older views that this one replaced.
    objects
        Objects on the surfaces.
    forgotten_objects
        Number of objects of removed older views that this one replaced.
    detections
        Detections since the previous view, and those of removed views.
    corrected_labels
        User-supplied labels of surfaces, by patch number relative to the first patch of this view
        (negative for a patch of a removed view).
    viewpoint
        float64 (3,), position of the sensor in the base frame, m; None: unknown.
    sensor
        Kind of that sensor.
    hits
        float32 (M, 4), as in `ViewIntervals`, in the base frame.
    """

    stamp_ns: int
    patches: tuple[SurfacePatch, ...]
    free: FreeColumns
    max_range: float
    session: int = 0
    forgotten: int = 0
    objects: tuple[SeenObject, ...] = ()
    forgotten_objects: int = 0
    detections: tuple[SeenDetection, ...] = ()
    corrected_labels: Mapping[int, str] = field(default_factory=dict)
    viewpoint: Float64 | None = None
    sensor: SensorKind = SensorKind.LASER
    hits: Float32 = field(default_factory=lambda: np.zeros((0, 4), np.float32))

    @property
    def key(self) -> tuple[int, int]:
        """Session and stamp, by which views are sorted."""
        return self.session, self.stamp_ns


class _Outlined(NamedTuple):
    """Points of a surface, thinned points with weights, outline, and spacing, m."""

    points: Float32
    thinned: Float32
    weights: Int32
    outline: MultiPolygon
    spacing: float


def _make_patches(
    points: Float32, others: Float32, sensor: SensorKind, config: Config
) -> list[SurfacePatch]:
    """Return the patches of one surface of a cloud, one for each part of its outline.

    Stray points are removed, first by the points of the cloud's other surfaces (`others`, float32
    (M, 3)), and then, for each part, also by those of the other parts. Points without an outline (a
    single scan line) make one patch without area.
    """
    thinned, weights = thin_cloud(points, config.views.voxel_size)
    min_gap = config.surfaces.merge_distance
    outline, spacing = horizontal_outline(thinned[:, :2].astype(np.float64), min_gap, sensor)
    whole = _Outlined(points, thinned, weights, outline, spacing)
    whole = _without_strays(whole, others, min_gap, sensor)
    if len(whole.outline.geoms) < 2:
        return [_patch(*whole)]
    parts = sorted(whole.outline.geoms, key=lambda part: (-part.area, part.bounds))
    of_point, of_thinned = _nearest(parts, whole.points), _nearest(parts, whole.thinned)
    patches = []
    for k, part in enumerate(parts):
        own, own_thinned = of_point == k, of_thinned == k
        if own.any() and own_thinned.any():
            one = _Outlined(
                whole.points[own],
                whole.thinned[own_thinned],
                whole.weights[own_thinned],
                MultiPolygon([part]),
                whole.spacing,
            )
            rest = np.concatenate([others, whole.thinned[~own_thinned]])
            patches.append(_patch(*_without_strays(one, rest, min_gap, sensor)))
    return patches


def _without_strays(
    surface: _Outlined, others: Float32, min_gap: float, sensor: SensorKind
) -> _Outlined:
    """Return a surface without stray points, with a new outline if there are any."""
    points, thinned, weights, _, spacing = surface
    strays = mark_strays(thinned, weights, spacing, others, min_gap)
    if not strays.any():
        return surface
    plan = thinned[:, :2].astype(np.float64)
    kept = ~strays[cKDTree(plan).query(points[:, :2])[1]]
    outline, spacing = horizontal_outline(plan[~strays], min_gap, sensor)
    return _Outlined(points[kept], thinned[~strays], weights[~strays], outline, spacing)


def _nearest(parts: list[Polygon], points: Float32) -> Int64:
    """Return the index of the part nearest to each point (N, >= 2), int64 (N,)."""
    x, y = points[:, :2].astype(np.float64).T
    nearest = np.zeros(len(points), np.int64)
    found = np.zeros(len(points), np.int64)
    for k, part in enumerate(parts):
        shapely.prepare(part)
        inside = shapely.intersects_xy(part, x, y)
        nearest[inside] = k
        found += inside
    others = np.flatnonzero(found != 1)  # the tree is slow, and most points are in just one part
    nearest[others] = shapely.STRtree(parts).nearest(shapely.points(x[others], y[others]))
    return nearest


def _patch(
    points: Float32,
    thinned: Float32,
    weights: Int32,
    outline: MultiPolygon,
    spacing: float,
) -> SurfacePatch:
    exact = points.astype(np.float64)
    mean = exact.mean(axis=0)
    cov = (exact - mean).T @ (exact - mean) / len(exact)
    own = fit_covariance(exact, np.ones(len(exact)))
    return SurfacePatch(thinned, weights, len(exact), mean, cov, outline, spacing, own)


def first_numbers(views: Sequence[View]) -> list[int]:
    """Return the number of the first patch of each view; removed patches keep their numbers."""
    numbers, after = [], 0
    for view in views:
        numbers.append(after + view.forgotten)
        after = numbers[-1] + len(view.patches)
    return numbers


def with_numbers_of(newer: View, older: View, replaced_by: Mapping[int, int]) -> View:
    """Return the newer view with the numbers and stamps of an older view that will be removed.

    Parameters
    ----------
    newer, older
        Two successive views.
    replaced_by
        Result of `find_replacements`: patches of the newer view by patches of the older one.
    """
    patches = list(newer.patches)
    for p, q in sorted(replaced_by.items()):
        patch, own = older.patches[p], patches[q]
        number = (p if patch.number is None else patch.number) - len(older.patches)
        seen = older.stamp_ns if patch.first_seen_ns is None else patch.first_seen_ns
        if own.number is None or number < own.number:
            patches[q] = replace(own, number=number)
        if own.first_seen_ns is None or seen < own.first_seen_ns:
            patches[q] = replace(patches[q], first_seen_ns=seen)
        placed = older.stamp_ns if patch.placed_ns is None else patch.placed_ns
        if not is_displaced(_footprint(patch), _footprint(own)) and (
            own.placed_ns is None or placed < own.placed_ns
        ):
            patches[q] = replace(patches[q], placed_ns=placed)
    before = len(older.patches)
    labels = {number - before: label for number, label in older.corrected_labels.items()}
    return replace(
        newer,
        patches=tuple(patches),
        forgotten=newer.forgotten + older.forgotten + before,
        corrected_labels={**labels, **newer.corrected_labels},
    )


def _footprint(patch: SurfacePatch) -> HorizontalOutline:
    return footprint_in_map(patch.outline, patch.mean, patch.spacing, np.eye(4))


def empty_view(stamp_ns: int, session: int, config: Config) -> View:
    """Return a view without patches and free intervals.

    Parameters
    ----------
    stamp_ns, session
        As in `View`.
    config
        Uses `views.cell_size`.
    """
    return View(stamp_ns, (), FreeColumns.of(None, config.views.cell_size), 0.0, session)


def with_cloud(view: View, cloud: SurfaceCloud, config: Config) -> View:
    """Return a view with the patches of a cloud.

    Parameters
    ----------
    view
        View of the same stamp; its patches are replaced.
    cloud
        The surfaces that the tilt cycle measured, in the base frame.
    config
        Uses `views.voxel_size` and `surfaces.merge_distance`.
    """
    order = np.argsort(cloud.surface, kind="stable")
    _, starts = np.unique(cloud.surface[order], return_index=True)
    groups = np.split(order, starts[1:]) if len(starts) else []
    patches = [
        patch
        for group in groups
        for patch in _make_patches(
            cloud.points[group], np.delete(cloud.points, group, 0), cloud.sensor, config
        )
    ]
    distance = np.hypot(cloud.points[:, 0], cloud.points[:, 1]).max(initial=0.0)
    max_range = max(view.max_range, float(distance))
    eye = None if cloud.viewpoint is None else cloud.viewpoint.astype(np.float64)
    if eye is not None:
        patches = [_with_systematic(patch, eye, cloud.sensor, config) for patch in patches]
    return replace(
        view, patches=tuple(patches), max_range=max_range, viewpoint=eye, sensor=cloud.sensor
    )


def _with_systematic(
    patch: SurfacePatch, eye: Float64, sensor: SensorKind, config: Config
) -> SurfacePatch:
    """Return a patch with the systematic error of its plane."""
    points, weights = patch.points.astype(np.float64), patch.weights.astype(np.float64)
    errors = systematic_errors(points, eye, sensor, config)
    return replace(patch, systematic=systematic_planes(points, weights, errors))


def with_intervals(view: View, intervals: ViewIntervals) -> View:
    """Return a view with the free intervals and the hits of the same stamp."""
    free = FreeColumns.of(intervals, view.free.cell_size)
    xy = intervals.intervals[:, :2].astype(np.float64)
    distance = np.hypot(xy[:, 0], xy[:, 1]).max(initial=-free.cell_size) + free.cell_size
    max_range = max(view.max_range, float(distance))
    return replace(view, free=free, max_range=max_range, hits=intervals.hits)


def with_objects(view: View, boxes: ObjectBoxes) -> View:
    """Return a view with the objects of the same stamp in place of its own."""
    seen = tuple(
        SeenObject(footprint, low, high, points)
        for footprint, (low, high), points in zip(
            boxes.footprints, boxes.z.tolist(), boxes.points.tolist(), strict=True
        )
    )
    return replace(view, objects=seen)


def with_detections(view: View, seen: Iterable[SeenDetection]) -> View:
    """Return a view with further detections."""
    return replace(view, detections=merge_detections((*view.detections, *seen)))


def with_newest(views: list[View], seen: Sequence[SeenDetection]) -> list[View]:
    """Return views with detections that are newer than all views added to the newest one."""
    return [*views[:-1], with_detections(views[-1], seen)] if seen and views else views
