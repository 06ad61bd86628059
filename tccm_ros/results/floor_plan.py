"""The floor plan: walls as lines whose corners are closed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.records import Wall

__all__ = ["close_corners"]


LEAST_ANGLE = np.radians(15.0)
"""Walls nearer to parallel than this have no corner."""

REACH = 0.6
"""A wall is drawn longer or shorter by this much, m, at most, to meet its neighbour."""

NEAR = 0.25
"""The same, where no scan showed that they share a corner: no door is as narrow."""

TOUCH = 0.05
"""Ends are known this well, m."""

End = tuple[int, int]
"""Wall id, and which of its ends."""


def close_corners(walls: Sequence[Wall]) -> list[Float64]:
    """Return the ends (2, 2) of each wall, moved onto the corners with others.

    Walls know the walls that share an endpoint with them; both are drawn to the point where their
    lines cross. Then, the nearest first, ends that nearly meet are drawn together, and an end that
    nearly meets the middle of another wall is drawn onto it. Each end is moved once.
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
            if np.linalg.norm(wall.endpoints[near] - corner) <= REACH:
                ends[wall.id][near] = corner
                moved.add((wall.id, near))
    meetings = [m for a, b in combinations(walls, 2) if (m := _meeting(a, b, ends)) is not None]
    for _, members, corner in sorted(meetings, key=lambda m: m[:2]):
        if moved.isdisjoint(members):
            moved.update(members)
            for wall_id, end in members:
                ends[wall_id][end] = corner
    return [ends[wall.id] for wall in walls]


def _meeting(
    a: Wall, b: Wall, ends: Mapping[int, Float64]
) -> tuple[float, tuple[End, ...], Float64] | None:
    """Return how far which ends of two walls are from where these nearly meet; None: they do not.

    A wall that goes on beyond the crossing is not cut: the other's end lies on its middle.
    """
    corner = _crossing(a, b)
    if corner is None:
        return None
    gap, members = 0.0, []
    for wall in (a, b):
        away = np.linalg.norm(ends[wall.id] - corner, axis=1)
        end = int(np.argmin(away))
        length = float(np.linalg.norm(ends[wall.id][1] - ends[wall.id][0]))
        goes_on = away.sum() <= length + TOUCH and away[end] > TOUCH
        if away[end] > NEAR and not goes_on:
            return None
        if not goes_on:
            members.append((wall.id, end))
            gap = max(gap, float(away[end]))
    return (gap, tuple(members), corner) if members else None


def _crossing(a: Wall, b: Wall) -> Float64 | None:
    """Return where two lines x cos phi + y sin phi = rho cross; None where they are parallel."""
    N = np.array([[np.cos(a.phi), np.sin(a.phi)], [np.cos(b.phi), np.sin(b.phi)]])
    if abs(np.linalg.det(N)) < np.sin(LEAST_ANGLE):
        return None
    return np.linalg.solve(N, np.array([a.rho, b.rho]))
