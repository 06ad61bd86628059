"""Occluded areas: gaps in surfaces that no view looked through.

An object on a surface hides more of it than its own width, and a sensor may leave out strips. A
notch, a hole, or the gap between two pieces is taken for surface where no view looked through it.
"""

from __future__ import annotations

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import inverse, transform
from tccm_ros.surfaces.views import View

MAX_OCCLUDED_WIDTH = 0.5
"""Widest notch, hole or gap between pieces that may be occluded, m; chosen: an appliance on a
worktop and its shadow. Wider ones are not taken for surface."""

MAX_SEEN_FRACTION = 0.15
"""Fraction of an occluded area that may count as looked through: columns extend over its edges;
chosen."""

PROBE_SPACING = 0.04
"""Distance between the points at which an area is probed, m; chosen: below half a column."""

MIN_OCCLUDED_AREA = PROBE_SPACING**2
"""Areas smaller than one probe's square, m2, are not closed: no probe need be in them. Chosen."""


def is_occluded(
    area: Polygon, height: float, views: list[View], T_map_view: Float64, config: Config
) -> bool:
    """Return whether no view looked through an area, except near its edges.

    Parameters
    ----------
    area
        In x and y of map, m.
    height
        At which it is probed, m in map.
    views, T_map_view
        V views, and float64 (V, 4, 4).
    config
        Uses `views.clear_margin`.
    """
    points = _probes(area, height)
    if len(points) == 0:
        return False
    through = np.zeros(len(points), bool)
    for view, T_map in zip(views, T_map_view):
        local = transform(inverse(T_map), points)
        if np.hypot(local[:, 0], local[:, 1]).min() <= view.max_range:
            margin = np.full(len(points), config.views.clear_margin)
            through |= view.free.contains(local, margin)
    return bool(through.mean() <= MAX_SEEN_FRACTION)


def _probes(area: Polygon, height: float) -> Float64:
    """Return points (N, 3) all over a polygon, at a height."""
    x_min, y_min, x_max, y_max = area.bounds
    half = 0.5 * PROBE_SPACING
    x = np.arange(x_min + half, x_max, PROBE_SPACING)
    y = np.arange(y_min + half, y_max, PROBE_SPACING)
    xy = np.stack([axis.ravel() for axis in np.meshgrid(x, y)], axis=1)
    xy = xy[shapely.contains_xy(area, xy[:, 0], xy[:, 1])]
    return np.column_stack([xy, np.full(len(xy), height)])
