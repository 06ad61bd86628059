"""What a surface is: rules over height, width, area, walls nearby and what is above and below.

Each rule is a range for height above the floor, width and area (configuration group ``labels``);
inside all ranges it is met, outside it fades. A label must be better than every other one by more
than chance, else the answer is ``other``: a wrong name is worse than none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from tccm_ros.config import Config, Labels
from tccm_ros.surfaces.floor import is_floor
from tccm_ros.surfaces.merged_patches import Draft
from tccm_ros.surfaces.stairs import box_sides, treads

__all__ = ["Label", "label_surfaces"]

Float64 = NDArray[np.float64]
Rule = tuple[float, float, float, float, float, float]

FADE = 0.12
"""A range fades out over this share of its limits (widths: and this many metres more)."""

HEIGHT_FADE = 0.08
"""For heights, m: furniture of one kind differs, the map hardly does."""

OVERLAP = 0.5
"""A surface is over another where their footprints share this much of the smaller one."""

CARRIED = 0.3
"""A step has this share of its outline on or near the surface that carries it: a side of four is
enough, what lies behind a stove may never be seen."""

BACK = 0.40
"""The top of a back is no wider than this, m,"""

ALONG = 0.8
"""and runs along this share of its seat."""

BED = (0.8, 1.6)
"""No bed is smaller than this, m,"""

FILLED = 0.75
"""and it fills this share of its box: what has the shape of an L is a sofa."""

DEEPER = 0.75
"""Of a board over another, whose depth is less than this share of the lower one's, nothing follows
for the lower one: boards hang over worktops and desks."""

SLENDER = 3.0
"""A band is so many times as long as it is wide."""

NARROW = 0.4
"""Width of a box, m, up to which ragged edges are a good part of it."""

RAGGED = 0.08
"""Outlines stray this far from straight edges, m."""

LOW = 0.9
"""A low table is believed this much: a sofa whose back nobody saw looks like one."""

UNDECIDED = 0.75
"""Where the second-best label reaches this share of the best, neither is given."""


@dataclass(frozen=True, slots=True)
class Label:
    """A name and how sure it is.

    Attributes
    ----------
    name
        One of the labels, or ``other``.
    confidence
        How well the rules of the name are met, less half of how well those of the next one are: at
        least `labels.min_confidence`, 1 at most. Of ``other``: how far the best name is from being
        met; 0 where two names fit.
    """

    name: str
    confidence: float


@dataclass(frozen=True, slots=True)
class Shape:
    """What the rules look at: m, m2 and shares from 0 to 1.

    Attributes
    ----------
    height
        Above the floor (above the map's origin where no floor is known).
    width
        Of the narrowest box around the outline; an L-shaped counter is as wide as its arms, and a
        narrow band as on the mean.
    length
        Of the narrowest box.
    area
        Of the outline.
    at_wall
        Share of the outline that is near a wall.
    stacked
        Whether another board is above or below at the distance of shelf boards.
    carried
        Whether it rises a step's height above a surface that carries it.
    backed
        Whether something higher runs along one of its long sides, as the back of a sofa does.
    filled
        Share of its narrowest box that lies within its outline.
    in_flight
        Whether it is one of several treads, each beside and above the one before.
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


def label_surfaces(
    drafts: list[Draft], floor_z: float | None, walls: Float64 | None, config: Config
) -> list[Label]:
    """Label surfaces.

    Parameters
    ----------
    drafts
        All surfaces of the map.
    floor_z
        Height of the floor, m; None: unknown.
    walls
        float64 (W, 2, 2), ends of the walls in map, m.
    config
        Uses the group ``labels``.
    """
    near_walls = _near_walls(walls, config.labels.wall_distance)
    others = [draft for draft in drafts if not is_floor(draft, floor_z)]
    stairs = {id(draft) for draft in treads(others, config.labels)}
    labels = []
    for draft in drafts:
        if is_floor(draft, floor_z):
            labels.append(Label("floor", 1.0))
        else:
            shape = _shape(draft, others, floor_z, near_walls, config, id(draft) in stairs)
            labels.append(_best(shape, config.labels))
    return labels


def _near_walls(walls: Float64 | None, distance: float) -> shapely.Geometry:
    lines = shapely.linestrings(np.zeros((0, 2, 2)) if walls is None else walls)
    return shapely.union_all(lines).buffer(distance)


def _shape(
    draft: Draft,
    surfaces: list[Draft],
    floor_z: float | None,
    near_walls: shapely.Geometry,
    config: Config,
    in_flight: bool,
) -> Shape:
    """Look at a surface among all that are not floor."""
    edges = box_sides(draft.polygon)
    others = [d for d in surfaces if d is not draft]
    outline = draft.polygon.exterior
    return Shape(
        height=draft.height - (floor_z or 0.0),
        width=_width(draft.polygon, edges),
        length=float(edges[1]),
        area=draft.polygon.area,
        at_wall=outline.intersection(near_walls).length / outline.length,
        stacked=any(_is_stacked(draft, other, config.labels) for other in others),
        carried=any(_is_carried(draft, other, config.labels) for other in others),
        backed=any(_is_back(other, draft, float(edges[1]), config.labels) for other in others),
        filled=float(shapely.Polygon(outline).area / (edges[0] * edges[1])),
        in_flight=in_flight,
    )


def _width(polygon: shapely.Polygon, edges: Float64) -> float:
    """Return the width of a surface from its outline and the edges (2,) of its box, m.

    What fills less than half of its box is a band with a bend: it is as wide as the rectangle of
    the same area and perimeter. The outline is smoothed first, as a ragged edge is long. A narrow
    band without a bend is as wide as on the mean: waves of its edges would make up much of its box.
    """
    whole = shapely.Polygon(polygon.exterior)
    smooth = whole.simplify(RAGGED)
    half, area = smooth.exterior.length / 2.0, smooth.area
    if area > 0.5 * edges[0] * edges[1]:
        is_narrow = edges[0] <= min(NARROW, edges[1] / SLENDER)
        return float(whole.area / edges[1] if is_narrow else edges[0])
    return float((half - np.sqrt(max(half**2 - 4.0 * area, 0.0))) / 2.0)


def _is_stacked(draft: Draft, other: Draft, rules: Labels) -> bool:
    """Return whether a surface is a board over or under another one of a similar size."""
    low, high = rules.shelf_gap
    if not low <= abs(draft.height - other.height) <= high:
        return False
    if (
        other.height > draft.height
        and box_sides(other.polygon)[0] < DEEPER * box_sides(draft.polygon)[0]
    ):
        return False
    shared = draft.polygon.intersection(other.polygon).area
    return bool(shared >= OVERLAP * max(draft.polygon.area, other.polygon.area))


def _is_carried(draft: Draft, other: Draft, rules: Labels) -> bool:
    """Return whether a surface rises a little from a larger one under or beside it."""
    low, high = rules.step_height
    if not low <= draft.height - other.height <= high or other.polygon.area <= draft.polygon.area:
        return False
    under = shapely.Polygon(other.polygon.exterior).buffer(rules.wall_distance)
    outline = draft.polygon.exterior
    return bool(outline.intersection(under).length >= CARRIED * outline.length)


def _is_back(back: Draft, seat: Draft, length: float, rules: Labels) -> bool:
    """Return whether a surface is the top of a back along a seat of a length, m.

    It is higher, narrow, and stands beside the seat along most of it, not over it: a headboard,
    along the short side of a bed, is no back.
    """
    low, high = rules.back_height
    if not low <= back.height - seat.height <= high:
        return False
    over = back.polygon.intersection(seat.polygon).area
    beside = seat.polygon.exterior.intersection(back.polygon.buffer(rules.wall_distance)).length
    return bool(
        box_sides(back.polygon)[0] <= BACK
        and over < OVERLAP * back.polygon.area
        and beside >= ALONG * length
    )


def _met(value: float, low: float, high: float, fade: float) -> float:
    """Return 1 inside a range, falling to 0 over `fade` outside it."""
    outside = max(low - value, value - high, 0.0)
    return max(0.0, 1.0 - outside / fade)


def _fit(shape: Shape, rule: Rule) -> float:
    """Return how well a shape meets a rule, 0 to 1."""
    return min(
        _met(shape.height, rule[0], rule[1], HEIGHT_FADE),
        _met(shape.width, rule[2], rule[3], FADE + FADE * rule[3]),
        _met(np.log(shape.area), np.log(rule[4]), np.log(rule[5]), 0.5),
    )


def _scores(shape: Shape, rules: Labels) -> dict[str, float]:
    """Return the score of each label; what stands near and above raises or rules out."""
    slender = shape.length >= SLENDER * shape.width
    away = 1.0 - 0.4 * shape.at_wall
    low = 0.0 if shape.backed else LOW * _fit(shape, rules.low_table)
    sofa = _fit(shape, rules.sofa) if shape.backed else 0.0
    is_bed = shape.width >= BED[0] and shape.length >= BED[1]
    counter = _fit(shape, rules.counter) * (0.7 + 0.3 * min(1.0, 3.0 * shape.at_wall))
    ledge = _fit(shape, rules.ledge) * (0.7 + 0.3 * min(1.0, 3.0 * shape.at_wall))
    return {
        "table": max(_fit(shape, rules.table), low) * away * (not shape.carried),
        "counter": counter * (not shape.carried),
        "seat": max(_fit(shape, rules.seat) * (0.8 if slender else 1.0), sofa),
        "bed": _fit(shape, rules.bed) * (is_bed and shape.filled >= FILLED),
        "shelf": _fit(shape, rules.shelf) * (1.0 if shape.stacked else 0.3),
        "ledge": ledge * (slender and not shape.in_flight),
        "step": _fit(shape, rules.step) * (shape.carried or shape.in_flight),
    }


def _best(shape: Shape, rules: Labels) -> Label:
    scores = _scores(shape, rules)
    if shape.stacked:
        scores = {name: s * (1.0 if name == "shelf" else 0.6) for name, s in scores.items()}
    order = sorted(scores, key=lambda name: (-scores[name], name))
    best, second = scores[order[0]], scores[order[1]]
    confidence = best - 0.5 * second
    if confidence < rules.min_confidence or second > UNDECIDED * best:
        return Label("other", round(float(1.0 - best), 6))
    return Label(order[0], round(float(confidence), 6))
