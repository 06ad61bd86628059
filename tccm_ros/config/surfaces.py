"""Parameters of the surface map: views, surfaces and labels."""

from __future__ import annotations

from typing import Any, Literal

from tccm_ros.config.parameter import Group, param

Rule = tuple[float, float, float, float, float, float]


class ViewsConfig(Group):
    """Views of surfaces."""

    when: Literal["always", "still"] = param(
        "always", "still: only tilt cycles in which the base was stationary"
    )
    cell_size: float = param(
        0.10, "edge of a column of free intervals", unit="m", gt=0.01, le=1.0, read_only=True
    )
    reach: float = param(
        5.0, "max range of the free intervals of a tilt cycle", unit="m", gt=0.0, le=50.0
    )
    place_distance: float = param(
        0.10, "newer views this near replace older ones", unit="m", ge=0.0, le=2.0
    )
    place_angle: float = param(0.0873, "as place_distance, for the yaw", unit="rad", ge=0.0, le=3.2)
    voxel_size: float = param(0.01, "thinning of stored clouds", unit="m", gt=0.0, le=0.2)
    clear_margin: float = param(
        0.03,
        "a point is gone if it is this far inside a free interval of a newer view",
        unit="m",
        ge=0.0,
        le=0.5,
    )


class SurfacesConfig(Group):
    """The surface map."""

    segmentation: Literal["tccm", "seed"] = param(
        "tccm", "seed: RANSAC, clustering and merging as published", read_only=True
    )
    min_points: int = param(500, "seed: min points of a cluster", ge=3)
    seed_distance: float = param(
        0.02, "seed: distance of an inlier from its plane", unit="m", gt=0.0, le=0.2
    )
    cluster_distance: float = param(0.10, "seed: Euclidean clustering", unit="m", gt=0.0, le=1.0)
    merge_distance: float = param(
        0.05, "surfaces with points this near are one, if coplanar", unit="m", gt=0.0, le=1.0
    )
    min_height: float = param(0.30, "min height above the floor", unit="m", ge=0.0, le=3.0)
    max_step: float = param(
        0.03, "surfaces that differ more in height are never one", unit="m", gt=0.0, le=0.5
    )
    min_area: float = param(0.02, "smallest surface in the map", unit="m2", ge=0.0)
    max_floor_height: float = param(
        0.15, "max height of the floor above the first base frame", unit="m", le=2.0
    )
    registration: bool = param(True, "register overlapping views")
    unseen_space: bool = param(
        False, "planning scenes have boxes for the space below surfaces that was never seen"
    )


def label_rule(default: Rule, meaning: str) -> Any:
    """Declare the rule of a label: ranges of height above the floor, width and area."""
    return param(
        default,
        f"{meaning}: min and max of height above the floor, width, area",
        unit="m, m2",
    )


class LabelsConfig(Group):
    """Rules of labels over the height, width and area of a surface."""

    table: Rule = label_rule((0.66, 0.80, 0.45, 2.0, 0.25, 6.0), "a table or desk")
    counter: Rule = label_rule((0.82, 1.10, 0.35, 1.0, 0.30, 6.0), "a counter")
    low_table: Rule = label_rule(
        (0.30, 0.55, 0.50, 1.0, 0.36, 0.9), "a low table without a back: called table"
    )
    seat: Rule = label_rule((0.40, 0.47, 0.30, 0.50, 0.10, 0.30), "a seat of a chair or stool")
    sofa: Rule = label_rule(
        (0.34, 0.50, 0.40, 1.1, 0.40, 2.8), "a seat with a back along it: called seat"
    )
    bench: Rule = label_rule(
        (0.40, 0.50, 0.28, 0.50, 0.25, 1.2), "a long seat at a wall, or less surely away from one"
    )
    sideboard: Rule = label_rule(
        (0.66, 0.88, 0.30, 0.50, 0.30, 1.0), "a sideboard at a wall: called other"
    )
    side_table: Rule = label_rule(
        (0.49, 0.64, 0.35, 0.60, 0.12, 0.36), "a small low table: called other"
    )
    bed: Rule = label_rule((0.30, 0.62, 0.75, 2.4, 1.30, 6.0), "a bed")
    shelf: Rule = label_rule((0.10, 2.20, 0.12, 0.65, 0.04, 2.0), "a board over or under another")
    ledge: Rule = label_rule((0.30, 2.20, 0.03, 0.25, 0.02, 1.0), "a long and narrow surface")
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
        (0.12, 0.70), "distance of the boards of a shelf", unit="m"
    )
    back_height: tuple[float, float] = param(
        (0.20, 0.70), "a back rises this much above its seat", unit="m"
    )
    wall_distance: float = param(
        0.15, "an edge within this distance of a wall is at it", unit="m", ge=0.0, le=1.0
    )
    min_confidence: float = param(0.5, "below this a surface is labelled other", ge=0.0, le=1.0)
