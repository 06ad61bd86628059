"""Where a surface is expected to end, given how far the points on it reach.

The lines of a sweep run around the robot, one beyond the other. A surface's far edge lies somewhere
between the last line that hit it and the next; at its near edge lines still hit the front. Sideways
a line ends a beam or two before the edge: a beam that hits both sides of an edge tells of neither.
So an outline is moved away from the robot by much, and widened by little.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from tccm_ros.surfaces.polygons import GRID, polygons_of

__all__ = ["expected_area"]

SHARE = 0.35
"""The far edge is expected this share of the lines' distance beyond the last one: less than half,
as the union of several views takes the furthest edge of each."""

FURTHEST = 0.025
"""And no further than this, m."""

SIDEWAYS = 0.15
"""Sideways the edge is expected this share of the lines' distance beyond the last beam,"""

LEAST_SIDEWAYS, MOST_SIDEWAYS = 0.004, 0.0125
"""at least half of what beams are apart at arm's length, and at most this, m."""


def expected_area(area: MultiPolygon, spacing: float) -> MultiPolygon:
    """Move the far edges of an outline out to where they are expected.

    Parameters
    ----------
    area
        What the points of a view cover, m, in the base frame: the robot is at the origin.
    spacing
        Distance of the lines of the sweep there, m.

    Returns
    -------
    MultiPolygon
        One or more parts for each of `area`; parts may overlap.
    """
    reach = min(SHARE * spacing, FURTHEST)
    aside = min(max(SIDEWAYS * spacing, LEAST_SIDEWAYS), MOST_SIDEWAYS)
    swept = [_swept_away(part, reach) for part in area.geoms]
    wide = [part.buffer(aside, join_style="mitre", mitre_limit=2.0) for part in swept]
    return MultiPolygon([p for part in wide for p in polygons_of(part).geoms])


def _swept_away(part: shapely.Polygon, reach: float) -> shapely.Geometry:
    """Return what a polygon covers on its way away from the origin by `reach`, m."""
    moved = shapely.make_valid(shapely.transform(part, lambda xy: _away(xy, reach)))
    bands = []
    for ring in (part.exterior, *part.interiors):
        start = np.asarray(ring.coords)
        end = _away(start, reach)
        bands.append(np.stack([start[:-1], start[1:], end[1:], end[:-1]], axis=1))
    quads = shapely.make_valid(shapely.polygons(np.concatenate(bands)))
    return shapely.union_all([part, moved, *quads], grid_size=GRID)


def _away(xy: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
    """Move points (N, 2) away from the origin by `reach`, m."""
    distance = np.maximum(np.hypot(xy[:, 0], xy[:, 1]), GRID)
    return np.asarray(xy * (1.0 + reach / distance)[:, None], np.float64)
