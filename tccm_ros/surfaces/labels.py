"""What a surface is: rules over height, width, area, walls nearby and what is above and below.

Each rule is a range for height above the floor, width and area (configuration group ``labels``);
inside all ranges it is met, outside it fades. A label must be better than every other one by more
than chance, else the answer is ``other``: a wrong name is worse than none.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config, Labels
from tccm_ros.surfaces.floor import is_floor
from tccm_ros.surfaces.label_features import Features, features_of
from tccm_ros.surfaces.merged_surface import MergedSurface

__all__ = ["Label", "SurfaceLabel", "label_surfaces"]

Rule = tuple[float, float, float, float, float, float]
"""Least and greatest height, width (m) and area (m2)."""

FADE = 0.12
"""A range fades out over this fraction of its limits (widths: and this many metres more)."""

HEIGHT_FADE = 0.08
"""For heights, m: furniture of one kind differs, the map hardly does."""

MIN_BED = (0.8, 1.6)
"""No bed is smaller than this, m,"""

MIN_BED_FILLED = 0.75
"""and it fills this fraction of its box: what has the shape of an L is a sofa."""

LOW_TABLE = 0.9
"""A low table is believed this much: a sofa whose back nobody saw looks like one."""

UNDECIDED = 0.75
"""Where the second-best label reaches this fraction of the best, neither is given."""


class SurfaceLabel(StrEnum):
    """All labels."""

    FLOOR = "floor"
    TABLE = "table"
    COUNTER = "counter"
    SHELF = "shelf"
    SEAT = "seat"
    BED = "bed"
    LEDGE = "ledge"
    STEP = "step"
    OTHER = "other"


@dataclass(frozen=True, slots=True)
class Label:
    """A name and how sure it is.

    Attributes
    ----------
    name
        The name.
    confidence
        How well the rules of the name are met, less half of how well those of the next one are: at
        least `labels.min_confidence`, 1 at most. Of ``other``: how far the best name is from being
        met; 0 where two names fit.
    """

    name: SurfaceLabel
    confidence: float


def label_surfaces(
    surfaces: list[MergedSurface], floor_z: float | None, walls: Float64 | None, config: Config
) -> list[Label]:
    """Label surfaces.

    Parameters
    ----------
    surfaces
        All surfaces of the map.
    floor_z
        Height of the floor, m; None: unknown.
    walls
        float64 (W, 2, 2), ends of the walls in map, m.
    config
        Uses the group ``labels``.
    """
    others = [surface for surface in surfaces if not is_floor(surface, floor_z)]
    features = features_of(others, floor_z, walls, config.labels)
    labels = {id(s): _best(found, config.labels) for s, found in zip(others, features)}
    return [labels.get(id(surface), Label(SurfaceLabel.FLOOR, 1.0)) for surface in surfaces]


def _met(value: float, low: float, high: float, fade: float) -> float:
    """Return 1 inside a range, falling to 0 over `fade` outside it."""
    outside = max(low - value, value - high, 0.0)
    return max(0.0, 1.0 - outside / fade)


def _fit(surface: Features, rule: Rule) -> float:
    """Return how well a surface meets a rule, 0 to 1."""
    min_height, max_height, min_width, max_width, min_area, max_area = rule
    return min(
        _met(surface.height, min_height, max_height, HEIGHT_FADE),
        _met(surface.width, min_width, max_width, FADE + FADE * max_width),
        _met(np.log(surface.area), np.log(min_area), np.log(max_area), 0.5),
    )


def _scores(surface: Features, rules: Labels) -> dict[SurfaceLabel, float]:
    """Return the score of each label; what stands near and above raises or rules out."""
    away = 1.0 - 0.4 * surface.at_wall
    low = 0.0 if surface.backed else LOW_TABLE * _fit(surface, rules.low_table)
    seat = _fit(surface, rules.seat) * (0.8 if surface.is_slender else 1.0)
    sofa = _fit(surface, rules.sofa) if surface.backed else 0.0
    is_bed = surface.width >= MIN_BED[0] and surface.length >= MIN_BED[1]
    counter = _fit(surface, rules.counter) * (0.7 + 0.3 * min(1.0, 3.0 * surface.at_wall))
    ledge = _fit(surface, rules.ledge) * (0.7 + 0.3 * min(1.0, 3.0 * surface.at_wall))
    return {
        SurfaceLabel.TABLE: max(_fit(surface, rules.table), low) * away * (not surface.carried),
        SurfaceLabel.COUNTER: counter * (not surface.carried),
        SurfaceLabel.SEAT: max(seat, sofa),
        SurfaceLabel.BED: _fit(surface, rules.bed) * (is_bed and surface.filled >= MIN_BED_FILLED),
        SurfaceLabel.SHELF: _fit(surface, rules.shelf) * (1.0 if surface.stacked else 0.3),
        SurfaceLabel.LEDGE: ledge * (surface.is_slender and not surface.in_flight),
        SurfaceLabel.STEP: _fit(surface, rules.step) * (surface.carried or surface.in_flight),
    }


def _best(surface: Features, rules: Labels) -> Label:
    scores = _scores(surface, rules)
    if surface.stacked:
        shelf = SurfaceLabel.SHELF
        scores = {name: s * (1.0 if name is shelf else 0.6) for name, s in scores.items()}
    order = sorted(scores, key=lambda name: (-scores[name], name))
    best, second = scores[order[0]], scores[order[1]]
    confidence = best - 0.5 * second
    if confidence < rules.min_confidence or second > UNDECIDED * best:
        return Label(SurfaceLabel.OTHER, round(float(1.0 - best), 6))
    return Label(order[0], round(float(confidence), 6))
