"""Occluded areas: gaps in surfaces that no view looked through.

An object on a surface occludes an area wider than itself, and a sensor may leave out strips. A
notch, a hole, or the gap between two pieces counts as surface if no view looked through it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.arrays import Bool, Float64
from tccm_ros.config import Config
from tccm_ros.geometry import inverse, transform
from tccm_ros.outlines.shape_models import PROBE
from tccm_ros.robust import MAJORITY
from tccm_ros.surfaces.views.views import View

EDGE_FRACTION = 0.15
"""Fraction of an area that the errors of its edges may be; chosen. Free columns extend over the
edges of an occluded area, and a patch that lost more of its points may show an earlier place."""


def is_occluded(
    area: Polygon, height: float, views: Sequence[View], T_map_view: Float64, config: Config
) -> bool:
    """Return whether no view looked through an area, except near its edges.

    Parameters
    ----------
    area
        Area in x and y of map, m.
    height
        Height of the probes in map, m.
    views, T_map_view
        V views, and their poses, float64 (V, 4, 4).
    config
        Uses `views.clear_margin`.
    """
    points = probes(area, height)
    if len(points) == 0:
        return False
    through = looked_through(points, views, T_map_view, config)
    return bool(through.mean() <= EDGE_FRACTION)


def last_empty_view(
    area: Polygon, height: float, views: Sequence[View], T_map_view: Float64, config: Config
) -> int:
    """Return the index of the last view that looked through most of an area; -1: none did.

    Parameters
    ----------
    area, height, views, T_map_view, config
        As in `is_occluded`.
    """
    points = probes(area, height)
    for v in reversed(range(len(views)) if len(points) else ()):
        seen = looked_through(points, views[v : v + 1], T_map_view[v : v + 1], config)
        if seen.mean() > MAJORITY:
            return v
    return -1


def looked_through(
    points: Float64, views: Sequence[View], T_map_view: Float64, config: Config
) -> Bool:
    """Return whether any view looked through each point (N > 0, 3) in map, bool (N,).

    The other parameters are those of `is_occluded`.
    """
    through = np.zeros(len(points), np.bool_)
    for view, T in zip(views, T_map_view):
        local = transform(inverse(T), points)
        if np.hypot(local[:, 0], local[:, 1]).min() <= view.max_range:
            through |= view.free.contains(local, config.views.clear_margin)
    return through


def probes(area: Polygon, height: float) -> Float64:
    """Return a grid of points (N, 3) inside a polygon, at a height."""
    x_min, y_min, x_max, y_max = area.bounds
    half = 0.5 * PROBE
    x = np.arange(x_min + half, x_max, PROBE)
    y = np.arange(y_min + half, y_max, PROBE)
    xy = np.stack([axis.ravel() for axis in np.meshgrid(x, y)], axis=1)
    xy = xy[shapely.contains_xy(area, xy[:, 0], xy[:, 1])]
    return np.column_stack([xy, np.full(len(xy), height)])
