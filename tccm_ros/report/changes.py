"""Match the surfaces and walls of two maps, and classify each as same, moved, came or went."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Generic, TypeVar

import numpy as np
import shapely
from shapely.affinity import translate

from tccm_ros.arrays import Float64
from tccm_ros.geometry import wrap_angle
from tccm_ros.records import Wall
from tccm_ros.results.folder_reader import Results
from tccm_ros.results.models import SurfaceEntry, plan_polygon


class Kind(StrEnum):
    """Change of a surface or a wall from the first map to the second."""

    SAME = "same"
    MOVED = "moved"
    CAME = "came"
    """Only in the second map."""
    WENT = "went"
    """Only in the first map."""


MAX_HEIGHT_DIFFERENCE_M = 0.05
"""Largest difference in height of one surface in two maps, m; chosen."""

MIN_OVERLAP = 0.3
"""Smallest fraction of the smaller outline inside the other, of one surface in place; chosen."""

MIN_MOVE_M = 0.05
"""Smallest shift that is a move, m; chosen: the seen parts of an edge differ by as much."""

MIN_SHAPE_IOU = 0.75
"""Smallest intersection over union of a moved surface's outlines, centred; chosen."""

MAX_MOVE_M = 3.0
"""Largest shift of a moved surface, m; chosen."""

MAX_WALL_ANGLE_RAD = np.deg2rad(5.0)
"""Largest angle of one wall in two maps, rad; chosen."""

MAX_WALL_DISTANCE_M = 0.15
"""Largest distance across one wall in two maps, m; chosen."""

MIN_WALL_OVERLAP = 0.3
"""Smallest fraction of the shorter wall along which both extend; chosen."""

Item = TypeVar("Item", SurfaceEntry, Wall)


@dataclass(frozen=True, slots=True, eq=False)
class MapDifference(Generic[Item]):
    """A surface or wall in two maps; None in a map that does not have it.

    Attributes
    ----------
    kind
        Same, moved, came or went.
    before, after
        Item in the first and in the second map.
    """

    kind: Kind
    before: Item | None
    after: Item | None


def surface_changes(before: Results, after: Results) -> list[MapDifference[SurfaceEntry]]:
    """Match the surfaces of two maps in one frame, with heights above each map's own floor.

    Surfaces with overlapping outlines are matched first, by the intersection over union: a smaller
    surface little above another is inside of it. Then the remaining ones of equal shape and label
    are matched by their shift.
    """
    old = [(s, plan_polygon(s), s.height - before.ground) for s in before.above_floor]
    new = [(s, plan_polygon(s), s.height - after.ground) for s in after.above_floor]
    same_height = [
        (i, j)
        for i, (_, _, low) in enumerate(old)
        for j, (_, _, high) in enumerate(new)
        if abs(low - high) <= MAX_HEIGHT_DIFFERENCE_M
    ]
    pairs = _best_pairs(
        (-_iou(old[i][1], new[j][1]), i, j)
        for i, j in same_height
        if _overlap(old[i][1], new[j][1]) >= MIN_OVERLAP
    )
    free = [(i, j) for i, j in same_height if i not in pairs and j not in pairs.values()]
    moves = [(_shift(old[i][1], new[j][1]), i, j) for i, j in free]
    pairs |= _best_pairs(
        (far, i, j)
        for far, i, j in moves
        if far <= MAX_MOVE_M
        and old[i][0].label == new[j][0].label
        and _shape_iou(old[i][1], new[j][1]) >= MIN_SHAPE_IOU
    )
    changes = [
        MapDifference(_kind(old[i][1], new[j][1]), old[i][0], new[j][0])
        for i, j in sorted(pairs.items())
    ]
    only_before = [s for i, (s, _, _) in enumerate(old) if i not in pairs]
    only_after = [s for j, (s, _, _) in enumerate(new) if j not in pairs.values()]
    return [*changes, *_unmatched(only_before, only_after)]


def _unmatched(before: Iterable[Item], after: Iterable[Item]) -> Iterator[MapDifference[Item]]:
    for item in before:
        yield MapDifference(Kind.WENT, item, None)
    for item in after:
        yield MapDifference(Kind.CAME, None, item)


def _best_pairs(candidates: Iterable[tuple[float, int, int]]) -> dict[int, int]:
    """Match greedily, lowest cost first; return first index -> second index."""
    pairs: dict[int, int] = {}
    for _, i, j in sorted(candidates):
        if i not in pairs and j not in pairs.values():
            pairs[i] = j
    return pairs


def _overlap(a: shapely.Geometry, b: shapely.Geometry) -> float:
    """Return the fraction of the smaller outline that the other covers."""
    smaller = min(a.area, b.area)
    return float(a.intersection(b).area / smaller) if smaller > 0.0 else 0.0


def _shift(a: shapely.Geometry, b: shapely.Geometry) -> float:
    return float(a.centroid.distance(b.centroid)) if not (a.is_empty or b.is_empty) else np.inf


def _shape_iou(a: shapely.Geometry, b: shapely.Geometry) -> float:
    """Return the intersection over union of two outlines moved to a common centroid."""
    if a.is_empty or b.is_empty:
        return 0.0
    return _iou(translate(a, b.centroid.x - a.centroid.x, b.centroid.y - a.centroid.y), b)


def _iou(a: shapely.Geometry, b: shapely.Geometry) -> float:
    """Return the intersection over union of two outlines; 0 of two without an area."""
    union = float(a.union(b).area)
    return float(a.intersection(b).area) / union if union > 0.0 else 0.0


def _kind(a: shapely.Geometry, b: shapely.Geometry) -> Kind:
    """Return whether a matched surface moved; partial views also cause small shifts."""
    moved = _shift(a, b) > MIN_MOVE_M and _shape_iou(a, b) >= MIN_SHAPE_IOU
    return Kind.MOVED if moved else Kind.SAME


def wall_changes(old: Sequence[Wall], new: Sequence[Wall]) -> list[MapDifference[Wall]]:
    """Match the walls of two maps in one frame."""
    costs = [
        (_wall_distance(a, b), i, j)
        for i, a in enumerate(old)
        for j, b in enumerate(new)
        if _is_one_wall(a, b)
    ]
    pairs = _best_pairs(costs)
    changes = [MapDifference(Kind.SAME, old[i], new[j]) for i, j in sorted(pairs.items())]
    only_before = [wall for i, wall in enumerate(old) if i not in pairs]
    only_after = [wall for j, wall in enumerate(new) if j not in pairs.values()]
    return [*changes, *_unmatched(only_before, only_after)]


def _wall_distance(a: Wall, b: Wall) -> float:
    """Return the larger distance of one wall's middle from the line of the other, m."""
    return max(
        abs(float(_normal(wall) @ other.endpoints.mean(axis=0)) - wall.rho)
        for wall, other in ((a, b), (b, a))
    )


def _normal(wall: Wall) -> Float64:
    return np.array([np.cos(wall.phi), np.sin(wall.phi)])


def _is_one_wall(a: Wall, b: Wall) -> bool:
    # The normal of a wall through the origin may point either way.
    angle = abs(float(wrap_angle(2.0 * (a.phi - b.phi)))) / 2.0  # of lines without a direction
    if angle > MAX_WALL_ANGLE_RAD or _wall_distance(a, b) > MAX_WALL_DISTANCE_M:
        return False
    tangent = np.array([-np.sin(a.phi), np.cos(a.phi)])
    spans = [np.sort(wall.endpoints @ tangent) for wall in (a, b)]
    overlap = min(spans[0][1], spans[1][1]) - max(spans[0][0], spans[1][0])
    return bool(overlap >= MIN_WALL_OVERLAP * min(span[1] - span[0] for span in spans))
