"""The surface map: views, surfaces and what they are called."""

from __future__ import annotations

from typing import Any, Literal

from tccm_ros.config.parameter import Group, param

__all__ = ["Labels", "Surfaces", "Views"]

Rule = tuple[float, float, float, float, float, float]


class Views(Group):
    """Views of surfaces."""

    when: Literal["always", "still"] = param(
        "always", "still: only sweeps in which the base stood still"
    )
    cell_size: float = param(
        0.10, "column of the seen-through view", unit="m", gt=0.01, le=1.0, read_only=True
    )
    reach: float = param(
        5.0, "distance up to which a sweep tells what it saw through", unit="m", gt=0.0, le=50.0
    )
    place_distance: float = param(
        0.10, "a place: the newer view replaces the older", unit="m", ge=0.0, le=2.0
    )
    place_angle: float = param(0.0873, "a place, as place_distance", unit="rad", ge=0.0, le=3.2)
    voxel_size: float = param(0.01, "thinning of stored clouds", unit="m", gt=0.0, le=0.2)
    clear_margin: float = param(
        0.03,
        "what a newer view looked through is gone if it is this far inside the free interval",
        unit="m",
        ge=0.0,
        le=0.5,
    )


class Surfaces(Group):
    """The surface map."""

    segmentation: Literal["tccm", "seed"] = param(
        "tccm", "seed: RANSAC, clustering and merging as published", read_only=True
    )
    min_points: int = param(500, "seed: least points of a cluster", ge=3)
    seed_distance: float = param(
        0.02, "seed: distance of an inlier from its plane", unit="m", gt=0.0, le=0.2
    )
    cluster_distance: float = param(0.10, "seed: Euclidean clustering", unit="m", gt=0.0, le=1.0)
    merge_distance: float = param(
        0.05, "surfaces with points this near are one, if coplanar", unit="m", gt=0.0, le=1.0
    )
    min_height: float = param(0.30, "least height above the floor", unit="m", ge=0.0, le=3.0)
    max_step: float = param(
        0.03, "surfaces further apart in height are never one", unit="m", gt=0.0, le=0.5
    )
    min_area: float = param(0.02, "smallest surface in the map", unit="m2", ge=0.0)
    max_floor_height: float = param(
        0.15, "the floor is not higher than this above the first base frame", unit="m", le=2.0
    )
    registration: bool = param(True, "register overlapping views")


def label_rule(default: Rule, meaning: str) -> Any:
    """Declare the rule of one label: ranges of height above the floor, width and area."""
    return param(
        default,
        f"{meaning}: least and largest height above the floor, width, area",
        unit="m, m2",
    )


class Labels(Group):
    """What a surface is called: rules over its height, width (of its narrowest box) and area."""

    table: Rule = label_rule((0.66, 0.80, 0.45, 2.0, 0.25, 6.0), "a table or desk")
    counter: Rule = label_rule((0.82, 1.10, 0.35, 1.0, 0.30, 6.0), "a counter")
    low_table: Rule = label_rule(
        (0.30, 0.55, 0.40, 1.0, 0.36, 0.9), "a low table without a back: called table"
    )
    seat: Rule = label_rule((0.40, 0.47, 0.30, 0.60, 0.10, 0.30), "a seat of a chair or stool")
    sofa: Rule = label_rule(
        (0.34, 0.50, 0.40, 1.1, 0.40, 2.8), "a seat with a back along it: called seat"
    )
    bed: Rule = label_rule((0.30, 0.62, 0.75, 2.4, 1.30, 6.0), "a bed")
    shelf: Rule = label_rule((0.10, 2.20, 0.12, 0.65, 0.04, 2.0), "a board over or under another")
    ledge: Rule = label_rule((0.30, 2.20, 0.03, 0.25, 0.02, 1.0), "something long and narrow")
    step: Rule = label_rule(
        (0.30, 1.60, 0.10, 1.0, 0.02, 1.5), "a low step on a larger surface, or a tread of stairs"
    )
    step_height: tuple[float, float] = param(
        (0.015, 0.15), "a step rises this much above the surface that carries it", unit="m"
    )
    stair_rise: tuple[float, float] = param(
        (0.12, 0.23), "treads of stairs rise this much above each other", unit="m"
    )
    shelf_gap: tuple[float, float] = param(
        (0.12, 0.70), "boards of a shelf are this far apart", unit="m"
    )
    back_height: tuple[float, float] = param(
        (0.20, 0.70), "a back rises this much above its seat", unit="m"
    )
    wall_distance: float = param(
        0.15, "an edge this near to a wall stands at it", unit="m", ge=0.0, le=1.0
    )
    min_confidence: float = param(0.5, "below this a surface is labelled other", ge=0.0, le=1.0)
