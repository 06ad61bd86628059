"""Submaps and merged scans: consecutive keyframes as one map, and as one large scan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import between2
from tccm_ros.slam.front_end import GraphKeyframe
from tccm_ros.slam.matching.level_scan import LevelScan
from tccm_ros.slam.matching.likelihood_grid import LikelihoodGrid, make_likelihood_grid
from tccm_ros.slam.matching.line_map import LineMap, make_line_map
from tccm_ros.slam.se2 import transform_points

MERGED_POINTS = 220
"""Maximum number of points of a merged scan: more do not improve a match (chosen)."""

SEARCH_POINTS = 110
"""Maximum number of points in a correlative search (chosen)."""


@dataclass(frozen=True, slots=True, eq=False)
class Submap:
    """Several keyframes as one map.

    Attributes
    ----------
    centre
        Id of the keyframe whose frame the map has.
    lines
        Line map for alignment.
    grid
        Likelihood grid for the correlative search, with free space.
    """

    centre: int
    lines: LineMap
    grid: LikelihoodGrid


@dataclass(frozen=True, slots=True, eq=False)
class MergedScan:
    """Several keyframes as one scan.

    Attributes
    ----------
    centre
        Id of the keyframe whose frame the points have.
    points, normals
        float64 (N, 2), m and unit vectors; zero normals where the neighbourhood is not flat.
    search_points
        float64 (M, 2), fewer points for the correlative search.
    """

    centre: int
    points: Float64
    normals: Float64
    search_points: Float64


def make_submap(keyframes: Sequence[GraphKeyframe], centre: int, half: int) -> Submap:
    """Return a submap built with the front end's estimates.

    Parameters
    ----------
    keyframes
        Keyframes of all sessions.
    centre
        Id of the central keyframe.
    half
        Number of keyframes on either side, of the same session.
    """
    poses, scans = _members(keyframes, centre, half)
    lines = make_line_map(poses, scans)
    origins = [transform_points(q, scan.origin[None]) for q, scan in zip(poses, scans)]
    ends = np.concatenate([transform_points(q, scan.points) for q, scan in zip(poses, scans)])
    counts = [len(scan.points) for scan in scans]
    rays = np.repeat(np.concatenate(origins), counts, axis=0), ends
    return Submap(centre, lines, make_likelihood_grid(lines.points, rays=rays))


def merge_scans(keyframes: Sequence[GraphKeyframe], centre: int, half: int) -> MergedScan:
    """Return a merged scan, built with estimates of the front end; its central scan comes first.

    Parameters
    ----------
    keyframes
        Keyframes of all sessions.
    centre
        Id of the central keyframe.
    half
        Number of keyframes on either side, of the same session.
    """
    lines = make_line_map(*_members(keyframes, centre, half, nearest_first=True))
    return MergedScan(
        centre,
        _evenly(lines.points, MERGED_POINTS),
        _evenly(lines.normals, MERGED_POINTS),
        _evenly(lines.points, SEARCH_POINTS),
    )


def _members(
    keyframes: Sequence[GraphKeyframe], centre: int, half: int, *, nearest_first: bool = False
) -> tuple[Float64, list[LevelScan]]:
    """Return the keyframes within `half` of `centre` in its session, without a gap.

    Returns
    -------
    Poses float64 (K, 3) in the central keyframe, and the scans
    """
    first = last = centre
    session = keyframes[centre].session
    while first > max(0, centre - half) and keyframes[first - 1].session == session:
        first -= 1
    end = min(len(keyframes) - 1, centre + half)
    while last < end and keyframes[last + 1].session == session:
        last += 1
    order = list(range(first, last + 1))
    if nearest_first:
        order.sort(key=lambda k: (abs(k - centre), k))
    poses = between2(keyframes[centre].pose, np.stack([keyframes[k].pose for k in order]))
    return poses, [keyframes[k].scan for k in order]


def _evenly(rows: Float64, max_rows: int) -> Float64:
    """Return at most `max_rows` rows, evenly spaced in their order."""
    if len(rows) <= max_rows:
        return rows
    return np.ascontiguousarray(rows[np.linspace(0, len(rows) - 1, max_rows).astype(np.int64)])
