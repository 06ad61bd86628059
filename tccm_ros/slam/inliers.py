"""Selection of the loop closures and walls that enter the final graph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from tccm_ros.arrays import Bool, Float64
from tccm_ros.config import Config
from tccm_ros.records import Loop, RefusedSign
from tccm_ros.slam.chain import Chain
from tccm_ros.slam.landmarks import AnchoredObservation, landmark_factors
from tccm_ros.slam.loops.closing import LoopCloser
from tccm_ros.slam.loops.consistency import select_loops
from tccm_ros.slam.loops.matching import LoopReason, Proposal
from tccm_ros.slam.signs.landmarks import FoundSign, Passes, find_signs
from tccm_ros.slam.signs.views import PictureView, SignView
from tccm_ros.slam.walls.association import WallTable, associate_walls, min_confirmations
from tccm_ros.slam.walls.corners import Corner, find_corners
from tccm_ros.slam.walls.lines import Lines
from tccm_ros.slam.walls.outliers import check_walls

SHARED_BEAMS_FACTOR = 2.3
"""Factor on the reported covariances where walls and matching use the same beams (measured: NEES on
simulated rings, docs/design/experiments/wall_slam.md)."""


@dataclass(frozen=True, slots=True, eq=False)
class Inliers:
    """The loop closures, walls and landmark observations that constrain the keyframes.

    Attributes
    ----------
    poses
        float64 (K, 3), the keyframes by odometry, matching, loops and landmarks.
    loops, records
        The loop closures, and the record of these and of what was rejected.
    walls, corners
        The walls that fit, and the points where they meet.
    scale
        Factor by which covariances of the graph are to be multiplied.
    observations
        Of landmarks, as given: their kinds choose robust noise models themselves.
    signs, refused_signs
        Door signs, of the views that agree, and what was read and is none.
    """

    poses: Float64
    loops: list[Proposal]
    records: list[Loop]
    walls: WallTable
    corners: list[Corner]
    scale: float
    observations: list[AnchoredObservation]
    signs: list[FoundSign]
    refused_signs: list[RefusedSign]


def select_inliers(
    closer: LoopCloser,
    chain: Chain,
    lines: list[Lines],
    observations: list[AnchoredObservation],
    sign_views: Sequence[SignView],
    pictures: Sequence[PictureView],
    config: Config,
) -> Inliers:
    """Take out loop closures that contradict the rest, then lines, walls and views of signs.

    Parameters
    ----------
    closer, chain
        Loops as found while driving, and the keyframes.
    lines
        The lines of each keyframe.
    observations
        Of landmarks, in the order in which they enter the graph.
    sign_views
        Of door signs, in the order in which they were taken.
    pictures
        Those in which signs were looked for, in the order of their stamps.
    config
        ``walls.*`` and ``lines.*``.
    """
    keys, seen = chain.keys, landmark_factors(observations)
    graph = chain.graph(closer.poses, closer.constrained, seen.anchored)
    graph.add(seen.factors)
    poses, kept = select_loops(graph, keys, closer.accepted)
    loops = [p for p, ok in zip(closer.accepted, kept) if ok]
    # Without landmarks: the question is how well keyframes, loops and walls fit each other.
    graph = chain.graph(poses, closer.constrained)
    graph.add([p.factor(keys) for p in loops])
    table = associate_walls(poses, lines, config)
    checked = check_walls(table, lines, poses, graph, keys, config)
    scale = checked.unit_variance * (SHARED_BEAMS_FACTOR if len(checked.table) else 1.0)
    corners = find_corners(checked.table, lines, min_confirmations(config, len(keys)))
    records = loop_records(closer, kept)
    signs: list[FoundSign] = []
    refused: list[RefusedSign] = []
    if sign_views:
        passes = Passes(graph.optimise(), keys, [k.session for k in chain.keyframes])
        signs, refused = find_signs(sign_views, pictures, passes, checked.table)
    return Inliers(
        poses, loops, records, checked.table, corners, scale, observations, signs, refused
    )


def loop_records(closer: LoopCloser, kept: Sequence[bool] | Bool) -> list[Loop]:
    """Return the records of all proposals: those kept, those that contradict them, the others.

    Parameters
    ----------
    closer
        Has them.
    kept
        bool (L,), one for each that it has accepted.
    """
    checked = list(zip(closer.accepted, kept))
    proposals = [replace(p, reason=LoopReason.CONSISTENT) for p, ok in checked if ok]
    proposals += [replace(p, reason=LoopReason.CONTRADICTED) for p, ok in checked if not ok]
    proposals += [*closer.rejected, *closer.unconfirmed]
    accepted = LoopReason.CONSISTENT
    return [Loop(p.a, p.b, p.delta, p.reason == accepted, p.reason) for p in proposals]
