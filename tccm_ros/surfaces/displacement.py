"""Tests whether two outlines have the same size, and whether a surface moved between them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from tccm_ros.arrays import Float64
from tccm_ros.outlines.transformation import transform_outline
from tccm_ros.surfaces.polygons import NEARLY_WHOLE, equal_sides

BORDER = 0.03
"""Max distance between two outlines of a static surface, m. Chosen: each ends within 1 or 2 cm of
the true edges."""

MIN_WIDTH = 0.01
"""A surface has moved if the strip that it left and the strip that it newly covers, each as long as
the surface is wide, are wider than this beyond the border, m. Chosen: less is noise of edges."""

MIN_LIFT = 0.025
"""A surface has moved if its height differs by more than this, m. Chosen: heights are known to
5 mm; 0.3 deg of roll and pitch add 1 cm at 2 m."""

SIZE_DIFFERENCE = 0.13
"""Max sum of the differences between the sides of two outlines of one surface, m; the larger blur
is added in quadrature. Chosen: occluded parts and corners."""

IN_PLACE = 0.05
"""Max distance along x and y of the centroids of two outlines at one place, m, or the larger blur.
Chosen: a distance of scan lines."""


class HorizontalOutline(NamedTuple):
    """An outline in map, and its height.

    Attributes
    ----------
    outline
        Outline in x and y, m.
    z
        Height, m.
    blur
        Uncertainty (x, y) of its ends, m: a vector along the line of sight, as long as the distance
        of the scan lines.
    """

    outline: BaseGeometry
    z: float
    blur: tuple[float, float] = (0.0, 0.0)

    @property
    def middle(self) -> Float64:
        """Centroid, float64 (3,), m."""
        center = self.outline.centroid
        return np.array([center.x, center.y, self.z])


def footprint_in_map(
    outline: BaseGeometry, mean: Float64, spacing: float, T_map_view: Float64
) -> HorizontalOutline:
    """Return the footprint of a patch in map.

    Parameters
    ----------
    outline, mean, spacing
        Outline, centroid float64 (3,), m, and distance of scan lines, m, of the patch in its view.
    T_map_view
        float64 (4, 4), pose of the view.
    """
    T = T_map_view
    x, y = (T[:2, :2] @ line_of_sight(mean, spacing)).tolist()
    z = float(T[2, :3] @ mean + T[2, 3])
    placed = transform_outline(T, outline, float(mean[2]))
    # Rounding can make an outline that nearly touches itself self-intersecting.
    return HorizontalOutline(placed if placed.is_valid else shapely.make_valid(placed), z, (x, y))


def line_of_sight(mean: Float64, length: float) -> Float64:
    """Return a vector (x, y) of the given length, m, from the base towards a patch, float64 (2,).

    The base is at the origin.
    """
    distance = float(np.hypot(*mean[:2]))
    return np.asarray(mean[:2] * (length / max(distance, length, MIN_WIDTH)), np.float64)


def is_of_one_size(first: HorizontalOutline, second: HorizontalOutline) -> bool:
    """Return whether two outlines can be those of one surface, at any positions.

    The smaller one may be short by up to one scan line.
    """
    smaller, larger = sorted((first, second), key=lambda f: float(f.outline.area))
    area = blurred(smaller.outline, 0.0, smaller.blur).area
    if area < NEARLY_WHOLE * larger.outline.area or larger.outline.area == 0.0:
        return False
    sides = equal_sides(first.outline) - equal_sides(second.outline)
    return bool(np.abs(sides).sum() <= np.hypot(SIZE_DIFFERENCE, _larger_blur(first, second)))


def is_in_place(first: HorizontalOutline, second: HorizontalOutline) -> bool:
    """Return whether two outlines are at the same place in x and y, at any heights."""
    step = np.abs(second.middle - first.middle)[:2].max()
    return bool(step <= max(IN_PLACE, _larger_blur(first, second)))


def _larger_blur(first: HorizontalOutline, second: HorizontalOutline) -> float:
    return float(max(np.hypot(*first.blur), np.hypot(*second.blur)))


def is_displaced(first: HorizontalOutline, second: HorizontalOutline) -> bool:
    """Return whether a surface has moved from the first footprint to the second.

    A surface that grew because more of it was seen is not displaced, nor is one that lost a part.
    """
    if abs(second.z - first.z) > MIN_LIFT:
        return True
    blurs = (first.blur, second.blur)
    width = np.sqrt(min(first.outline.area, second.outline.area))
    left = first.outline.difference(blurred(second.outline, BORDER, *blurs)).area
    if left <= MIN_WIDTH * width:
        return False
    came = second.outline.difference(blurred(first.outline, BORDER, *blurs)).area
    return bool(came > MIN_WIDTH * width and left + came > 2.0 * BORDER * width)


def blurred(outline: BaseGeometry, border: float, *blurs: tuple[float, float]) -> BaseGeometry:
    """Return the area in which a surface may be.

    Parameters
    ----------
    outline
        Measured outline in x and y, m.
    border
        Error of its edges in any direction, m.
    blurs
        Blurs of the compared footprints, m.
    """
    grown = outline.buffer(border)
    shifts = [(s * x, s * y) for x, y in blurs if x or y for s in (-1.0, 1.0)]
    return shapely.union_all([grown, *(translate(grown, *shift) for shift in shifts)])
