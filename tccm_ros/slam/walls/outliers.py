"""Outlier rejection of wall observations, and of walls that are not planar."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tccm_ros.config import Config
from tccm_ros.slam.factors.keys import Key
from tccm_ros.slam.graph.pose_graph import PoseGraph
from tccm_ros.slam.walls.association import WallTable, min_confirmations
from tccm_ros.slam.walls.landmarks import wall_factors
from tccm_ros.slam.walls.lines import Lines
from tccm_ros.slam.walls.unit_variance import unit_variance

OBSERVATION_CHI2 = 13.8
"""Gate on the squared Mahalanobis distance of an observation from its wall: 99.9 % of two degrees
of freedom."""

WALL_CHI2 = 3.0
"""Maximum mean squared Mahalanobis distance of a wall's observations (2 is expected); a wall beyond
it is not planar (chosen)."""


class CheckedWalls(NamedTuple):
    """Walls without outliers, and the unit variance of the graph.

    Attributes
    ----------
    table
        The walls.
    unit_variance
        Sum of squared Mahalanobis distances over degrees of freedom: about 1 for correct
        covariances, less for conservative ones.
    """

    table: WallTable
    unit_variance: float


def check_walls(
    table: WallTable,
    lines: Sequence[Lines],
    graph: PoseGraph,
    keys: Sequence[Key],
    config: Config,
) -> CheckedWalls:
    """Remove outliers among observations, and walls that are not straight.

    Parameters
    ----------
    table, lines
        The associated walls, and the lines of all keyframes.
    graph
        Graph with all factors except those of walls, which are added.
    keys, config
        As in `wall_factors`.
    """
    used = np.flatnonzero(table.wall >= 0)
    first, keyframes = len(graph), len(keys)
    factors = wall_factors(table, lines, keys, config)
    graph.add(factors)
    solution = graph.optimise()
    chi2 = 2.0 * solution.errors_of(range(first, first + len(used)))
    wall = table.wall.copy()
    sums = np.bincount(wall[used], weights=chi2, minlength=len(table))
    counts = np.bincount(wall[used], minlength=len(table))
    crooked = sums > WALL_CHI2 * np.maximum(counts, 1)
    wall[used[(chi2 > OBSERVATION_CHI2) | crooked[wall[used]]]] = -1
    held = table.keep(wall, min_confirmations(config, keyframes))
    kept = [x for x, w in zip(factors, held.wall[used]) if w >= 0]
    # Each keyframe but the first has a between and a planar factor; the rest are loop closures.
    rest = 2.0 * float(solution.errors_of(range(first)).sum())
    freedom = 3 * (first - keyframes) - 3 * (keyframes - 1)
    return CheckedWalls(held, unit_variance(solution, kept, rest, freedom))
