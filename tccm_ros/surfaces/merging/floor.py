"""The floor: its height, its surfaces, and the joining of its pieces."""

from __future__ import annotations

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.surfaces.merging.carving import MIN_RECOGNISED_AREA
from tccm_ros.surfaces.merging.joining import are_beside, join, occluded_area_between
from tccm_ros.surfaces.merging.merged_surface import MergedSurface
from tccm_ros.surfaces.polygons import largest_part, polygons_of
from tccm_ros.surfaces.views.views import View

TOLERANCE = 0.06
"""Max difference in height of surfaces of the floor, m; chosen: 0.7 deg of tilt at 5 m."""


def find_floor(surfaces: list[MergedSurface], config: Config) -> float | None:
    """Return the height of the floor in map, m; None if no floor was seen.

    The height with the largest supporting area among the low surfaces is that of the floor; of two
    heights with equal support, the lower one. The lowest surface need not be the floor: reflections
    are below it, and so are far parts of it if the tilt zero is wrong.
    """
    low = [s for s in surfaces if s.height <= config.surfaces.max_floor_height]
    low = [s for s in low if s.polygon.area >= MIN_RECOGNISED_AREA]
    if not low:
        return None
    heights = np.array([s.height for s in low])
    areas = np.array([s.polygon.area for s in low])
    near = np.abs(heights[:, None] - heights) <= TOLERANCE
    support = near @ areas
    best = np.lexsort((heights, -support))[0]
    return float(np.average(heights[near[best]], weights=areas[near[best]]))


def is_floor(surface: MergedSurface, floor_z: float | None) -> bool:
    """Return whether a surface is part of the floor."""
    return floor_z is not None and abs(surface.height - floor_z) <= TOLERANCE


def join_floor(
    surfaces: list[MergedSurface],
    floor_z: float | None,
    views: list[View],
    T_map_view: Float64,
    config: Config,
) -> list[MergedSurface]:
    """Join pieces of the floor over occluded areas, and pieces of different views that overlap.

    Sensor errors bend the floor and leave steps at missing strips. So pieces of the floor need not
    be coplanar like those of furniture: their heights may differ by `TOLERANCE`, and a view must
    look deeper than that between them to separate them. Overlapping pieces of different views are
    one floor at any heights. Pieces that touch are not joined: a step between them stays.

    Parameters
    ----------
    surfaces
        All surfaces of the map.
    floor_z
        Height of the floor, m; None: unknown, and nothing is joined.
    views, T_map_view
        V views, and their poses, float64 (V, 4, 4).
    config
        Uses `views.clear_margin`.

    Returns
    -------
    The joined surfaces of the floor, followed by the other surfaces, unchanged.
    """
    floor = [s for s in surfaces if is_floor(s, floor_z)]
    others = [s for s in surfaces if not is_floor(s, floor_z)]

    def is_coplanar(a: MergedSurface, b: MergedSurface, at_xy: Float64) -> bool:
        return abs(a.height_at(at_xy) - b.height_at(at_xy)) <= TOLERANCE

    def between(a: MergedSurface, b: MergedSurface) -> Polygon | None:
        overlap = _overlap(a, b)
        if overlap is not None or not are_beside(a, b, is_coplanar, config):
            return overlap
        return occluded_area_between(a, b, views, T_map_view, config, TOLERANCE)

    return [*join(floor, between), *others]


def _overlap(a: MergedSurface, b: MergedSurface) -> Polygon | None:
    """Return the largest overlap of two pieces of different views; None: too small or none."""
    if not a.views.isdisjoint(b.views) or not shapely.intersects(a.polygon, b.polygon):
        return None
    shared = largest_part(polygons_of(a.polygon.intersection(b.polygon)))
    return shared if shared.area >= MIN_RECOGNISED_AREA else None
