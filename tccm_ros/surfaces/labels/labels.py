"""Labels of surfaces (table, counter, shelf, ...) by rules over their features.

A rule is a range for height above the floor, width and area (configuration group ``labels``). Its
score is 1 inside all ranges and falls to 0 outside; relations to walls and other surfaces weight
it. If the best label is not clearly better than the second-best, the label is ``other``: a wrong
label is worse than none.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.config.surfaces import LabelsConfig
from tccm_ros.robust import AMBIGUOUS
from tccm_ros.surfaces.labels.label_features import ONE_SIDE, Features, features_of
from tccm_ros.surfaces.merging.floor import is_floor
from tccm_ros.surfaces.merging.merged_surface import MergedSurface
from tccm_ros.surfaces.polygons import NEARLY_WHOLE

Rule = tuple[float, float, float, float, float, float]
"""Min and max of height (m), width (m) and area (m2)."""

FADE = 0.12
"""The score of a width falls to 0 over this distance, m, plus this fraction of the exceeded bound;
chosen."""

HEIGHT_FADE = 0.08
"""The score of a height falls to 0 over this distance outside its range, m; chosen: heights of one
kind of furniture vary by more than the error of the map."""

AREA_FADE = 0.5
"""The score of an area falls to 0 over this difference in its natural logarithm (a factor of 1.65);
chosen."""

MIN_BED = (0.8, 1.6)
"""Min width and length of a bed, m; chosen: a sofa whose back was not seen is as low and nearly as
large."""

UNLIKELY = 0.7
"""Weight of a label against which a relation speaks: a counter, a ledge or a bench away from any
wall, a table whose whole outline is at walls, a low table, as a sofa whose back was not seen looks
like one, a slender seat, and all but the shelf for a board above or below another; chosen."""

BENCH_LENGTH = 1.8
"""Min ratio of length to width of a bench; chosen: two people sit side by side."""

RIVAL = 0.5
"""Fraction of the second-best score that is subtracted from the best one for the confidence;
chosen."""


class SurfaceLabel(StrEnum):
    """The labels that a surface may have."""

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
    """The label of a surface with its confidence.

    Attributes
    ----------
    name
        The label.
    confidence
        Score of the label minus half of the second-best score, from `labels.min_confidence` to 1.
        For ``other``: 1 minus the best score.
    """

    name: SurfaceLabel
    confidence: float


def label_surfaces(
    surfaces: list[MergedSurface], floor_z: float | None, walls: Float64 | None, config: Config
) -> list[Label]:
    """Return the labels of surfaces by the rules.

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


def _met(value: float, low: float, high: float, fade: float, fraction: float = 0.0) -> float:
    """Return a score: 1 inside a range, falling to 0 outside it.

    Parameters
    ----------
    value
        Value of the feature.
    low, high
        Range of the rule.
    fade, fraction
        The score falls to 0 over `fade` plus this fraction of the exceeded bound.
    """
    bound = low if value < low else high
    outside = max(low - value, value - high, 0.0)
    return max(0.0, 1.0 - outside / (fade + fraction * bound))


def _fit(surface: Features, rule: Rule) -> float:
    """Return how well a surface meets a rule, 0 to 1."""
    min_height, max_height, min_width, max_width, min_area, max_area = rule
    return min(
        _met(surface.height, min_height, max_height, HEIGHT_FADE),
        _met(surface.width, min_width, max_width, FADE, FADE),
        _met(np.log(surface.area), np.log(min_area), np.log(max_area), AREA_FADE),
    )


def _scores(surface: Features, rules: LabelsConfig) -> dict[SurfaceLabel, float]:
    """Return the score of each label: its rule, weighted by relations to walls and surfaces.

    Furniture without a label of its own competes as ``other``.
    """
    away = 1.0 - (1.0 - UNLIKELY) * surface.at_wall
    is_at_wall = min(1.0, surface.at_wall / ONE_SIDE)
    near_wall = UNLIKELY + (1.0 - UNLIKELY) * is_at_wall
    low = UNLIKELY * _fit(surface, rules.low_table) * (not surface.backed)
    low *= 1.0 - (1.0 - UNLIKELY) * is_at_wall  # a coffee table stands in the room
    seat = _fit(surface, rules.seat) * (UNLIKELY if surface.is_slender else 1.0)
    sofa = _fit(surface, rules.sofa) if surface.backed else 0.0
    is_bench = surface.length >= BENCH_LENGTH * surface.width
    bench = _fit(surface, rules.bench) * is_bench * near_wall
    sideboard = _fit(surface, rules.sideboard) * is_at_wall * (not surface.stacked)
    is_bed = surface.width >= MIN_BED[0] and surface.length >= MIN_BED[1]
    counter, ledge = (_fit(surface, rule) * near_wall for rule in (rules.counter, rules.ledge))
    return {
        SurfaceLabel.TABLE: max(_fit(surface, rules.table) * away, low) * (not surface.carried),
        SurfaceLabel.COUNTER: counter * (not surface.carried),
        SurfaceLabel.SEAT: max(seat, sofa, bench),
        SurfaceLabel.BED: _fit(surface, rules.bed) * (is_bed and surface.filled >= NEARLY_WHOLE),
        SurfaceLabel.SHELF: _fit(surface, rules.shelf) * surface.stacked,
        SurfaceLabel.LEDGE: ledge * (surface.is_slender and not surface.in_flight),
        SurfaceLabel.OTHER: max(sideboard, _fit(surface, rules.side_table)),
        SurfaceLabel.STEP: _fit(surface, rules.step) * (surface.carried or surface.in_flight),
    }


def _best(surface: Features, rules: LabelsConfig) -> Label:
    scores = _scores(surface, rules)
    if surface.stacked:
        shelf = SurfaceLabel.SHELF
        scores = {name: s * (1.0 if name is shelf else UNLIKELY) for name, s in scores.items()}
    order = sorted(scores, key=lambda name: (-scores[name], name))
    best, second = scores[order[0]], scores[order[1]]
    confidence = best - RIVAL * second
    is_unsure = confidence < rules.min_confidence or second > AMBIGUOUS * best
    if is_unsure or order[0] is SurfaceLabel.OTHER:
        return Label(SurfaceLabel.OTHER, round(float(1.0 - best), 6))
    return Label(order[0], round(float(confidence), 6))
