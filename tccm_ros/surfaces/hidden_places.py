"""Places on a surface that nobody could see: no view looked through them.

What stands on a surface hides more of it than its own width, and a sensor may leave out strips.
A notch, a hole, or the place between two pieces is taken for surface where no view looked through.
"""

from __future__ import annotations

import numpy as np
import shapely
from shapely import Polygon

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import inverse, transform
from tccm_ros.surfaces.views import View

__all__ = ["HIDDEN_WIDTH", "MIN_HIDDEN_AREA", "is_hidden"]


HIDDEN_WIDTH = 0.5
"""Notches, holes and places between pieces up to this wide (m) may be hidden; wider ones are not
taken for surface."""

MAX_SEEN_FRACTION = 0.15
"""So much of a hidden place may count as looked through: columns stand out over edges."""

PROBE_SPACING = 0.04
"""Places are probed at points this far apart, m,"""

MIN_HIDDEN_AREA = PROBE_SPACING**2
"""and smaller ones (m2) are none."""


def is_hidden(
    place: Polygon, height: float, views: list[View], T_map_view: Float64, config: Config
) -> bool:
    """Return whether no view looked through a place at a height, but for its rim."""
    points = _probes(place, height)
    if len(points) == 0:
        return False
    through = np.zeros(len(points), bool)
    for view, T_map in zip(views, T_map_view):
        local = transform(inverse(T_map), points)
        if np.hypot(local[:, 0], local[:, 1]).min() <= view.reach:
            margin = np.full(len(points), config.views.clear_margin)
            through |= view.free.contains(local, margin)
    return bool(through.mean() <= MAX_SEEN_FRACTION)


def _probes(place: Polygon, height: float) -> Float64:
    """Return points (N, 3) all over a polygon, at a height."""
    x_min, y_min, x_max, y_max = place.bounds
    half = 0.5 * PROBE_SPACING
    x = np.arange(x_min + half, x_max, PROBE_SPACING)
    y = np.arange(y_min + half, y_max, PROBE_SPACING)
    xy = np.stack([axis.ravel() for axis in np.meshgrid(x, y)], axis=1)
    xy = xy[shapely.contains_xy(place, xy[:, 0], xy[:, 1])]
    return np.column_stack([xy, np.full(len(xy), height)])
