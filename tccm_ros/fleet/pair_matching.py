"""Match two maps of a fleet by their walls, furniture and door signs.

Walls alone cannot distinguish two floors of a building: furniture and door signs must agree, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import shapely

from tccm_ros.arrays import Covariance3, Float64, Vector
from tccm_ros.config import Config
from tccm_ros.fleet.map_inputs import MapInput, SurfaceFootprint
from tccm_ros.geometry import transform2
from tccm_ros.results.models import SignEntry
from tccm_ros.slam.map_matching import match_walls, median_pose

MIN_OVERLAP = 0.5
"""Minimum fraction of a surface that the other map has seen, for it to count, and that surfaces of
the other map cover, for it to agree. Chosen."""

MIN_COMPARED_AREA = 0.3
"""Minimum area of furniture seen in both maps for a decision, m2. Chosen."""

MIN_AGREEMENT = 0.5
"""Minimum fraction of the furniture seen in both maps that agrees. Chosen: half of it may have been
moved between two drives."""

MAX_SIGN_DISTANCE = 0.3
"""Maximum distance of a door sign in two maps, m. Chosen: less than the distance of two doors."""


class PairReason(StrEnum):
    """Reason why two maps are merged or not; braces are filled with numbers."""

    ACCEPTED = "walls and furniture agree"
    NO_MATCH = "no place of one is found in the other"
    OTHER_FURNITURE = "the walls agree, but only {:.2f} of the furniture does"
    OTHER_SIGNS = "the walls agree, but {} of {} door signs read otherwise"
    CONTRADICTED = "contradicts other pairs"


@dataclass(frozen=True, slots=True, eq=False)
class PairLoop:
    """A keyframe of the second map matched in the first.

    Attributes
    ----------
    a, b
        Ids of the keyframes in the first and in the second map.
    delta, cov
        Planar pose float64 (3,) of b in a, and its covariance (3, 3) in b's frame.
    inliers, score, window
        As in `Proposal`.
    """

    a: int
    b: int
    delta: Vector
    cov: Covariance3
    inliers: float
    score: float
    window: float


@dataclass(frozen=True, slots=True, eq=False)
class PairMatch:
    """The match of two maps.

    Attributes
    ----------
    reason
        Reason for acceptance or rejection (`PairReason`).
    p_one_other
        float64 (3,), planar pose of the second map in the first; zero without a match.
    loops
        The matched keyframes.
    """

    reason: str
    p_one_other: Vector
    loops: tuple[PairLoop, ...] = ()

    @property
    def is_accepted(self) -> bool:
        """Whether the two maps are to be merged."""
        return self.reason == PairReason.ACCEPTED


def match_maps(one: MapInput, other: MapInput, config: Config) -> PairMatch:
    """Match a map to another one.

    Parameters
    ----------
    one, other
        The maps.
    config
        Groups ``loops`` and ``matching``.
    """
    loops = match_walls(one.walls, other.walls, config)
    if not loops:
        return PairMatch(PairReason.NO_MATCH, np.zeros(3))
    T = median_pose(loops, one.walls.poses, other.walls.poses)
    area, agreement = compare_furniture(one.surfaces, other.surfaces, T)
    same, others = compare_signs(one.signs, other.signs, T)
    reason: str = PairReason.ACCEPTED
    if others > same:
        reason = PairReason.OTHER_SIGNS.format(others, same + others)
    elif area >= MIN_COMPARED_AREA and agreement < MIN_AGREEMENT:
        reason = PairReason.OTHER_FURNITURE.format(agreement)
    rows = [PairLoop(p.a, p.b, p.delta, p.cov, p.inliers, p.score, p.window) for p in loops]
    return PairMatch(reason, T, tuple(rows))


def compare_furniture(
    one: Sequence[SurfaceFootprint], other: Sequence[SurfaceFootprint], p_one_other: Float64
) -> tuple[float, float]:
    """Return the area of furniture seen in both maps, m2, and the fraction that agrees.

    Parameters
    ----------
    one, other
        Surfaces of the maps.
    p_one_other
        float64 (3,), planar pose of the second map in the first.
    """
    moved = [surface.moved(p_one_other) for surface in other]
    counts = [_agreeing(a, b) for a, b in ((one, moved), (moved, one))]
    compared = sum(area for area, _ in counts)
    return compared, sum(area for _, area in counts) / compared if compared else 0.0


def _agreeing(
    ones: Sequence[SurfaceFootprint], others: Sequence[SurfaceFootprint]
) -> tuple[float, float]:
    """Return the area of surfaces seen in the other map, and of those present in it, m2."""
    seen = shapely.union_all([other.polygon for other in others])
    compared = agreeing = 0.0
    for one in ones:
        area = one.polygon.area
        if one.is_floor or one.polygon.intersection(seen).area < MIN_OVERLAP * area:
            continue
        compared += area
        near = [o.polygon for o in others if not o.is_floor and one.is_as_high_as(o)]
        if one.polygon.intersection(shapely.union_all(near)).area >= MIN_OVERLAP * area:
            agreeing += area
    return compared, agreeing


def compare_signs(
    one: Sequence[SignEntry], other: Sequence[SignEntry], p_one_other: Float64
) -> tuple[int, int]:
    """Return the numbers of door signs that read the same and differently in both maps.

    Parameters
    ----------
    one, other
        Signs of the maps.
    p_one_other
        float64 (3,), planar pose of the second map in the first.
    """
    if not one or not other:
        return 0, 0
    positions = np.array([sign.position for sign in one])
    same = others = 0
    for sign in other:
        xy = transform2(p_one_other, sign.position[None, :2])[0]
        distances = np.linalg.norm(positions - [*xy, sign.position[2]], axis=1)
        nearest = int(np.argmin(distances))
        if distances[nearest] <= MAX_SIGN_DISTANCE:
            is_same = one[nearest].number == sign.number
            same, others = same + is_same, others + (not is_same)
    return same, others
