"""Outlier rejection of wall observations, and of walls that are not planar; unit variance.

The unit variance of a graph is the ratio of its residuals to their covariances. The lines that a
keyframe sees of a wall that bows, or of an object beside it, deviate together: their residuals are
large, but those of the middle and of the ends have opposite signs, and hardly pull the pose. So the
lines of a keyframe count by their common pull on its pose, as in cluster-robust covariances (Liang
and Zeger 1986, "Longitudinal data analysis using generalized linear models").
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.config import Config
from tccm_ros.geometry import wrap_angle
from tccm_ros.slam.factors.keys import Key
from tccm_ros.slam.factors.walls import WallObservation
from tccm_ros.slam.graph.pose_graph import GraphSolution, PoseGraph
from tccm_ros.slam.se2 import transform_points
from tccm_ros.slam.walls.association import WallTable, min_confirmations
from tccm_ros.slam.walls.landmarks import wall_factors
from tccm_ros.slam.walls.lines import Lines

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

MAX_OVER_MEDIAN = 10.0
"""99.9 % quantile over median of a chi-square with two degrees of freedom; larger ratios are no
noise."""

PRIOR_FREEDOM, PRIOR_VARIANCE = 2.0, 0.05
"""Prior on the unit variance: degrees of freedom and mean. Covariances of factors are conservative,
and a graph with little redundancy does not show by how much (chosen)."""

MIN_EIGENVALUE = 1e-9
"""Relative eigenvalue below which the lines of a keyframe do not measure a motion: one wall does
not measure the position along it (a numerical tolerance)."""


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


def unit_variance(
    solution: GraphSolution, observations: Sequence[WallObservation], rest: float, freedom: int
) -> float:
    """Return chi-square over degrees of freedom, combined with its prior.

    The residuals of a graph without redundancy do not test its covariances; the result is then 1.

    Parameters
    ----------
    solution
        Solution of the graph.
    observations
        Its wall observations.
    rest, freedom
        Chi-square and redundancy of the factors between keyframes.
    """
    chi2, rank = _pulls(solution, observations)
    walls = len({x.wall for x in observations})
    redundancy = freedom + float(rank.sum()) * (1.0 - walls / max(len(observations), 1))
    if redundancy < 1.0:
        return 1.0
    total = rest + _without_tail(chi2) + PRIOR_FREEDOM * PRIOR_VARIANCE
    return total / (redundancy + PRIOR_FREEDOM)


def _pulls(
    solution: GraphSolution, observations: Sequence[WallObservation]
) -> tuple[Float64, Int64]:
    """Return chi-square (K,) of the pull of walls on each keyframe, and its dimensions (K,)."""
    if not observations:
        return np.zeros(0), np.zeros(0, np.int64)
    keyframes = list({x.keyframe: None for x in observations})
    number = {key: k for k, key in enumerate(keyframes)}
    row = np.array([number[x.keyframe] for x in observations])
    pose = solution.planar_poses(keyframes)[row]
    planes = {x.wall: solution.plane(x.wall) for x in observations}
    nx, ny, _, d = np.array([planes[x.wall] for x in observations]).T
    phi, rho = np.array([(x.phi, x.rho) for x in observations]).T
    dphi = wrap_angle(phi + pose[:, 2] - np.arctan2(ny, nx))
    residual = np.stack([dphi, rho + nx * pose[:, 0] + ny * pose[:, 1] + d], axis=1)
    J = np.zeros((len(row), 2, 3))
    J[:, 0, 2], J[:, 1, 0], J[:, 1, 1] = 1.0, nx, ny
    weighted = np.linalg.solve(np.array([x.cov for x in observations]), J)
    pull, information = np.zeros((len(keyframes), 3)), np.zeros((len(keyframes), 3, 3))
    np.add.at(pull, row, np.einsum("nij,ni->nj", weighted, residual))
    np.add.at(information, row, np.einsum("nij,nik->njk", weighted, J))
    # Along motions that the walls of a keyframe do not measure, they have no pull.
    value, vector = np.linalg.eigh(information)
    measured = value > MIN_EIGENVALUE * value[:, -1:]
    square = np.einsum("kij,ki->kj", vector, pull) ** 2
    chi2 = np.divide(square, value, out=np.zeros_like(square), where=measured).sum(axis=1)
    return chi2, measured.sum(axis=1)


def _without_tail(chi2: Float64) -> float:
    """Return the sum of squared distances (N,), each limited to the plausible maximum of noise.

    Covariances are conservative, so that a line of another object may pass the gates and still have
    a distance hundreds of times that of the others: it is no measure of the noise.
    """
    if not len(chi2):
        return 0.0
    return float(np.minimum(chi2, MAX_OVER_MEDIAN * float(np.median(chi2))).sum())
