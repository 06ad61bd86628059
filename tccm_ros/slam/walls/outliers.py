"""Outlier rejection of wall observations, and of walls that are not planar."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import wrap_angle
from tccm_ros.slam.factors.keys import Key
from tccm_ros.slam.graph.pose_graph import PoseGraph
from tccm_ros.slam.se2 import transform_points
from tccm_ros.slam.walls.association import WallTable, min_confirmations
from tccm_ros.slam.walls.landmarks import wall_factors
from tccm_ros.slam.walls.lines import Lines
from tccm_ros.slam.walls.unit_variance import unit_variance

OBSERVATION_CHI2 = 13.8
"""Gate on the squared Mahalanobis distance of an observation from its wall: 99.9 % of two degrees
of freedom."""

GATE_FACTOR, GATE_SIGMAS = 2.0, 3.0
"""An observation has a wrong wall if it is further from the median of the wall than `GATE_FACTOR`
times ``walls.gate_distance``, or rotated by more than ``walls.gate_angle`` plus `GATE_SIGMAS`
standard deviations (chosen)."""

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
    poses: Float64,
    graph: PoseGraph,
    keys: Sequence[Key],
    config: Config,
) -> CheckedWalls:
    """Remove outliers among observations, and walls that are not straight.

    Parameters
    ----------
    table, lines
        The associated walls, and the lines of all keyframes.
    poses
        float64 (K, 3), poses of the keyframes optimised without walls.
    graph
        Graph with all factors except those of walls, which are added.
    keys, config
        As in `wall_factors`.
    """
    table = _without_wrong_labels(table, lines, poses, config)
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


def _without_wrong_labels(
    table: WallTable, lines: Sequence[Lines], poses: Float64, config: Config
) -> WallTable:
    """Remove observations that are far from the median of their wall.

    They belong to another wall. A median is robust against up to half of them; least squares is not
    robust against one.
    """
    used = np.flatnonzero(table.wall >= 0)
    if not len(used):
        return table
    rows = [(lines[k], i, poses[k]) for k, i in zip(table.keyframe[used], table.line[used])]
    phi = np.array([x.phi[i] + pose[2] for x, i, pose in rows])
    sigma = np.sqrt([x.cov[i, 0, 0] for x, i, _ in rows])
    middle = np.stack([transform_points(pose, x.endpoints[i]).mean(axis=0) for x, i, pose in rows])
    wall, limits = table.wall.copy(), config.walls
    order = np.argsort(wall[used], kind="stable")
    for group in np.split(order, np.flatnonzero(np.diff(wall[used][order])) + 1):
        usual = table.phi[wall[used[group[0]]]]
        usual += np.median(wrap_angle(phi[group] - usual))
        away = middle[group] @ [np.cos(usual), np.sin(usual)]
        far = np.abs(away - np.median(away)) > GATE_FACTOR * limits.gate_distance
        turned = np.abs(wrap_angle(phi[group] - usual))
        far |= turned > limits.gate_angle + GATE_SIGMAS * sigma[group]
        wall[used[group[far]]] = -1
    return table.keep(wall, min_confirmations(config, len(poses)))
