"""Surfaces before they have a name: merged patches with their plane, outline and moments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.affinity import affine_transform

from tccm_ros.config import Config
from tccm_ros.geometry import inverse, transform
from tccm_ros.surfaces.carving import Survivors
from tccm_ros.surfaces.contact import box_pairs, connect, patch_boxes
from tccm_ros.surfaces.outline import covered_area, horizontal_outline
from tccm_ros.surfaces.patch_planes import fit_plane, is_line, pool_moments, stack_planes
from tccm_ros.surfaces.polygons import GRID, close_gaps, largest_part, polygons_of
from tccm_ros.surfaces.views import Patch, View, first_numbers

__all__ = [
    "HIDDEN",
    "PROBE",
    "Draft",
    "Members",
    "PlacedPatch",
    "draft_surface",
    "is_hidden",
    "merge",
    "surviving_patches",
]

Float64 = NDArray[np.float64]

SIMPLIFY = 0.004
"""Outlines are simplified by this much, m: finer than the laser measures."""

SHADOW = 0.16
"""What stands on a surface hides strips of it: notches and holes up to this wide, m, are taken for
shadows and closed."""

HIDDEN = 0.5
"""Wider notches and holes, up to this (m), are closed where no view looked through them: things
that stand on a surface hide more of it than their own width."""

HIDDEN_SHARE = 0.15
"""So much of a hidden place may count as looked through: columns stand out over edges."""

PROBE = 0.04
"""Places are probed this far apart, m."""

LARGE = 4.0
"""Of surfaces larger than this, m2, no narrow parts are looked for between the lines of several
views: that is the floor, and its points are many."""

MOST_SPACING = 0.2
"""Gaps are closed up to the finest spacing of a surface's views, but never more than this, m."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacedPatch:
    """What is left of a patch.

    Attributes
    ----------
    number
        Of the patch, counted over all views in stamp order.
    view
        Index of its view.
    patch
        In the frame of the view.
    """

    number: int
    view: int
    patch: Patch


Members = tuple[PlacedPatch, ...]
"""Patches that are one surface, in the order of their numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class Draft:
    """A surface in map, without id and label.

    Attributes
    ----------
    members
        Its patches.
    polygon
        Outline in x and y of map.
    mean, cov
        float64 (3,) and (3, 3), moments of the points measured, in map.
    normal, offset
        ``normal . p = offset``, up.
    count
        Points measured.
    """

    members: Members
    polygon: Polygon
    mean: Float64
    cov: Float64
    normal: Float64
    offset: float
    count: int

    @property
    def height(self) -> float:
        """Height z at the centroid, m."""
        return float(self.mean[2])

    def lift(self, points_xy: Float64) -> Float64:
        """Put points (N, 2) of map onto the plane: float64 (N, 3)."""
        z = (self.offset - points_xy @ self.normal[:2]) / self.normal[2]
        return np.column_stack([points_xy, z])

    def height_at(self, place: Float64) -> float:
        """Return the height of the plane at a place (x, y), m."""
        return float(self.lift(place[None])[0, 2])


def surviving_patches(views: list[View], left: Survivors, config: Config) -> list[PlacedPatch]:
    """Return the patches of which anything is left."""
    placed = []
    for v, (first, view) in enumerate(zip(first_numbers(views), views)):
        for p, patch in enumerate(view.patches):
            rest = _rest(patch, left.keep[v][p], config)
            if rest is not None:
                placed.append(PlacedPatch(first + p, v, rest))
    return placed


def _rest(patch: Patch, keep: NDArray[np.bool_], config: Config) -> Patch | None:
    """Return the part of a patch that is left, with its moments and outline; None: nothing."""
    if keep.all():
        return patch
    if not keep.any():
        return None
    points, weights = patch.points[keep], patch.weights[keep]
    exact, share = points.astype(np.float64), weights / weights.sum()
    mean = share @ exact
    cov = (exact - mean).T @ ((exact - mean) * share[:, None])
    outline, spacing = horizontal_outline(exact[:, :2], config.surfaces.merge_distance)
    return Patch(points, weights, int(weights.sum()), mean, cov, outline, spacing)


def merge(
    placed: list[PlacedPatch], T_map_view: Float64, cov_tilt: Float64, config: Config
) -> list[Members]:
    """Merge patches that touch and are coplanar.

    Parameters
    ----------
    placed
        Patches in the order of their numbers.
    T_map_view, cov_tilt
        float64 (V, 4, 4) and (V, 3, 3) of (z, roll, pitch), poses of the views.
    config
        Uses `surfaces.merge_distance` and `surfaces.max_step`.
    """
    if not placed:
        return []
    clouds = [transform(T_map_view[p.view], p.patch.points) for p in placed]
    offsets = np.cumsum([0] + [len(cloud) for cloud in clouds])
    points = np.concatenate(clouds)
    boxes = patch_boxes(points, offsets)
    pairs = box_pairs(boxes, config.surfaces.merge_distance)
    view = np.array([p.view for p in placed])
    planes = stack_planes([p.patch for p in placed], view, T_map_view, cov_tilt)
    limits = config.surfaces
    root = connect(points, offsets, boxes, pairs, limits.merge_distance, planes, limits.max_step)
    return [tuple(placed[k] for k in np.flatnonzero(root == r)) for r in np.unique(root).tolist()]


def draft_surface(
    members: Members, views: list[View], T_map_view: Float64, config: Config
) -> Draft | None:
    """Fit the plane and draw the outline of a merged surface; None where it has no area.

    Points on a line have none either, whatever the outline of their noise is.
    """
    polygon = _merged_outline(members, T_map_view, config.surfaces.merge_distance)
    if polygon.is_empty:
        return None
    polygon = _with_hidden_places(polygon, members, views, T_map_view, config)
    T = np.stack([T_map_view[m.view] for m in members])
    R = T[:, :3, :3]
    means = np.stack([m.patch.mean for m in members])
    covs = np.stack([m.patch.cov for m in members])
    counts = np.array([float(m.patch.count) for m in members])
    total, mean, cov = pool_moments(
        counts,
        np.einsum("kij,kj->ki", R, means) + T[:, :3, 3],
        np.einsum("kij,kjl,kml->kim", R, covs, R),
    )
    if is_line(cov):
        return None
    normal, _ = fit_plane(cov)
    return Draft(members, polygon, mean, cov, normal, float(normal @ mean), int(total))


def _merged_outline(members: Members, T_map_view: Float64, distance: float) -> Polygon:
    """Unite the outlines of patches; gaps of `distance` between them are closed.

    Where lines are far apart, those of one view lie between those of another: what the points of
    such views cover together is more than what each view's do.
    """
    parts = []
    for member in members:
        T = T_map_view[member.view]
        shift = T[:2, 3] + T[:2, 2] * member.patch.mean[2]
        matrix = [T[0, 0], T[0, 1], T[1, 0], T[1, 1], *shift]
        parts.append(affine_transform(member.patch.outline, matrix))
    union = shapely.union_all(parts, grid_size=GRID)
    sparse = [m for m in members if not 0.0 < m.patch.spacing < distance]
    if len(sparse) > 1 and union.area < LARGE:
        clouds = [transform(T_map_view[m.view], m.patch.points) for m in sparse]
        together, _ = covered_area(np.concatenate(clouds)[:, :2], distance)
        union = shapely.union_all([union, together], grid_size=GRID)
    spacing = min(m.patch.spacing for m in members)
    closed = close_gaps(union, 0.505 * max(distance, SHADOW, min(spacing, MOST_SPACING)))
    whole = polygons_of(shapely.make_valid(closed.simplify(SIMPLIFY)))
    return largest_part(whole)


def _with_hidden_places(
    polygon: Polygon, members: Members, views: list[View], T_map_view: Float64, config: Config
) -> Polygon:
    """Close wide notches and holes of a surface that nothing was seen through."""
    closed = polygons_of(close_gaps(polygon, 0.5 * HIDDEN).simplify(SIMPLIFY))
    added = polygons_of(closed.difference(polygon))
    height = float(np.mean([_height(m, T_map_view) for m in members]))
    hidden = [
        part
        for part in added.geoms
        if part.area >= PROBE**2 and is_hidden(part, height, views, T_map_view, config)
    ]
    if not hidden:
        return polygon
    # Parts touch the outline along its edge: a hair of overlap makes one polygon of them.
    grown = [part.buffer(1e-3, join_style="mitre") for part in hidden]
    union = shapely.union_all([polygon, *grown], grid_size=GRID)
    return largest_part(polygons_of(shapely.make_valid(union.simplify(SIMPLIFY))))


def _height(member: PlacedPatch, T_map_view: Float64) -> float:
    return float(transform(T_map_view[member.view], member.patch.mean[None])[0, 2])


def is_hidden(
    part: Polygon, height: float, views: list[View], T_map_view: Float64, config: Config
) -> bool:
    """Tell whether no view looked through a place at a height, but for its rim."""
    points = _probes(part, height)
    if len(points) == 0:
        return False
    through = np.zeros(len(points), bool)
    for view, T_map in zip(views, T_map_view):
        local = transform(inverse(T_map), points)
        if np.hypot(local[:, 0], local[:, 1]).min() <= view.reach:
            margin = np.full(len(points), config.views.clear_margin)
            through |= view.free.contains(local, margin)
    return bool(through.mean() <= HIDDEN_SHARE)


def _probes(part: Polygon, height: float) -> Float64:
    """Return points (N, 3) all over a polygon, at a height."""
    x_min, y_min, x_max, y_max = part.bounds
    grid = np.meshgrid(
        np.arange(x_min + 0.5 * PROBE, x_max, PROBE), np.arange(y_min + 0.5 * PROBE, y_max, PROBE)
    )
    xy = np.stack([axis.ravel() for axis in grid], axis=1)
    xy = xy[shapely.contains_xy(part, xy[:, 0], xy[:, 1])]
    return np.column_stack([xy, np.full(len(xy), height)])
