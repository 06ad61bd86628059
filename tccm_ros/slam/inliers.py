"""Selection of the loop closures, walls and landmark observations of the final graph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from tccm_ros.arrays import Bool, Float64
from tccm_ros.config import Config
from tccm_ros.records import Loop, RefusedSign
from tccm_ros.slam.chain import KeyframeChain
from tccm_ros.slam.landmarks import AnchoredObservation, landmark_factors
from tccm_ros.slam.loops.closing import LoopCloser
from tccm_ros.slam.loops.consistency import select_loops
from tccm_ros.slam.loops.matching import LoopReason, Proposal
from tccm_ros.slam.signs.landmarks import FoundSign, find_signs
from tccm_ros.slam.signs.views import PictureView, SignView
from tccm_ros.slam.walls.association import WallTable, associate_walls, min_confirmations
from tccm_ros.slam.walls.corners import Corner, find_corners
from tccm_ros.slam.walls.lines import Lines
from tccm_ros.slam.walls.outliers import check_walls

SHARED_BEAMS_FACTOR = 3.2
"""Factor on the reported covariances where walls and matching use the same beams: residuals lack
the error that both have in common. The normalised squared error of all keyframes of ten simulated
rings is then 0.97 (``python bench/bench_slam.py --seeds 10``)."""


@dataclass(frozen=True, slots=True, eq=False)
class Inliers:
    """The loop closures, walls and landmark observations that constrain the keyframes.

    Attributes
    ----------
    poses
        float64 (K, 3), keyframe poses from odometry, matching, loop closures and landmarks.
    loops, records
        The accepted loop closures, and the records of accepted and rejected ones.
    walls, corners
        The inlier walls, and their corners.
    scale
        Factor to apply to the graph's covariances.
    observations
        Landmark observations, unfiltered: their kinds use robust noise models.
    signs, refused_signs
        Door signs with consistent views, and rejected readings of room numbers.
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
    chain: KeyframeChain,
    lines: list[Lines],
    observations: list[AnchoredObservation],
    sign_views: Sequence[SignView],
    pictures: Sequence[PictureView],
    config: Config,
) -> Inliers:
    """Reject inconsistent loop closures, then lines, walls and views of signs.

    Parameters
    ----------
    closer, chain
        Loop closures found while driving, and the keyframes.
    lines
        The lines of each keyframe.
    observations
        Landmark observations, in the order in which they enter the graph.
    sign_views
        Views of door signs, in the order of the pictures.
    pictures
        Pictures that were searched for signs, in stamp order.
    config
        Groups ``walls`` and ``lines``.
    """
    keys, seen = chain.keys, landmark_factors(observations)
    starts = closer.fixed_starts(closer.accepted, observations)
    graph = chain.graph(closer.poses, starts, seen.anchored)
    graph.add(seen.factors)
    poses, kept = select_loops(graph, keys, closer.accepted)
    loops = [p for p, ok in zip(closer.accepted, kept) if ok]
    # Without landmarks, to test the consistency of keyframes, loop closures and walls.
    graph = chain.graph(poses, closer.fixed_starts(loops))
    graph.add([p.factor(keys) for p in loops])
    table = associate_walls(poses, lines, config)
    checked = check_walls(table, lines, poses, graph, keys, config)
    scale = checked.unit_variance * (SHARED_BEAMS_FACTOR if len(checked.table) else 1.0)
    corners = find_corners(checked.table, lines, min_confirmations(config, len(keys)))
    records = loop_records(closer, kept)
    signs: list[FoundSign] = []
    refused: list[RefusedSign] = []
    if sign_views:
        without = graph.optimise()
        signs, refused = find_signs(sign_views, pictures, without, chain, checked.table)
    return Inliers(
        poses, loops, records, checked.table, corners, scale, observations, signs, refused
    )


def loop_records(closer: LoopCloser, kept: Sequence[bool] | Bool) -> list[Loop]:
    """Return the records of all proposals: accepted, contradicted, and the others.

    Parameters
    ----------
    closer
        The loop closer with the proposals.
    kept
        bool (L,), for each proposal accepted by it, whether it is consistent.
    """
    checked = list(zip(closer.accepted, kept))
    proposals = [replace(p, reason=LoopReason.CONSISTENT) for p, ok in checked if ok]
    proposals += [replace(p, reason=LoopReason.CONTRADICTED) for p, ok in checked if not ok]
    proposals += [*closer.rejected, *closer.unconfirmed]
    accepted = LoopReason.CONSISTENT
    return [Loop(p.a, p.b, p.delta, p.reason == accepted, p.reason) for p in proposals]
