"""Surfaces and walls of two maps, paired: what stayed, moved, came and went."""

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
from tccm_ros.results.folder_reader import Results
from tccm_ros.results.models import SurfaceEntry, WallEntry

__all__ = ["Change", "Item", "Kind", "surface_changes", "wall_changes"]


class Kind(StrEnum):
    """What became of a surface or a wall from the first map to the second."""

    SAME = "same"
    MOVED = "moved"
    CAME = "came"
    """Only in the second."""
    WENT = "went"
    """Only in the first."""


SAME_HEIGHT = 0.05
"""One surface in two maps: heights within this, m ..."""

SAME_OVERLAP = 0.3
"""... and as much of the smaller one over the other."""

MOVED_SHIFT = 0.05
"""Less is not called moved, m: the edge of what was seen differs by as much."""

SAME_SHAPE = 0.75
"""Moved is what has the same shape: intersection over union when laid over each other."""

FARTHEST_MOVE = 3.0
"""What is farther away is another one, m."""

WALL_ANGLE = np.deg2rad(5.0)
WALL_DISTANCE = 0.15
WALL_OVERLAP = 0.3
"""One wall in two maps: direction, distance (m) and how much of the shorter one both cover."""

Item = TypeVar("Item", SurfaceEntry, WallEntry)


@dataclass(frozen=True, slots=True, eq=False)
class Change(Generic[Item]):
    """One surface or wall in two maps; None where it is not there.

    Attributes
    ----------
    kind
        What became of it.
    before, after
        As in the first and the second map.
    """

    kind: Kind
    before: Item | None
    after: Item | None

    @property
    def either(self) -> Item:
        """Return it as it is now, or as it was."""
        item = self.after or self.before
        assert item is not None
        return item


def surface_changes(before: Results, after: Results) -> list[Change[SurfaceEntry]]:
    """Pair the surfaces of two maps in one frame; heights count from each map's floor."""
    old = [(s, _outline(s), s.height - before.ground) for s in before.above_floor]
    new = [(s, _outline(s), s.height - after.ground) for s in after.above_floor]
    level = [
        (i, j)
        for i, (_, _, low) in enumerate(old)
        for j, (_, _, high) in enumerate(new)
        if abs(low - high) <= SAME_HEIGHT
    ]
    there = [(1.0 - _overlap(old[i][1], new[j][1]), i, j) for i, j in level]
    pairs = _best_pairs((cost, i, j) for cost, i, j in there if 1.0 - cost >= SAME_OVERLAP)
    free = [(i, j) for i, j in level if i not in pairs and j not in pairs.values()]
    moves = [(_shift(old[i][1], new[j][1]), i, j) for i, j in free]
    pairs |= _best_pairs(
        (far, i, j)
        for far, i, j in moves
        if far <= FARTHEST_MOVE
        and old[i][0].label == new[j][0].label
        and _likeness(old[i][1], new[j][1]) >= SAME_SHAPE
    )
    changes = [
        Change(_kind(old[i][1], new[j][1]), old[i][0], new[j][0]) for i, j in sorted(pairs.items())
    ]
    gone = [s for i, (s, _, _) in enumerate(old) if i not in pairs]
    fresh = [s for j, (s, _, _) in enumerate(new) if j not in pairs.values()]
    return [*changes, *_alone(gone, fresh)]


def _alone(gone: Iterable[Item], fresh: Iterable[Item]) -> Iterator[Change[Item]]:
    for item in gone:
        yield Change(Kind.WENT, item, None)
    for item in fresh:
        yield Change(Kind.CAME, None, item)


def _best_pairs(candidates: Iterable[tuple[float, int, int]]) -> dict[int, int]:
    """Pair greedily, the lowest cost first; return first index -> second index."""
    pairs: dict[int, int] = {}
    for _, i, j in sorted(candidates):
        if i not in pairs and j not in pairs.values():
            pairs[i] = j
    return pairs


def _outline(surface: SurfaceEntry) -> shapely.Geometry:
    holes = [hole[:, :2] for hole in surface.holes if len(hole) > 2]
    if len(surface.boundary) < 3:
        return shapely.Polygon()
    return shapely.make_valid(shapely.Polygon(surface.boundary[:, :2], holes))


def _overlap(a: shapely.Geometry, b: shapely.Geometry) -> float:
    """Return the share of the smaller outline that the other covers."""
    smaller = min(a.area, b.area)
    return float(a.intersection(b).area / smaller) if smaller > 0.0 else 0.0


def _shift(a: shapely.Geometry, b: shapely.Geometry) -> float:
    return float(a.centroid.distance(b.centroid)) if not (a.is_empty or b.is_empty) else np.inf


def _likeness(a: shapely.Geometry, b: shapely.Geometry) -> float:
    """Return intersection over union when the centres are laid over each other."""
    if a.is_empty or b.is_empty:
        return 0.0
    moved = translate(a, b.centroid.x - a.centroid.x, b.centroid.y - a.centroid.y)
    return float(moved.intersection(b).area / moved.union(b).area)


def _kind(a: shapely.Geometry, b: shapely.Geometry) -> Kind:
    """Return whether a pair only was seen differently, or moved."""
    moved = _shift(a, b) > MOVED_SHIFT and _likeness(a, b) >= SAME_SHAPE
    return Kind.MOVED if moved else Kind.SAME


def wall_changes(old: Sequence[WallEntry], new: Sequence[WallEntry]) -> list[Change[WallEntry]]:
    """Pair the walls of two maps in one frame."""
    costs = [
        (_wall_distance(a, b), i, j)
        for i, a in enumerate(old)
        for j, b in enumerate(new)
        if _is_one_wall(a, b)
    ]
    pairs = _best_pairs(costs)
    changes = [Change(Kind.SAME, old[i], new[j]) for i, j in sorted(pairs.items())]
    gone = [wall for i, wall in enumerate(old) if i not in pairs]
    fresh = [wall for j, wall in enumerate(new) if j not in pairs.values()]
    return [*changes, *_alone(gone, fresh)]


def _wall_distance(a: WallEntry, b: WallEntry) -> float:
    """Return how far the middle of one is from the line of the other, the larger of both, m."""
    return max(
        abs(float(_normal(wall) @ other.endpoints.mean(axis=0)) - wall.rho)
        for wall, other in ((a, b), (b, a))
    )


def _normal(wall: WallEntry) -> Float64:
    return np.array([np.cos(wall.phi), np.sin(wall.phi)])


def _is_one_wall(a: WallEntry, b: WallEntry) -> bool:
    # The normal of a wall through the origin may point either way.
    angle = float(np.abs(wrap_angle(2.0 * (a.phi - b.phi))) / 2.0)
    if angle > WALL_ANGLE or _wall_distance(a, b) > WALL_DISTANCE:
        return False
    tangent = np.array([-np.sin(a.phi), np.cos(a.phi)])
    spans = [np.sort(wall.endpoints @ tangent) for wall in (a, b)]
    shared = min(spans[0][1], spans[1][1]) - max(spans[0][0], spans[1][0])
    return bool(shared >= WALL_OVERLAP * min(span[1] - span[0] for span in spans))
