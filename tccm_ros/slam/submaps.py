"""Submaps: a few consecutive keyframes as one map, and as one large scan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import between2
from tccm_ros.slam.front_end import GraphKeyframe
from tccm_ros.slam.likelihood_grid import LikelihoodGrid, make_likelihood_grid
from tccm_ros.slam.line_map import LineMap, make_line_map
from tccm_ros.slam.se2 import place

__all__ = ["Patch", "Submap", "make_patch", "make_submap"]


PATCH_POINTS = 220
"""Points of a patch at most: more do not sharpen a match."""

SEARCH_POINTS = 110
"""Points that a wide search scores at most."""


@dataclass(frozen=True, slots=True, eq=False)
class Submap:
    """The keyframes around `centre`, in its frame."""

    centre: int
    lines: LineMap
    grid: LikelihoodGrid


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """Points and normals, float64 (N, 2), of the scans around keyframe `centre`, in its frame."""

    centre: int
    points: Float64
    normals: Float64
    search_points: Float64


def make_submap(keyframes: Sequence[GraphKeyframe], centre: int, half: int) -> Submap:
    """Put the keyframes within `half` of `centre` into one map, as the front end placed them."""
    first, last = _range(keyframes, centre, half)
    members = keyframes[first : last + 1]
    poses = between2(keyframes[centre].pose, np.stack([k.pose for k in members]))
    lines = make_line_map(poses, [k.scan for k in members])
    origins = [place(q, k.scan.origin[None]) for q, k in zip(poses, members)]
    counts = [len(k.scan.points) for k in members]
    ends = np.concatenate([place(q, k.scan.points) for q, k in zip(poses, members)])
    rays = np.repeat(np.concatenate(origins), counts, axis=0), ends
    grid = make_likelihood_grid(lines.points, rays=rays)
    return Submap(centre, lines, grid)


def make_patch(keyframes: Sequence[GraphKeyframe], centre: int, half: int) -> Patch:
    """Gather the scans within `half` of `centre`, the central one first and whole."""
    first, last = _range(keyframes, centre, half)
    order = sorted(range(first, last + 1), key=lambda k: (abs(k - centre), k))
    poses = between2(keyframes[centre].pose, np.stack([keyframes[k].pose for k in order]))
    lines = make_line_map(poses, [keyframes[k].scan for k in order])
    return Patch(
        centre,
        _evenly(lines.points, PATCH_POINTS),
        _evenly(lines.normals, PATCH_POINTS),
        _evenly(lines.points, SEARCH_POINTS),
    )


def _range(keyframes: Sequence[GraphKeyframe], centre: int, half: int) -> tuple[int, int]:
    """Return first and last keyframe within `half` of `centre` and of its session."""
    first = last = centre
    session = keyframes[centre].session
    while first > max(0, centre - half) and keyframes[first - 1].session == session:
        first -= 1
    end = min(len(keyframes) - 1, centre + half)
    while last < end and keyframes[last + 1].session == session:
        last += 1
    return first, last


def _evenly(rows: Float64, most: int) -> Float64:
    """Return at most `most` rows, evenly spread over their order in the bucket grid."""
    if len(rows) <= most:
        return rows
    return np.ascontiguousarray(rows[np.linspace(0, len(rows) - 1, most).astype(np.int64)])
