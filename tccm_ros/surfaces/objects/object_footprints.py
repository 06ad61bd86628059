"""Footprints of objects over views: without noise, and joined from all sides.

A view measures the sides of an object that face its sensor. The footprint of an object is the
convex hull of those of all views, without what a newer view looked through: an object that has
moved or shrunk does not grow.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import MultiPoint, Polygon

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import inverse, transform
from tccm_ros.sensors.noise import range_sigma
from tccm_ros.surfaces.views.views import View
from tccm_ros.tabletop.footprints import convex_hull

EXTREME = 2.0
"""Expected maximum of 30 Gaussian samples, in standard deviations: the outermost of the points on a
side of an object has about this error."""


def without_noise(
    footprint: Float64, height: float, view: View, T: Float64, config: Config
) -> Float64:
    """Return a footprint whose near side is not displaced towards the sensor by noise.

    Parameters
    ----------
    footprint
        float64 (H, 2), convex hull of noisy points, in map, m.
    height
        Height of their middle in map, m.
    view
        The view that measured them. Nothing is done if the position of its sensor is unknown.
    T
        float64 (4, 4), its pose in map.
    config
        Uses `sensors.depth_sigma`.
    """
    if view.viewpoint is None:
        return footprint
    beam = np.array([*footprint.mean(axis=0), height]) - _eye(view, T)
    along = beam[:2] / max(float(np.hypot(*beam[:2])), np.finfo(float).tiny)
    sigma = range_sigma(float(np.linalg.norm(beam)), view.sensor, config)
    shape, extent = Polygon(footprint), np.ptp(footprint @ along) * along
    lines = shapely.linestrings(np.stack([footprint - extent, footprint + extent], axis=1))
    depth = float(shapely.length(shapely.intersection(lines, shape)).max())
    moved = min(EXTREME * sigma, 0.5 * depth) * along
    return shapely.get_coordinates(shape & Polygon(footprint + moved))[:-1]


def joined_footprint(
    older: Sequence[Float64],
    newest: Float64,
    others: Sequence[Float64],
    height: float,
    view: View,
    T: Float64,
    spacing: float,
) -> Float64:
    """Return the hull of a footprint and of the older outlines that its view did not look through.

    Beams pass beside an object in its own columns of free space. Outlines behind the newest
    footprint, as seen from the sensor, are hidden by it and are kept. Outlines inside another
    object of the view belong to that one.

    Parameters
    ----------
    older
        float64 (H, 2) each, footprints of earlier views, in map, m.
    newest
        float64 (H, 2), that of the view.
    others
        float64 (H, 2) each, footprints of the view's other objects.
    height
        Height in map at which the view may have looked through the older outlines, m.
    view, T
        The view, and its pose in map, float64 (4, 4).
    spacing
        Max distance of the points of the older outlines, m.

    Returns
    -------
    float64 (H, 2), counter-clockwise
    """
    outline = shapely.segmentize(MultiPoint(np.concatenate(older)).convex_hull, spacing)
    ring = shapely.get_coordinates(outline)
    at_height = np.column_stack([ring, np.full(len(ring), height)])
    is_left = view.free.contains(transform(inverse(T), at_height))
    eye = _eye(view, T)[:2]
    away = (newest - eye) / np.linalg.norm(newest - eye, axis=1)[:, None]
    behind = MultiPoint(np.concatenate([newest, newest + view.max_range * away])).convex_hull
    is_left &= ~shapely.intersects_xy(behind, *ring.T)
    for other in others:
        is_left |= shapely.intersects_xy(Polygon(other), *ring.T)
    return convex_hull(np.concatenate([newest, ring[~is_left]]))


def _eye(view: View, T: Float64) -> Float64:
    """Return the position of a view's sensor in map, or that of the base if it is unknown."""
    return T[:3, 3] if view.viewpoint is None else transform(T, view.viewpoint[None])[0]
