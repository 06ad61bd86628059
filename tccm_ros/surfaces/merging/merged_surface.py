"""A merged surface in map: plane, outline and moments of its patches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import transform
from tccm_ros.outlines.shape_models import HIDDEN_WIDTH, PROBE
from tccm_ros.outlines.transformation import transform_outline
from tccm_ros.surfaces.merging.merging import Members, NumberedPatch
from tccm_ros.surfaces.merging.occluded_areas import is_occluded
from tccm_ros.surfaces.merging.patch_planes import fit_plane, is_line, pool_moments
from tccm_ros.surfaces.polygons import GRID, close_gaps, largest_part, polygons_of, union_over
from tccm_ros.surfaces.views.views import View

SIMPLIFY = 0.004
"""Tolerance of the simplification of outlines, m; chosen: below the range noise."""

SHADOW_WIDTH = 0.16
"""Max width of notches and holes that are closed as shadows of objects on the surface, m;
chosen."""

FEW_POINTS, SPARSE = 50, 0.6
"""A surface of fewer points than this is sparse if their spacing exceeds this fraction of the edge
of a square of its area. Chosen: two scan lines of 25 beams, and less than two lines across. Tops of
a few small objects are sparse, surfaces are not (docs/design/experiments)."""


@dataclass(frozen=True, slots=True, eq=False)
class MergedSurface:
    """A surface in map, without id and label.

    Attributes
    ----------
    members
        Its patches.
    polygon
        Outline in x and y of map, m.
    mean, cov
        float64 (3,), m, and (3, 3), m2: moments of the measured points, in map.
    normal, offset
        float64 (3,), unit, up, and m: the plane, ``normal . p = offset``.
    count
        Number of measured points.
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
        """Return the surface with the least-squares plane of the moments.

        Parameters
        ----------
        members, polygon
            As the attributes.
        count, mean, cov
            Moments of the measured points: float, float64 (3,) and (3, 3), in map.
        """
        normal, _ = fit_plane(cov)
        return cls(members, polygon, mean, cov, normal, float(normal @ mean), int(count))

    @property
    def views(self) -> set[int]:
        """Indices of the views that measured a part of it."""
        return {member.view for member in self.members}

    @property
    def is_line(self) -> bool:
        """Whether its points are on a line, so that it has no area."""
        return is_line(self.cov)

    @property
    def has_area(self) -> bool:
        """Whether it is neither a line nor sparse."""
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
    """Compute plane, outline and moments of a merged surface; None if it has no outline.

    Parameters
    ----------
    members
        Patches of the surface.
    views, T_map_view
        V views, and their poses, float64 (V, 4, 4).
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
    """Return whether a surface consists of a few distant points, such as tops of objects.

    Parameters
    ----------
    members
        Patches of the surface.
    area
        Area of their outline, m2.
    """
    count = sum(member.patch.count for member in members)
    spacing = min(member.patch.spacing for member in members)
    return count < FEW_POINTS and spacing > SPARSE * np.sqrt(area)


def _merged_outline(members: Members, T_map_view: Float64, distance: float) -> Polygon:
    """Return the union of the outlines of patches, with gaps of up to `distance`, m, closed."""
    parts = [
        transform_outline(T_map_view[m.view], m.patch.outline, float(m.patch.mean[2]))
        for m in members
    ]
    union = shapely.union_all(parts, grid_size=GRID)
    closed = close_gaps(union, 0.5 * max(distance, SHADOW_WIDTH))
    whole = polygons_of(shapely.make_valid(closed.simplify(SIMPLIFY)))
    return largest_part(whole)


def _with_occluded_areas(
    polygon: Polygon, members: Members, views: list[View], T_map_view: Float64, config: Config
) -> Polygon:
    """Close occluded wide notches and holes of a surface."""
    closed = polygons_of(close_gaps(polygon, 0.5 * HIDDEN_WIDTH).simplify(SIMPLIFY))
    added = polygons_of(closed.difference(polygon))
    height = float(np.mean([_height(m, T_map_view) for m in members]))
    hidden = [
        part
        for part in added.geoms
        if part.area >= PROBE**2 and is_occluded(part, height, views, T_map_view, config)
    ]
    if not hidden:
        return polygon
    whole = union_over([polygon], hidden).simplify(SIMPLIFY)
    return largest_part(polygons_of(shapely.make_valid(whole)))


def _height(member: NumberedPatch, T_map_view: Float64) -> float:
    return float(transform(T_map_view[member.view], member.patch.mean[None])[0, 2])
