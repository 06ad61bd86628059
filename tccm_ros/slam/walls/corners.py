"""Corners: intersections of two walls, observed by keyframes that see both ends."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tccm_ros.arrays import Float64, Int64
from tccm_ros.config import Config
from tccm_ros.slam.factors.corners import CornerObservation, WallThroughCorner
from tccm_ros.slam.factors.factor import Factor
from tccm_ros.slam.factors.keys import Key, corner_key, wall_key
from tccm_ros.slam.walls.association import WallTable
from tccm_ros.slam.walls.lines import Lines

JOINED = 0.25
"""Maximum distance (m) between the ends of two lines that meet (chosen)."""

MIN_ANGLE = 0.5
"""Minimum angle (rad) between two walls of a corner: the intersection of nearly parallel walls is
undefined (chosen)."""

POINT_SIGMA = 0.03
"""Standard deviation (m) of a corner observed as the end of a line, as the last beam hits before it
(chosen: the distance between beams at a few metres)."""

THROUGH_SIGMA = 0.01
"""Standard deviation (m) of the distance of a wall from its corner (chosen)."""

EXACT_SIGMA = 0.001
"""Standard deviation (m) of the distance of a wall from its endpoint, so that both have one
position: a thirtieth of `POINT_SIGMA`. With a hundredth, Levenberg-Marquardt does not converge in a
flat (docs/design/experiments/wall_slam.md)."""


class Corner(NamedTuple):
    """A point where two walls meet.

    Attributes
    ----------
    a, b
        Indices of the walls, a < b.
    keyframes
        Ids of the observing keyframes.
    points
        float64 (2,) for each of them: the corner in its base frame, m.
    """

    a: int
    b: int
    keyframes: list[int]
    points: list[Float64]


def find_corners(table: WallTable, lines: Sequence[Lines], min_keyframes: int) -> list[Corner]:
    """Return the corners with enough observations.

    Parameters
    ----------
    table
        Walls and their observations.
    lines
        The lines of each keyframe, in its base frame.
    min_keyframes
        Minimum number of observing keyframes.

    Returns
    -------
    list of Corner
        In the order of their walls.
    """
    rows = np.flatnonzero(table.wall >= 0)
    if not len(rows):
        return []
    first = np.cumsum([0, *map(len, lines)])
    line_rows = first[table.keyframe[rows]] + table.line[rows]
    phi = np.concatenate([x.phi for x in lines])[line_rows]
    ends = np.concatenate([x.endpoints for x in lines])[line_rows]
    keyframe, wall = table.keyframe[rows], table.wall[rows]
    i, j = _pairs(keyframe)
    gaps = np.hypot(*np.moveaxis(ends[i][:, :, None] - ends[j][:, None], 3, 0)).reshape(-1, 4)
    p, q = np.divmod(np.argmin(gaps, axis=1), 2)
    meets = np.abs(np.sin(phi[i] - phi[j])) >= np.sin(MIN_ANGLE)
    meets &= (gaps.min(axis=1, initial=np.inf) <= JOINED) & (wall[i] != wall[j])
    point, seen_by = 0.5 * (ends[i, p] + ends[j, q])[meets], keyframe[i][meets]
    walls = np.sort(np.stack([wall[i], wall[j]], axis=1)[meets], axis=1)
    order = np.lexsort(walls.T[::-1])
    groups = np.split(order, np.flatnonzero(np.diff(walls[order], axis=0).any(axis=1)) + 1)
    return [
        Corner(int(walls[g[0], 0]), int(walls[g[0], 1]), seen_by[g].tolist(), [*point[g]])
        for g in groups
        if len(g) >= min_keyframes
    ]


def _pairs(keyframe: Int64) -> tuple[Int64, Int64]:
    """Return the pairs i < j of lines of one keyframe, in order; keyframes (N,) are ascending."""
    pairs, gap = [np.zeros((0, 2), np.int64)], 1
    while (same := np.flatnonzero(keyframe[gap:] == keyframe[:-gap])).size:
        pairs.append(np.stack([same, same + gap], axis=1))
        gap += 1
    i, j = np.concatenate(pairs).T
    order = np.lexsort([j, i])
    return i[order], j[order]


def uses_corners(config: Config) -> bool:
    """Return whether corners are landmarks of the graph.

    Matching uses all beams of a scan, including those at corners. With matching, corners only add
    the noise of the last beams of lines.
    """
    walls = config.walls
    if not walls.enabled or walls.corners == "none":
        return False
    return walls.corners != "auto" or not config.matching.enabled


def corner_factors(
    corners: Sequence[Corner], table: WallTable, keys: Sequence[Key], config: Config
) -> list[Factor]:
    """Return the factors that make each corner a common point of two walls.

    With ``walls.corners: endpoint``, a wall is determined by its corners: its parameters are
    functions of the corners' positions, which it has in common with other walls. This is the form
    of the surface mapping paper (III.C), whose walls are features of the M-space.

    Parameters
    ----------
    corners
        Corners from `find_corners`.
    table
        The walls; their directions give the normals along which they are constrained.
    keys
        Variables of all keyframes.
    config
        Parameter ``walls.corners``.
    """
    is_exact, factors = config.walls.corners == "endpoint", list[Factor]()
    ends = _endpoints(corners, table) if is_exact else set()
    for n, corner in enumerate(corners):
        key = corner_key(corner.a, corner.b)
        walls = [w for w in (corner.a, corner.b) if not is_exact or (w, n) in ends]
        if not walls:
            continue
        # All observations of a corner end at the same last beam: together they count as one.
        sigma = POINT_SIGMA * float(np.sqrt(len(corner.points)))
        for k, point in zip(corner.keyframes, corner.points):
            factors.append(CornerObservation(keys[k], key, point, sigma))
        through = EXACT_SIGMA if is_exact else THROUGH_SIGMA
        for w in walls:
            factors.append(WallThroughCorner(key, wall_key(w), float(table.phi[w]), through))
    return factors


def _endpoints(corners: Sequence[Corner], table: WallTable) -> set[tuple[int, int]]:
    """Return pairs of a wall and the index of its outermost corner at one end."""
    outermost: dict[tuple[int, bool], tuple[float, int]] = {}
    for n, corner in enumerate(corners):
        pair = [corner.a, corner.b]
        point = meeting_point(table.phi[pair], table.rho[pair])
        for w in pair:
            tangent = np.array([-np.sin(table.phi[w]), np.cos(table.phi[w])])
            along = float(point @ tangent - table.extent[w].mean())
            end = w, along > 0.0
            outermost[end] = max(outermost.get(end, (0.0, n)), (abs(along), n))
    return {(w, n) for (w, _), (_, n) in outermost.items()}


def meeting_point(phi: ArrayLike, rho: ArrayLike) -> Float64:
    """Return the intersection (2,) of two lines (phi, rho)."""
    normals = np.stack([np.cos(phi), np.sin(phi)], axis=1)
    return np.asarray(np.linalg.solve(normals, np.asarray(rho, float)))
