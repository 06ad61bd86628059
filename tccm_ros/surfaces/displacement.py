"""Whether two outlines are of one size, and whether a surface has moved from one to the other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely
from shapely.affinity import affine_transform
from shapely.geometry.base import BaseGeometry

from tccm_ros.arrays import Float64
from tccm_ros.surfaces.polygons import box_sides

BORDER = 0.03
"""Outlines of a surface that stands still are within this of each other, m. Chosen: they end within
1 or 2 cm of the true edges."""

MIN_WIDTH = 0.01
"""A surface has moved where it has left, and covers anew, a strip as long as it is wide and wider
than this beyond the border, m. Chosen: less is noise of edges."""

MEAN_WIDTH = 0.03
"""The two strips are wider than this in the mean, m. Chosen: with the border, a table that moved by
6 cm."""

MIN_LIFT = 0.025
"""The same for its height, m. Chosen: heights are known to 5 mm; 0.3 deg of roll and
pitch add 1 cm at 2 m."""

SIZE_DIFFERENCE = 0.12
"""Sides of two outlines of one surface differ by at most this, m. Chosen: two distances of scan
lines."""

SAME_AREA = 0.75
"""The smaller of two outlines of one surface has at least this fraction of the area of the larger.
Chosen: an L is no rectangle of its sides; a square of 0.4 m may lose 2.5 cm at each edge."""


class Footprint(NamedTuple):
    """An outline in map, and its height.

    Attributes
    ----------
    outline
        In x and y, m.
    z
        Height, m.
    """

    outline: BaseGeometry
    z: float

    @property
    def middle(self) -> Float64:
        """Middle of the narrowest box around it, float64 (3,), m."""
        center = shapely.oriented_envelope(self.outline).centroid
        return np.array([center.x, center.y, self.z])


def footprint_in_map(outline: BaseGeometry, mean: Float64, T_map_view: Float64) -> Footprint:
    """Return where a patch is in map.

    Parameters
    ----------
    outline, mean
        Of the patch, in its view; float64 (3,), m.
    T_map_view
        float64 (4, 4), pose of the view.
    """
    T = T_map_view
    shift = T[:2, 3] + T[:2, 2] * mean[2]
    matrix = [T[0, 0], T[0, 1], T[1, 0], T[1, 1], *shift]
    return Footprint(affine_transform(outline, matrix), float(T[2, :3] @ mean + T[2, 3]))


def is_of_one_size(first: Footprint, second: Footprint) -> bool:
    """Return whether two outlines can be those of one surface, wherever they are."""
    areas = sorted((first.outline.area, second.outline.area))
    if areas[0] < SAME_AREA * areas[1] or areas[1] == 0.0:
        return False
    sides = box_sides(first.outline) - box_sides(second.outline)
    return bool(np.abs(sides).max() <= SIZE_DIFFERENCE)


def is_displaced(first: Footprint, second: Footprint) -> bool:
    """Return whether a surface has left a place, and covers another one.

    One that grew, as more of it was seen, is not displaced; nor is one of which a part went.
    """
    if abs(second.z - first.z) > MIN_LIFT:
        return True
    left = first.outline.difference(second.outline.buffer(BORDER)).area
    came = second.outline.difference(first.outline.buffer(BORDER)).area
    width = np.sqrt(min(first.outline.area, second.outline.area))
    return bool(min(left, came) > MIN_WIDTH * width and left + came > 2.0 * MEAN_WIDTH * width)
