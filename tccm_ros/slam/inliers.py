"""What enters the final graph: the loop closures and walls that fit with everything else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from tccm_ros.arrays import Bool, Float64
from tccm_ros.config import Config
from tccm_ros.records import Loop
from tccm_ros.slam.chain import Chain
from tccm_ros.slam.corners import Corner, find_corners
from tccm_ros.slam.landmarks import Sighting, landmark_factors
from tccm_ros.slam.lines import Lines
from tccm_ros.slam.loop_consistency import select_loops
from tccm_ros.slam.loop_matching import LoopReason, Proposal
from tccm_ros.slam.loops import LoopCloser
from tccm_ros.slam.wall_outliers import check_walls
from tccm_ros.slam.walls import WallTable, associate_walls, confirmations

__all__ = ["Inliers", "select_inliers"]


USED_TWICE = 2.3
"""Multiplies the reported covariances where walls and matching have used the same beams: the NEES
of simulated rings says how much of the information is the same."""


@dataclass(frozen=True, slots=True, eq=False)
class Inliers:
    """What keyframes are tied by.

    Attributes
    ----------
    poses
        float64 (K, 3), the keyframes by odometry, matching, loops and landmarks.
    loops, records
        The loop closures, and the record of these and of what was rejected.
    walls, corners
        The walls as associated, and where they meet.
    scale
        What covariances of the graph are to be multiplied by.
    sightings
        Landmarks as given: their kinds say what is robust.
    """

    poses: Float64
    loops: list[Proposal]
    records: list[Loop]
    walls: WallTable
    corners: list[Corner]
    scale: float
    sightings: list[Sighting]


def select_inliers(
    closer: LoopCloser,
    chain: Chain,
    lines: list[Lines],
    sightings: list[Sighting],
    config: Config,
) -> Inliers:
    """Take out loops that contradict the rest, then lines and walls that do.

    Parameters
    ----------
    closer, chain
        Loops as found while driving, and the keyframes.
    lines
        What each keyframe sees.
    sightings
        Landmarks, in the order in which they enter the graph.
    config
        ``walls.*`` and ``lines.*``.
    """
    keys, seen = chain.keys, landmark_factors(sightings)
    graph = chain.graph(closer.poses, closer.tied, seen.hung)
    graph.add(seen.factors)
    poses, kept = select_loops(graph, keys, closer.accepted)
    loops = [p for p, ok in zip(closer.accepted, kept) if ok]
    # Without landmarks: the question is how well keyframes, loops and walls fit each other.
    graph = chain.graph(poses, closer.tied)
    graph.add([p.factor(keys) for p in loops])
    table = associate_walls(poses, lines, config)
    checked = check_walls(table, lines, poses, graph, keys, config)
    scale = checked.unit_variance * (USED_TWICE if config.walls.enabled else 1.0)
    corners = find_corners(checked.table, lines, confirmations(config, len(keys)))
    records = _loop_records(closer, kept)
    return Inliers(poses, loops, records, checked.table, corners, scale, sightings)


def _loop_records(closer: LoopCloser, kept: Sequence[bool] | Bool) -> list[Loop]:
    """Return all proposals: those that are kept, those that contradict them, and the others."""
    judged = list(zip(closer.accepted, kept))
    proposals = [replace(p, reason=LoopReason.CONSISTENT) for p, ok in judged if ok]
    proposals += [replace(p, reason=LoopReason.CONTRADICTED) for p, ok in judged if not ok]
    proposals += [*closer.rejected, *closer.unconfirmed]
    accepted = LoopReason.CONSISTENT
    return [Loop(p.a, p.b, p.delta, p.reason == accepted, p.reason) for p in proposals]
