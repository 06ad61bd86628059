"""Match two maps by searching for the second one's keyframes in the first, as for a new session.

The proposals come from the loop search, and confirm each other (`slam.loops`). Walls alone cannot
distinguish two floors of a building, so furniture and door signs must agree, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
import shapely

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.fleet.map_inputs import Footprint, MapInput, NumberedSign
from tccm_ros.geometry import between2, compose2, inverse2, transform2
from tccm_ros.results.models import Covariance3, Vector
from tccm_ros.slam.chain import Chain
from tccm_ros.slam.loops.closing import LoopCloser
from tccm_ros.slam.loops.matching import Proposal
from tccm_ros.slam.saved_walls import SavedWalls
from tccm_ros.slam.signs.views import SignView

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

YAW_WEIGHT = 3.0
"""Weight of yaw in the distance of two poses, m/rad. Chosen."""


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
    T_one_other
        float64 (3,), planar pose of the second map in the first; zero without a match.
    loops
        The matched keyframes.
    compared_area, agreement
        Area of furniture seen in both maps, m2, and the fraction of it that agrees.
    """

    reason: str
    T_one_other: Vector
    loops: tuple[PairLoop, ...] = ()
    compared_area: float = 0.0
    agreement: float = 0.0

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
    T = _median_pose(loops, one.walls.poses, other.walls.poses)
    area, agreement = compare_furniture(one.surfaces, other.surfaces, T)
    same, others = compare_signs(one.signs, other.signs, T)
    reason: str = PairReason.ACCEPTED
    if others > same:
        reason = PairReason.OTHER_SIGNS.format(others, same + others)
    elif area >= MIN_COMPARED_AREA and agreement < MIN_AGREEMENT:
        reason = PairReason.OTHER_FURNITURE.format(agreement)
    rows = [PairLoop(p.a, p.b, p.delta, p.cov, p.inliers, p.score, p.window) for p in loops]
    return PairMatch(reason, T, tuple(rows), area, agreement)


def match_walls(one: SavedWalls, other: SavedWalls, config: Config) -> list[Proposal]:
    """Match the keyframes of a map in another one; return the confirmed matches.

    Parameters
    ----------
    one, other
        The maps; ids in the result are local to each map.
    config
        Groups ``loops`` and ``matching``.
    """
    chain = Chain()
    closer = LoopCloser(config, chain, begins_trajectories=False)
    for keyframe, lines in zip(one.keyframes, one.lines):
        chain.add(keyframe, lines.phi)
    closer.load(one.poses, one.loops, (), one.sign_views, one.unjoined)
    count = len(one.keyframes)
    first_session = 1 + max(keyframe.session for keyframe in one.keyframes)
    for k, (keyframe, lines) in enumerate(zip(other.keyframes, other.lines)):
        session = first_session + keyframe.session
        chain.add(replace(keyframe, id=count + k, session=session), lines.phi)
        closer.add(count + k, (), _sign_views_on(k, other, count))
    found = [p for p in closer.accepted[len(one.loops) :] if p.a < count <= p.b]
    found = [replace(p, b=p.b - count) for p in found]
    return [p for p in found if other.keyframes[p.b].session not in other.unjoined]


def _sign_views_on(k: int, walls: SavedWalls, count: int) -> list[SignView]:
    """Return the sign views at a keyframe, with keyframe ids offset by `count` and no sign id."""
    views = [view for view in walls.sign_views if view.anchored.keyframe == k]
    views.sort(key=lambda view: view.measurement.stamp_ns)
    return [replace(v, anchored=replace(v.anchored, keyframe=count + k), sign=-1) for v in views]


def _median_pose(loops: Sequence[Proposal], one: Float64, other: Float64) -> Float64:
    """Return the pose of a map in another one from the match nearest to all matches."""
    poses = np.array(
        [compose2(compose2(one[p.a], p.delta), inverse2(other[p.b])) for p in loops]
    ).reshape(-1, 3)
    distances = [_distances(pose, poses).sum() for pose in poses]
    return np.asarray(poses[int(np.argmin(distances))])


def _distances(one: Float64, others: Float64) -> Float64:
    error = between2(one, others)
    return np.asarray(np.hypot(error[:, 0], error[:, 1]) + YAW_WEIGHT * np.abs(error[:, 2]))


def compare_furniture(
    one: Sequence[Footprint], other: Sequence[Footprint], T_one_other: Float64
) -> tuple[float, float]:
    """Return the area of furniture seen in both maps, m2, and the fraction that agrees.

    Parameters
    ----------
    one, other
        Surfaces of the maps.
    T_one_other
        float64 (3,), planar pose of the second map in the first.
    """
    moved = [surface.moved(T_one_other) for surface in other]
    counts = [_agreeing(a, b) for a, b in ((one, moved), (moved, one))]
    compared = sum(area for area, _ in counts)
    return compared, sum(area for _, area in counts) / compared if compared else 0.0


def _agreeing(ones: Sequence[Footprint], others: Sequence[Footprint]) -> tuple[float, float]:
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
    one: Sequence[NumberedSign], other: Sequence[NumberedSign], T_one_other: Float64
) -> tuple[int, int]:
    """Return the numbers of door signs that read the same and differently in both maps.

    Parameters
    ----------
    one, other
        Signs of the maps.
    T_one_other
        float64 (3,), planar pose of the second map in the first.
    """
    if not one or not other:
        return 0, 0
    positions = np.array([sign.position for sign in one])
    same = others = 0
    for sign in other:
        xy = transform2(T_one_other, sign.position[None, :2])[0]
        distances = np.linalg.norm(positions - [*xy, sign.position[2]], axis=1)
        nearest = int(np.argmin(distances))
        if distances[nearest] <= MAX_SIGN_DISTANCE:
            is_same = one[nearest].number == sign.number
            same, others = same + is_same, others + (not is_same)
    return same, others
