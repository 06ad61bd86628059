"""A merged surface in map, before it has an id and a label: plane, outline and moments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon
from shapely.affinity import affine_transform

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import transform
from tccm_ros.surfaces.hidden_places import HIDDEN_WIDTH, MIN_HIDDEN_AREA, is_hidden
from tccm_ros.surfaces.merging import Members, NumberedPatch, clouds_in_map
from tccm_ros.surfaces.outline import covered_area
from tccm_ros.surfaces.patch_planes import fit_plane, is_line, pool_moments
from tccm_ros.surfaces.polygons import GRID, close_gaps, largest_part, polygons_of
from tccm_ros.surfaces.views import View

__all__ = ["MergedSurface", "fit_surface"]


SIMPLIFY = 0.004
"""Outlines are simplified by this much, m: finer than the laser measures."""

SHADOW_WIDTH = 0.16
"""What stands on a surface hides strips of it: notches and holes up to this wide, m, are taken for
shadows and closed."""

LARGE_AREA = 4.0
"""Of surfaces larger than this, m2, no narrow parts are looked for between the scan lines of
several views: that is the floor, and its points are many."""

MAX_SPACING = 0.2
"""Gaps are closed up to the finest spacing of a surface's views, but never more than this, m."""


@dataclass(frozen=True, slots=True, eq=False)
class MergedSurface:
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

    @classmethod
    def of_moments(
        cls, members: Members, polygon: Polygon, count: float, mean: Float64, cov: Float64
    ) -> MergedSurface:
        """Return the surface whose plane is the least-squares one of these moments."""
        normal, _ = fit_plane(cov)
        return cls(members, polygon, mean, cov, normal, float(normal @ mean), int(count))

    @property
    def views(self) -> set[int]:
        """The views that saw any of it."""
        return {member.view for member in self.members}

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


def fit_surface(
    members: Members, views: list[View], T_map_view: Float64, config: Config
) -> MergedSurface | None:
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
    count, mean, cov = pool_moments(
        counts,
        np.einsum("kij,kj->ki", R, means) + T[:, :3, 3],
        np.einsum("kij,kjl,kml->kim", R, covs, R),
    )
    if is_line(cov):
        return None
    return MergedSurface.of_moments(members, polygon, count, mean, cov)


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
    if len(sparse) > 1 and union.area < LARGE_AREA:
        points = np.concatenate(clouds_in_map(sparse, T_map_view))
        together, _ = covered_area(points[:, :2], distance)
        union = shapely.union_all([union, together], grid_size=GRID)
    spacing = min(m.patch.spacing for m in members)
    closed = close_gaps(union, 0.505 * max(distance, SHADOW_WIDTH, min(spacing, MAX_SPACING)))
    whole = polygons_of(shapely.make_valid(closed.simplify(SIMPLIFY)))
    return largest_part(whole)


def _with_hidden_places(
    polygon: Polygon, members: Members, views: list[View], T_map_view: Float64, config: Config
) -> Polygon:
    """Close wide notches and holes of a surface that nothing was seen through."""
    closed = polygons_of(close_gaps(polygon, 0.5 * HIDDEN_WIDTH).simplify(SIMPLIFY))
    added = polygons_of(closed.difference(polygon))
    height = float(np.mean([_height(m, T_map_view) for m in members]))
    hidden = [
        part
        for part in added.geoms
        if part.area >= MIN_HIDDEN_AREA and is_hidden(part, height, views, T_map_view, config)
    ]
    if not hidden:
        return polygon
    # Parts touch the outline along its edge: a hair of overlap makes one polygon of them.
    grown = [part.buffer(1e-3, join_style="mitre") for part in hidden]
    union = shapely.union_all([polygon, *grown], grid_size=GRID)
    return largest_part(polygons_of(shapely.make_valid(union.simplify(SIMPLIFY))))


def _height(member: NumberedPatch, T_map_view: Float64) -> float:
    return float(transform(T_map_view[member.view], member.patch.mean[None])[0, 2])
