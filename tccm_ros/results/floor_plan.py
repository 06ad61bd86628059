"""Floor plan: walls as line segments with closed corners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.records import Wall

MIN_CORNER_ANGLE_RAD = np.radians(15.0)
"""Minimum angle between walls with a corner. Chosen: the crossing of flatter ones is uncertain."""

MAX_SEEN_CORNER_GAP_M = 0.6
"""Maximum shift of an end to a corner that a scan observed, m. Chosen."""

MAX_CORNER_GAP_M = 0.25
"""Maximum shift of an end to an unobserved corner, m. Chosen: narrower than any door."""

END_TOLERANCE_M = 0.05
"""Uncertainty of ends, m. Chosen: the noise of a scan's line ends."""

End = tuple[int, int]
"""Wall id, and index of the end."""


def close_corners(walls: Sequence[Wall]) -> list[Float64]:
    """Return the ends (2, 2) of each wall, moved to its corners with other walls.

    Walls with a common endpoint (`Wall.corners`) both end at the crossing of their lines. Then, in
    order of distance, two ends near their crossing are moved to it, and an end near the middle of
    another wall is moved onto that wall. Each end is moved at most once.
    """
    by_id = {wall.id: wall for wall in walls}
    ends = {wall.id: np.array(wall.endpoints, float) for wall in walls}
    moved: set[End] = set()
    for wall in walls:
        for other in (by_id[k] for k in wall.corners if k in by_id):
            corner = _crossing(wall, other)
            if corner is None:
                continue
            near = int(np.argmin(np.linalg.norm(wall.endpoints - corner, axis=1)))
            if np.linalg.norm(wall.endpoints[near] - corner) <= MAX_SEEN_CORNER_GAP_M:
                ends[wall.id][near] = corner
                moved.add((wall.id, near))
    crossings = [c for a, b in combinations(walls, 2) if (c := _near_crossing(a, b, ends))]
    for _, members, corner in sorted(crossings, key=lambda c: c[:2]):
        if moved.isdisjoint(members):
            moved.update(members)
            for wall_id, end in members:
                ends[wall_id][end] = corner
    return [ends[wall.id] for wall in walls]


def _near_crossing(
    a: Wall, b: Wall, ends: Mapping[int, Float64]
) -> tuple[float, tuple[End, ...], Float64] | None:
    """Return the gap, the ends to move and the crossing of two walls; None if they are too far.

    A wall that continues beyond the crossing is not shortened; only the other wall's end is moved.
    """
    corner = _crossing(a, b)
    if corner is None:
        return None
    gap, members = 0.0, []
    for wall in (a, b):
        distances = np.linalg.norm(ends[wall.id] - corner, axis=1)
        end = int(np.argmin(distances))
        length = float(np.linalg.norm(ends[wall.id][1] - ends[wall.id][0]))
        continues = distances.sum() <= length + END_TOLERANCE_M and distances[end] > END_TOLERANCE_M
        if distances[end] > MAX_CORNER_GAP_M and not continues:
            return None
        if not continues:
            members.append((wall.id, end))
            gap = max(gap, float(distances[end]))
    return (gap, tuple(members), corner) if members else None


def _crossing(a: Wall, b: Wall) -> Float64 | None:
    """Return the crossing of two lines x cos phi + y sin phi = rho; None if they are parallel."""
    N = np.array([[np.cos(a.phi), np.sin(a.phi)], [np.cos(b.phi), np.sin(b.phi)]])
    if abs(np.linalg.det(N)) < np.sin(MIN_CORNER_ANGLE_RAD):
        return None
    return np.linalg.solve(N, np.array([a.rho, b.rho]))
