"""A merged surface in map: the plane, outline and moments of patches that are one surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon
from shapely.affinity import affine_transform

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import transform
from tccm_ros.surfaces.merging import Members, NumberedPatch, clouds_in_map
from tccm_ros.surfaces.occluded_areas import MAX_OCCLUDED_WIDTH, MIN_OCCLUDED_AREA, is_occluded
from tccm_ros.surfaces.outline import covered_area
from tccm_ros.surfaces.patch_planes import fit_plane, is_line, pool_moments
from tccm_ros.surfaces.polygons import GRID, close_gaps, largest_part, polygons_of
from tccm_ros.surfaces.views import View

SIMPLIFY = 0.004
"""Outlines are simplified by at most this, m; chosen: below the noise of a range."""

SHADOW_WIDTH = 0.16
"""Notches and holes up to this wide, m, are closed as shadows of objects on the surface; chosen."""

LARGE_AREA = 4.0
"""Above this area, m2, the scan lines of several views are not outlined together: such a surface is
the floor, and that would take long; chosen."""

MAX_SPACING = 0.2
"""Gaps are closed up to the finest spacing of a surface's views, but at most this, m; chosen."""

CLOSING = 0.505
"""Outlines are grown and shrunk by this fraction of a gap's width to close it. Chosen: half, and
a margin of 1 % for rounding."""

FEW_POINTS, SPARSE = 50, 0.6
"""Fewer points than this that are further from each other than this fraction of the edge of a
square of their area have no outline. Chosen: two scan lines of 25 beams; and less than two lines
across. Tops of a few small objects are such points, surfaces are not (docs/design/experiments)."""

OVERLAP = 1e-3
"""Occluded areas are grown by this, m, so that they overlap the outline that they touch. Chosen:
more than rounding of coordinates."""


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
        """Return the surface with the least-squares plane of moments.

        Parameters
        ----------
        members, polygon
            As the attributes.
        count, mean, cov
            Moments of the points measured: float, float64 (3,) and (3, 3), in map.
        """
        normal, _ = fit_plane(cov)
        return cls(members, polygon, mean, cov, normal, float(normal @ mean), int(count))

    @property
    def views(self) -> set[int]:
        """Indices of the views that saw any of it."""
        return {member.view for member in self.members}

    @property
    def is_line(self) -> bool:
        """Whether its points are on a line, which has no area whatever their noise is."""
        return is_line(self.cov)

    @property
    def has_area(self) -> bool:
        """Whether it is more than a line, and than a few points far from each other."""
        return not self.is_line and not is_sparse(self.members, self.polygon.area)

    @property
    def height(self) -> float:
        """Height z at the centroid, m."""
        return float(self.mean[2])

    def lift(self, points_xy: Float64) -> Float64:
        """Return points (N, 2) of map on the plane, float64 (N, 3)."""
        z = (self.offset - points_xy @ self.normal[:2]) / self.normal[2]
        return np.column_stack([points_xy, z])

    def height_at(self, at_xy: Float64) -> float:
        """Return the height of the plane, m, at a position, float64 (2,)."""
        return float(self.lift(at_xy[None])[0, 2])


def fit_surface(
    members: Members, views: list[View], T_map_view: Float64, config: Config
) -> MergedSurface | None:
    """Compute plane, outline and moments of a merged surface; None where it has no outline.

    Parameters
    ----------
    members
        Patches that are one surface.
    views, T_map_view
        V views, and float64 (V, 4, 4).
    config
        Uses `surfaces.merge_distance` and `views.clear_margin`.
    """
    polygon = _merged_outline(members, T_map_view, config.surfaces.merge_distance)
    if polygon.is_empty:
        return None
    polygon = _with_occluded_areas(polygon, members, views, T_map_view, config)
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
    return MergedSurface.of_moments(members, polygon, count, mean, cov)


def is_sparse(members: Members, area: float) -> bool:
    """Return whether an outline is that of a few points far from each other: tops of objects.

    Parameters
    ----------
    members
        Patches that are one surface.
    area
        Of their outline, m2.
    """
    count = sum(member.patch.count for member in members)
    spacing = min(member.patch.spacing for member in members)
    return count < FEW_POINTS and spacing > SPARSE * np.sqrt(area)


def _merged_outline(members: Members, T_map_view: Float64, distance: float) -> Polygon:
    """Return the union of the outlines of patches, with gaps of up to `distance`, m, closed.

    Where a view has sparse scan lines, lines of another view are between them: the points of such
    views together cover more than the points of each view alone.
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
    closed = close_gaps(union, CLOSING * max(distance, SHADOW_WIDTH, min(spacing, MAX_SPACING)))
    whole = polygons_of(shapely.make_valid(closed.simplify(SIMPLIFY)))
    return largest_part(whole)


def _with_occluded_areas(
    polygon: Polygon, members: Members, views: list[View], T_map_view: Float64, config: Config
) -> Polygon:
    """Close wide notches and holes of a surface that no view looked through."""
    closed = polygons_of(close_gaps(polygon, 0.5 * MAX_OCCLUDED_WIDTH).simplify(SIMPLIFY))
    added = polygons_of(closed.difference(polygon))
    height = float(np.mean([_height(m, T_map_view) for m in members]))
    hidden = [
        part
        for part in added.geoms
        if part.area >= MIN_OCCLUDED_AREA and is_occluded(part, height, views, T_map_view, config)
    ]
    if not hidden:
        return polygon
    # Parts touch the outline along its edge alone: overlap makes one polygon of them.
    grown = [part.buffer(OVERLAP, join_style="mitre") for part in hidden]
    union = shapely.union_all([polygon, *grown], grid_size=GRID)
    return largest_part(polygons_of(shapely.make_valid(union.simplify(SIMPLIFY))))


def _height(member: NumberedPatch, T_map_view: Float64) -> float:
    return float(transform(T_map_view[member.view], member.patch.mean[None])[0, 2])
