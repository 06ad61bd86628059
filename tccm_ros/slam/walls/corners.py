"""Corners: intersections of two walls, observed by keyframes that see both ends."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

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
"""Minimum angle (rad) between two walls of a corner: the intersection of nearly parallel walls is
undefined (chosen)."""

POINT_SIGMA = 0.03
"""Standard deviation (m) of a corner observed as the end of a line, as the last beam hits before it
(chosen: the distance between beams at a few metres)."""

THROUGH_SIGMA = 0.01
"""Standard deviation (m) of the distance of a wall from its corner (chosen)."""

EXACT_SIGMA = 0.001
"""The same (m) if the corner is the wall's endpoint, so that both have one position: a thirtieth of
`POINT_SIGMA`. With a hundredth, Levenberg-Marquardt does not converge in a flat
(``bench/mspace_corners.py``)."""


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
    seen = shared_ends(table, lines)
    return [
        Corner(a, b, *seen[a, b]) for a, b in sorted(seen) if len(seen[a, b][0]) >= min_keyframes
    ]


def shared_ends(
    table: WallTable, lines: Sequence[Lines]
) -> defaultdict[tuple[int, int], tuple[list[int], list[Float64]]]:
    """Return the observations of two wall ends that meet.

    Parameters
    ----------
    table, lines
        As in `find_corners`.

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
    """Return the midpoint (2,) of two line ends that meet, or None."""
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

    Matching uses all beams of a scan, including those at corners. With matching, corners only add
    the noise of the last beams of lines.
    """
    walls = config.walls
    if not walls.enabled or walls.corners == "none":
        return False
    return walls.corners != "auto" or not config.matching.enabled


def corner_factors(
    corners: Sequence[Corner],
    table: WallTable,
    keys: Sequence[Key],
    config: Config,
    numbers: Iterable[int] | None = None,
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
    numbers
        Indices of the corners to return factors for; all by default.
    """
    is_exact, factors = config.walls.corners == "endpoint", list[Factor]()
    ends = _endpoints(corners, table) if is_exact else set()
    for n in range(len(corners)) if numbers is None else numbers:
        corner, key = corners[n], corner_key(n)
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
