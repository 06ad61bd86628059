"""The edges of a compartment as lines, for pictures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import transform
from tccm_ros.racks.compartment import OpenPart

ARROW = 0.16
"""Length of the arrow into a compartment, m; chosen: it is visible beside the edges."""

TIP = 0.25
"""Length and half the width of the arrow's tip, in lengths of the arrow; chosen."""


def box_edges(front: Float64, insertion: Float64, depth: float, height: float) -> Float64:
    """Return line segments of a compartment's edges and of an arrow through its front.

    Parameters
    ----------
    front
        float64 (2, 3), left and right end of the front edge, m.
    insertion
        float64 (3,), unit vector inward.
    depth, height
        Of the compartment, m.

    Returns
    -------
    float64 (15, 2, 3), start and end of each segment, m.
    """
    up = np.array([0.0, 0.0, height])
    low = np.concatenate([front, front[::-1] + depth * insertion])
    high = low + up
    along = np.roll(np.arange(4), -1)
    edges = [np.stack([a, b], axis=1) for a, b in ((low, low[along]), (high, high[along]))]
    tip = front.mean(axis=0)
    aside = (front[1] - front[0]) / max(float(np.linalg.norm(front[1] - front[0])), 1e-9)
    starts = tip - ARROW * np.array(
        [insertion, TIP * (insertion + aside), TIP * (insertion - aside)]
    )
    arrow = np.stack([starts, np.broadcast_to(tip, (3, 3))], axis=1)
    return np.concatenate([*edges, np.stack([low, high], axis=1), arrow])


def part_edges(parts: Sequence[OpenPart]) -> Float64:
    """Return line segments of the edges of the boxes of open parts, float64 (12 N, 2, 3), m."""
    unit = np.array(
        [[x, y, z] for z in (-0.5, 0.5) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    )
    unit[:, :2] *= 0.5
    starts = np.array([0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3])
    ends = np.array([1, 2, 3, 0, 5, 6, 7, 4, 4, 5, 6, 7])
    corners = [transform(part.T_map_part, unit * part.size) for part in parts]
    edges = [np.stack([c[starts], c[ends]], axis=1) for c in corners]
    return np.concatenate([np.zeros((0, 2, 3)), *edges])
