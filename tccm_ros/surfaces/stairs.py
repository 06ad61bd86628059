"""Stairs among surfaces: treads in a row, each beside the next one and a rise below it."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from tccm_ros.config import Labels
from tccm_ros.surfaces.merged_patches import Draft

__all__ = ["box_sides", "treads"]

FLIGHT = 3
"""So many treads in a row are stairs."""

ALONG = 0.5
"""Treads lie along each other over this share of their length,"""

GOING = 0.5
"""their middles are no further apart than this, m,"""

OVER = 0.5
"""and they are not boards over each other: less than this share of the smaller one is shared."""


def box_sides(polygon: Polygon) -> NDArray[np.float64]:
    """Return the sides of a polygon's narrowest box, float64 (2,), m, the lesser first."""
    box = np.asarray(shapely.oriented_envelope(polygon).exterior.coords)
    return np.sort(np.hypot(*np.diff(box[:3], axis=0).T))


def treads(surfaces: list[Draft], rules: Labels) -> list[Draft]:
    """Return the surfaces that are treads of stairs, `FLIGHT` or more in a row.

    Parameters
    ----------
    surfaces
        All but the floor.
    rules
        Uses `stair_rise` and `wall_distance`.
    """
    order = sorted(surfaces, key=lambda draft: draft.height)
    pairs = [(i, j) for i in range(len(order)) for j in range(i + 1, len(order))]
    steps = [(i, j) for i, j in pairs if _is_next(order[i], order[j], rules)]
    below, above = np.zeros(len(order), np.int64), np.zeros(len(order), np.int64)
    for i, j in steps:  # the lower tread of a step has all that lie below it already
        below[j] = max(below[j], below[i] + 1)
    for i, j in reversed(steps):
        above[i] = max(above[i], above[j] + 1)
    return [draft for draft, n in zip(order, 1 + below + above) if n >= FLIGHT]


def _is_next(low: Draft, high: Draft, rules: Labels) -> bool:
    """Return whether one surface is the tread that follows another."""
    least, most = rules.stair_rise
    if not least <= high.height - low.height <= most:
        return False
    if np.linalg.norm(high.mean[:2] - low.mean[:2]) > GOING:
        return False
    a, b = low.polygon, high.polygon
    if a.intersection(b).area >= OVER * min(a.area, b.area):
        return False
    along = a.exterior.intersection(b.buffer(rules.wall_distance)).length
    return bool(along >= ALONG * max(box_sides(a)[1], box_sides(b)[1]))
