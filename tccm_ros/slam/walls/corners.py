"""Corners: points where two walls meet, from keyframes that saw both ends."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.slam.factors.corners import CornerObservation, WallThroughCorner
from tccm_ros.slam.factors.factor import Factor
from tccm_ros.slam.factors.keys import Key, corner_key, wall_key
from tccm_ros.slam.walls.association import WallTable
from tccm_ros.slam.walls.lines import Lines

JOINED = 0.25
"""Maximum distance (m) between the ends of two lines that meet (chosen)."""

MIN_ANGLE = 0.5
"""Minimum angle (rad) between walls that meet: nearly parallel ones have no point in common
(chosen)."""

POINT_SIGMA = 0.03
"""Standard deviation (m) of a corner seen as the end of a line: the last beam hits short of it
(chosen: the distance between beams at a few metres)."""

THROUGH_SIGMA = 0.01
"""Standard deviation (m) of the distance of a wall from its corner (chosen)."""


class Corner(NamedTuple):
    """A point where two walls meet.

    Attributes
    ----------
    a, b
        Indices of the walls, a < b.
    keyframes
        Ids of the keyframes that saw it.
    points
        float64 (2,) for each of them: the corner in its base frame, m.
    """

    a: int
    b: int
    keyframes: list[int]
    points: list[Float64]


def find_corners(table: WallTable, lines: Sequence[Lines], min_keyframes: int) -> list[Corner]:
    """Find the corners that enough keyframes saw.

    Parameters
    ----------
    table
        Walls and their observations.
    lines
        The lines of each keyframe, in its base frame.
    min_keyframes
        Keyframes that must see a corner.

    Returns
    -------
    list of Corner
        In the order of their walls.
    """
    seen = shared_ends(table, lines)
    return [
        Corner(a, b, *seen[a, b]) for a, b in sorted(seen) if len(seen[a, b][0]) >= min_keyframes
    ]


def shared_ends(
    table: WallTable, lines: Sequence[Lines]
) -> defaultdict[tuple[int, int], tuple[list[int], list[Float64]]]:
    """Return where keyframes saw the ends of two walls meet.

    Parameters
    ----------
    table, lines
        As for `find_corners`.

    Returns
    -------
    defaultdict of lists
        By the indices of two walls, the smaller first: keyframes, and points float64 (2,) in their
        base frames, m
    """
    seen: defaultdict[tuple[int, int], tuple[list[int], list[Float64]]] = defaultdict(
        lambda: ([], [])
    )
    at = np.flatnonzero(table.wall >= 0)
    for group in np.split(at, np.flatnonzero(np.diff(table.keyframe[at])) + 1):
        for n, i in enumerate(group):
            for j in group[n + 1 :]:
                k = int(table.keyframe[i])
                point = _shared_end(lines[k], int(table.line[i]), int(table.line[j]))
                a, b = sorted((int(table.wall[i]), int(table.wall[j])))
                if point is not None and a != b:
                    seen[a, b][0].append(k)
                    seen[a, b][1].append(point)
    return seen


def _shared_end(lines: Lines, i: int, j: int) -> Float64 | None:
    """Return the middle (2,) of two line ends that meet, or None."""
    dphi = lines.phi[i] - lines.phi[j]
    if abs(np.sin(dphi)) < np.sin(MIN_ANGLE):
        return None
    gaps = np.hypot(*np.moveaxis(lines.endpoints[i][:, None] - lines.endpoints[j][None], 2, 0))
    p, q = divmod(int(np.argmin(gaps)), 2)
    if gaps[p, q] > JOINED:
        return None
    return np.asarray(0.5 * (lines.endpoints[i, p] + lines.endpoints[j, q]))


def uses_corners(config: Config) -> bool:
    """Return whether corners are landmarks of the graph.

    Matching places a scan by all its beams, those of corners among them. Where it does, corners add
    nothing but the noise of the last beams of lines.
    """
    walls = config.walls
    if not walls.enabled or walls.corners == "none":
        return False
    return walls.corners == "point" or not config.matching.enabled


def corner_factors(
    corners: Sequence[Corner], table: WallTable, keys: Sequence[Key], first: int = 0
) -> list[Factor]:
    """Return the factors that make each corner one point of two walls.

    Parameters
    ----------
    corners
        As found.
    table
        The walls; their directions say along which normal a wall is constrained.
    keys
        Variables of all keyframes.
    first
        Number of the first corner.
    """
    factors: list[Factor] = []
    for n, corner in enumerate(corners, first):
        key = corner_key(n)
        # All observations of one corner end at the same last beam: together they count as one.
        sigma = POINT_SIGMA * float(np.sqrt(len(corner.points)))
        for k, point in zip(corner.keyframes, corner.points):
            factors.append(CornerObservation(keys[k], key, point, sigma))
        for w in (corner.a, corner.b):
            through = WallThroughCorner(key, wall_key(w), float(table.phi[w]), THROUGH_SIGMA)
            factors.append(through)
    return factors


def meeting_point(phi: Sequence[float], rho: Sequence[float]) -> Float64:
    """Return the point (2,) that two lines (phi, rho) have in common."""
    normals = np.stack([np.cos(phi), np.sin(phi)], axis=1)
    return np.asarray(np.linalg.solve(normals, np.asarray(rho, float)))
