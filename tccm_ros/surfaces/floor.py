"""The floor: what heights are counted from, in as few pieces as there is evidence for."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from tccm_ros.config import Config
from tccm_ros.surfaces.joining import hidden_place, join, views_of
from tccm_ros.surfaces.merged_patches import Draft
from tccm_ros.surfaces.polygons import largest_part, polygons_of
from tccm_ros.surfaces.views import View

__all__ = ["find_floor", "is_floor", "join_floor"]

LEAST_AREA = 0.3
"""The floor is at least this large, m2."""

TOLERANCE = 0.06
"""A far floor, seen by a base that leans, is still floor within this height, m."""

TWICE = 0.1
"""Pieces that lie over each other with at least this much, m2, were measured at one place twice."""


def find_floor(drafts: list[Draft], config: Config) -> float | None:
    """Return the height of the floor in map, m; None where no floor was seen.

    The floor is the height at which most of the low surfaces' area lies, the lower one of two that
    are alike. The lowest surface would not do: reflections lie below the floor, and so does a far
    floor where the tilt zero is wrong.
    """
    low = [d for d in drafts if d.height <= config.surfaces.max_floor_height]
    low = [d for d in low if d.polygon.area >= LEAST_AREA]
    if not low:
        return None
    heights = np.array([d.height for d in low])
    areas = np.array([d.polygon.area for d in low])
    near = np.abs(heights[:, None] - heights) <= TOLERANCE
    support = near @ areas
    best = np.lexsort((heights, -support))[0]
    return float(np.average(heights[near[best]], weights=areas[near[best]]))


def is_floor(draft: Draft, floor_z: float | None) -> bool:
    """Return whether a surface is part of the floor."""
    return floor_z is not None and abs(draft.height - floor_z) <= TOLERANCE


def join_floor(
    drafts: list[Draft],
    floor_z: float | None,
    views: list[View],
    T_map_view: NDArray[np.float64],
    config: Config,
) -> list[Draft]:
    """Join pieces of the floor over what nobody could see, and what was measured twice.

    A sensor that bends the floor leaves steps where strips of it are missing: its pieces need not
    be level as furniture is, only within `TOLERANCE`, which made them floor; and a place is none
    only where a view looked deeper than that. No floor lies over another: where different views
    put it at different heights it is the same. Where pieces touch, a step between them stays a
    step.
    """
    floor = [d for d in drafts if is_floor(d, floor_z)]
    others = [d for d in drafts if not is_floor(d, floor_z)]

    def may_join(a: Draft, b: Draft, place: NDArray[np.float64]) -> bool:
        return abs(a.height_at(place) - b.height_at(place)) <= TOLERANCE

    def bridge(a: Draft, b: Draft) -> Polygon | None:
        twice = _measured_twice(a, b)
        return twice or hidden_place(a, b, may_join, views, T_map_view, config, TOLERANCE)

    return [*join(floor, bridge), *others]


def _measured_twice(a: Draft, b: Draft) -> Polygon | None:
    """Return the largest place that different views put at the heights of two pieces."""
    if not views_of(a).isdisjoint(views_of(b)) or not shapely.intersects(a.polygon, b.polygon):
        return None
    place = largest_part(polygons_of(a.polygon.intersection(b.polygon)))
    return place if place.area >= TWICE else None
