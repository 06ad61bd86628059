"""Features of a surface for the label rules.

They are height, width, length, area, nearby walls, and relations to the surfaces above, below and
beside it: boards of a shelf, the back of a sofa, the surface under a step, the treads of stairs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from tccm_ros.arrays import Float64
from tccm_ros.config.surfaces import LabelsConfig
from tccm_ros.robust import MAJORITY
from tccm_ros.surfaces.merging.merged_surface import MergedSurface
from tccm_ros.surfaces.polygons import NEARLY_WHOLE, box_sides

SLENDER = 3.0
"""Min ratio of length to width of a slender surface; chosen."""

ONE_SIDE = 0.3
"""Fraction of an outline that is one side of it: on or near the surface that carries a step, as the
surface behind a stove may never be seen, or at a wall; chosen."""

NARROW = 0.4
"""Max width of a band of which irregular edges are a large fraction, and of the top of a back of a
seat, m; chosen."""

RAGGED = 0.08
"""Tolerance of the smoothing of irregular outlines, m; chosen."""

MIN_TREADS = 3
"""Min number of successive treads of stairs; chosen."""

MAX_GOING = 0.5
"""Max horizontal distance of the centroids of two treads, m; chosen: boxes of different heights in
a row are deeper."""


@dataclass(frozen=True, slots=True)
class Features:
    """The features of one surface: m, m2 and fractions from 0 to 1.

    Attributes
    ----------
    height
        Height above the floor, or above the map's origin if no floor is known.
    width
        Width by `outline_width`.
    length
        Length of the narrowest box.
    area
        Area of the outline.
    at_wall
        Fraction of the outline near a wall.
    stacked
        Whether another board is above or below at the distance of shelf boards.
    carried
        Whether it is a step's height above a surface that carries it.
    backed
        Whether a higher surface runs along one of its long sides, like the back of a sofa.
    filled
        Fraction of its narrowest box that its outline covers.
    in_flight
        Whether it is one of several treads, each beside and above the previous one.
    """

    height: float
    width: float
    length: float
    area: float
    at_wall: float
    stacked: bool
    carried: bool
    backed: bool
    filled: float
    in_flight: bool

    @property
    def is_slender(self) -> bool:
        """Whether its length is a multiple of its width."""
        return self.length >= SLENDER * self.width


def features_of(
    surfaces: list[MergedSurface], floor_z: float | None, walls: Float64 | None, rules: LabelsConfig
) -> list[Features]:
    """Return the features of surfaces, including their relations to each other.

    Parameters
    ----------
    surfaces
        All surfaces except the floor.
    floor_z
        Height of the floor, m; None: unknown.
    walls
        float64 (W, 2, 2), ends of the walls in map, m.
    rules
        Heights and distances that relate surfaces to each other.
    """
    lines = shapely.linestrings(np.zeros((0, 2, 2)) if walls is None else walls)
    near_walls = shapely.union_all(lines).buffer(rules.wall_distance)
    stairs = {id(surface) for surface in treads(surfaces, rules)}
    return [
        _features(surface, surfaces, floor_z or 0.0, near_walls, rules, id(surface) in stairs)
        for surface in surfaces
    ]


def _features(
    surface: MergedSurface,
    surfaces: list[MergedSurface],
    floor_z: float,
    near_walls: shapely.Geometry,
    rules: LabelsConfig,
    in_flight: bool,
) -> Features:
    sides = box_sides(surface.polygon)
    others = [other for other in surfaces if other is not surface]
    outline = surface.polygon.exterior
    return Features(
        height=surface.height - floor_z,
        width=outline_width(surface.polygon),
        length=float(sides[1]),
        area=surface.polygon.area,
        at_wall=outline.intersection(near_walls).length / outline.length,
        stacked=any(_is_stacked(surface, other, rules) for other in others),
        carried=any(_is_carried(surface, other, rules) for other in others),
        backed=any(_is_back(other, surface, rules) for other in others),
        filled=float(shapely.Polygon(outline).area / (sides[0] * sides[1])),
        in_flight=in_flight,
    )


def outline_width(polygon: shapely.Polygon) -> float:
    """Return the width of a surface, m.

    The width is that of the narrowest box around the outline, with two exceptions. An outline that
    fills less than half of its box is a bent band, like an L-shaped counter: its width is that of
    the rectangle with the same area and perimeter, after smoothing, as an irregular edge is long.
    The width of a narrow straight band is area over length, as its irregular edges would be a large
    fraction of its box.
    """
    sides, whole = box_sides(polygon), shapely.Polygon(polygon.exterior)
    smooth = whole.simplify(RAGGED)
    half, area = smooth.exterior.length / 2.0, smooth.area
    if area > 0.5 * sides[0] * sides[1]:
        is_narrow = sides[0] <= min(NARROW, sides[1] / SLENDER)
        return float(whole.area / sides[1] if is_narrow else sides[0])
    return float((half - np.sqrt(max(half**2 - 4.0 * area, 0.0))) / 2.0)


def _is_stacked(surface: MergedSurface, other: MergedSurface, rules: LabelsConfig) -> bool:
    """Return whether a surface is a board over or under another one of a similar size."""
    low, high = rules.shelf_gap
    if not low <= abs(surface.height - other.height) <= high:
        return False
    if (
        other.height > surface.height
        and box_sides(other.polygon)[0] < NEARLY_WHOLE * box_sides(surface.polygon)[0]
    ):
        return False
    shared = surface.polygon.intersection(other.polygon).area
    return bool(shared >= MAJORITY * max(surface.polygon.area, other.polygon.area))


def _is_carried(surface: MergedSurface, other: MergedSurface, rules: LabelsConfig) -> bool:
    """Return whether a surface rises by a step's height from a larger one under or beside it."""
    low, high = rules.step_height
    if (
        not low <= surface.height - other.height <= high
        or other.polygon.area <= surface.polygon.area
    ):
        return False
    under = shapely.Polygon(other.polygon.exterior).buffer(rules.wall_distance)
    outline = surface.polygon.exterior
    return bool(outline.intersection(under).length >= ONE_SIDE * outline.length)


def _is_back(back: MergedSurface, seat: MergedSurface, rules: LabelsConfig) -> bool:
    """Return whether a surface is the top of a back along a seat.

    A back is narrow, higher than the seat, and beside most of the seat's length, not over it. A
    headboard is no back: it runs along the short side of a bed.
    """
    low, high = rules.back_height
    if not low <= back.height - seat.height <= high:
        return False
    over = back.polygon.intersection(seat.polygon).area
    beside = seat.polygon.exterior.intersection(back.polygon.buffer(rules.wall_distance)).length
    return bool(
        box_sides(back.polygon)[0] <= NARROW
        and over < MAJORITY * back.polygon.area
        and beside >= NEARLY_WHOLE * float(box_sides(seat.polygon)[1])
    )


def treads(surfaces: list[MergedSurface], rules: LabelsConfig) -> list[MergedSurface]:
    """Return the surfaces that are treads of stairs, `MIN_TREADS` or more in a row.

    Parameters
    ----------
    surfaces
        All surfaces except the floor.
    rules
        Uses `stair_rise` and `wall_distance`.
    """
    order = sorted(surfaces, key=lambda surface: surface.height)
    pairs = [(i, j) for i in range(len(order)) for j in range(i + 1, len(order))]
    steps = [(i, j) for i, j in pairs if _is_next(order[i], order[j], rules)]
    below, above = np.zeros(len(order), np.int64), np.zeros(len(order), np.int64)
    for i, j in steps:  # sorted by height: the count of the lower tread is complete
        below[j] = max(below[j], below[i] + 1)
    for i, j in reversed(steps):
        above[i] = max(above[i], above[j] + 1)
    return [surface for surface, n in zip(order, 1 + below + above) if n >= MIN_TREADS]


def _is_next(low: MergedSurface, high: MergedSurface, rules: LabelsConfig) -> bool:
    """Return whether one surface is the tread that follows another."""
    low_rise, high_rise = rules.stair_rise
    if not low_rise <= high.height - low.height <= high_rise:
        return False
    if np.linalg.norm(high.mean[:2] - low.mean[:2]) > MAX_GOING:
        return False
    a, b = low.polygon, high.polygon
    if a.intersection(b).area >= MAJORITY * min(a.area, b.area):
        return False
    along = a.exterior.intersection(b.buffer(rules.wall_distance)).length
    return bool(along >= MAJORITY * max(box_sides(a)[1], box_sides(b)[1]))
