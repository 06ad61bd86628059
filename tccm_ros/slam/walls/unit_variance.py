"""Unit variance of a graph: the ratio of its residuals to their covariances.

The lines that a keyframe sees of a wall that bows, or of an object beside it, deviate together:
their residuals are large, but those of the middle and of the ends have opposite signs, and hardly
pull the pose. So the lines of a keyframe count by their common pull on its pose, as in
cluster-robust covariances (Liang and Zeger 1986, "Longitudinal data analysis using generalized
linear models").
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tccm_ros.arrays import Float64, Int64
from tccm_ros.geometry import wrap_angle
from tccm_ros.slam.factors.walls import WallObservation
from tccm_ros.slam.graph.pose_graph import GraphSolution

MAX_OVER_MEDIAN = 10.0
"""99.9 % quantile over median of a chi-square with two degrees of freedom; larger ratios are no
noise."""

PRIOR_FREEDOM, PRIOR_VARIANCE = 2.0, 0.05
"""Prior on the unit variance: degrees of freedom and mean. Covariances of factors are conservative,
and a graph with little redundancy does not show by how much (chosen)."""

MIN_EIGENVALUE = 1e-9
"""Relative eigenvalue below which the lines of a keyframe do not measure a motion: one wall does
not measure the position along it (a numerical tolerance)."""


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
