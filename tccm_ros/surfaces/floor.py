"""The floor: what heights are counted from, in as few pieces as there is evidence for."""

from __future__ import annotations

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.surfaces.joining import hidden_place_between, join
from tccm_ros.surfaces.merged_surface import MergedSurface
from tccm_ros.surfaces.polygons import largest_part, polygons_of
from tccm_ros.surfaces.views import View

__all__ = ["find_floor", "is_floor", "join_floor"]

MIN_AREA = 0.3
"""The floor is at least this large, m2."""

TOLERANCE = 0.06
"""A far floor, seen by a base that rolls and pitches, is still floor within this height, m."""

MIN_OVERLAP = 0.1
"""Pieces that overlap by at least this much, m2, were measured at one place twice."""


def find_floor(surfaces: list[MergedSurface], config: Config) -> float | None:
    """Return the height of the floor in map, m; None where no floor was seen.

    The floor is the height at which most of the low surfaces' area lies, the lower one of two that
    are alike. The lowest surface would not do: reflections lie below the floor, and so does a far
    floor where the tilt zero is wrong.
    """
    low = [s for s in surfaces if s.height <= config.surfaces.max_floor_height]
    low = [s for s in low if s.polygon.area >= MIN_AREA]
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
    """Join pieces of the floor over what nobody could see, and what was measured twice.

    A sensor that bends the floor leaves steps where strips of it are missing: its pieces need not
    be coplanar as furniture is, only within `TOLERANCE`, which made them floor; and a place is none
    only where a view looked deeper than that. No floor lies over another: where different views
    put it at different heights it is the same. Where pieces touch, a step between them stays a
    step.
    """
    floor = [s for s in surfaces if is_floor(s, floor_z)]
    others = [s for s in surfaces if not is_floor(s, floor_z)]

    def may_join(a: MergedSurface, b: MergedSurface, place: Float64) -> bool:
        return abs(a.height_at(place) - b.height_at(place)) <= TOLERANCE

    def between(a: MergedSurface, b: MergedSurface) -> Polygon | None:
        overlap = _overlap(a, b)
        return overlap or hidden_place_between(a, b, may_join, views, T_map_view, config, TOLERANCE)

    return [*join(floor, between), *others]


def _overlap(a: MergedSurface, b: MergedSurface) -> Polygon | None:
    """Return the largest place that different views put at the heights of two pieces."""
    if not a.views.isdisjoint(b.views) or not shapely.intersects(a.polygon, b.polygon):
        return None
    place = largest_part(polygons_of(a.polygon.intersection(b.polygon)))
    return place if place.area >= MIN_OVERLAP else None
