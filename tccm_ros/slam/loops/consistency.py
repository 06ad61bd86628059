"""Outlier rejection of loop closures.

While driving, loop closures are tested by pairwise consistency (Mangelson et al. 2018). Before a
result, they are tested by graduated non-convexity (Yang et al. 2020) with truncated least squares:
the graph is solved repeatedly with reweighted loop closures, whose weights start nearly equal and
end at zero or one. No factor needs a robust noise model of its own.

GTSAM's ``GncLMOptimizer`` does not support these graphs (tried with 4.3.0): it clones all factors,
and throws at an ``OrientedPlane3Factor``, even with known inliers.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tccm_ros.arrays import Bool, Float64
from tccm_ros.geometry import between2, compose2, inverse2
from tccm_ros.slam.factors.keys import Key
from tccm_ros.slam.graph.pose_graph import GraphSolution, PoseGraph
from tccm_ros.slam.loops.matching import Proposal

CLOSING_SIGMA_M, CLOSING_SIGMA_RAD = 0.12, 0.035
"""Standard deviation of the closing error of a cycle through two correct proposals: two matches and
the distortion of two submaps (chosen)."""

CLOSING_SIGMA_M_PER_M, CLOSING_SIGMA_RAD_PER_M = 0.02, 0.003
"""Growth of `CLOSING_SIGMA_M` and `CLOSING_SIGMA_RAD` with the path between the proposals
(chosen)."""

MAX_POSITION_SIGMA = 0.5
"""A proposal with a larger standard deviation (m) in some direction does not determine the
position, as along a plain corridor. It agrees with all proposals, so it confirms only others of
this kind (chosen)."""

CYCLE_CHI2 = 11.3
"""Gate on the squared Mahalanobis distance of a cycle: 99 % of three degrees of freedom."""

LOOP_CHI2 = 16.3
"""Gate on the squared Mahalanobis distance of a loop closure: 99.9 % of three degrees of
freedom."""

CONTROL_STEP = 2.0
"""Factor of the control parameter between two solutions (chosen; 1.4 in the paper)."""

MAX_ROUNDS = 15
"""Maximum number of solutions (chosen)."""

MIN_WEIGHT = 1e-4
"""Weight of a rejected loop closure; not zero, as its covariance would be infinite (chosen)."""


def consistent_with(
    one: Proposal,
    others: Sequence[Proposal],
    poses: Sequence[Float64] | Float64,
    path: Sequence[float] | Float64,
) -> Bool:
    """Return a mask of the proposals that close a cycle with `one`.

    Parameters
    ----------
    one, others
        Proposals.
    poses
        float64 (3,) each, estimates of the keyframes; only relative poses along each side of the
        cycle are used.
    path
        Path length up to each keyframe, m.

    Returns
    -------
    bool (N,), one for each of `others`; a proposal that determines the position is never consistent
    with one that does not
    """
    if not others:
        return np.zeros(0, bool)
    a = np.array([poses[p.a] for p in others])
    b = np.array([poses[p.b] for p in others])
    z = np.array([p.delta for p in others])
    # one.b -> one.a -> a -> b must lead where one.b -> b leads.
    round_trip = compose2(compose2(inverse2(one.delta), between2(poses[one.a], a)), z)
    error = between2(between2(poses[one.b], b), round_trip)
    along = np.array([abs(path[p.a] - path[one.a]) + abs(path[p.b] - path[one.b]) for p in others])
    sigma_xy = CLOSING_SIGMA_M + CLOSING_SIGMA_M_PER_M * along
    sigma_yaw = CLOSING_SIGMA_RAD + CLOSING_SIGMA_RAD_PER_M * along
    cov = _in_frames_of(one, others, between2(poses[one.b], b)[:, 2])
    xx, xy, yy = cov[:, 0, 0] + sigma_xy**2, cov[:, 0, 1], cov[:, 1, 1] + sigma_xy**2
    x, y = error[:, 0], error[:, 1]
    chi2 = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)
    agree = chi2 + error[:, 2] ** 2 / sigma_yaw**2 < CYCLE_CHI2
    return np.asarray(agree & (_is_localising(others) == _is_localising([one])))


def _in_frames_of(one: Proposal, others: Sequence[Proposal], yaws: Float64) -> Float64:
    """Return the sum of the positions' covariances of `one` and of each other, (N, 2, 2), in the
    frame of the other's b, which has the yaws (N,) in the frame of one's b.
    """
    c, s = np.cos(yaws), np.sin(yaws)
    rotations = np.array([[c, s], [-s, c]]).transpose(2, 0, 1)
    rotated = rotations @ one.cov[:2, :2] @ rotations.transpose(0, 2, 1)
    return np.asarray(np.array([p.cov[:2, :2] for p in others]) + rotated)


def _is_localising(proposals: Sequence[Proposal]) -> Bool:
    return np.array([p.max_position_variance < MAX_POSITION_SIGMA**2 for p in proposals])


def select_loops(
    graph: PoseGraph, keys: Sequence[Key], loops: Sequence[Proposal]
) -> tuple[Float64, Bool]:
    """Optimise a graph with loop closures and reject outliers among them.

    The weights of loop closures are those of graduated non-convexity: `MIN_WEIGHT` or 1 at the end.

    Parameters
    ----------
    graph
        Graph with all factors except the loop closures, which are added to it.
    keys
        Variables of the keyframes.
    loops
        The loop closures accepted while driving.

    Returns
    -------
    float64 (K, 3), poses of the keyframes, and bool (L,), mask of the inliers
    """
    first, count = len(graph), len(loops)
    graph.add([p.factor(keys) for p in loops])
    weights, solution = np.ones(count), graph.optimise()

    def chi2() -> Float64:
        return 2.0 * solution.errors_of(range(first, first + count)) / weights

    def solve(new: Float64) -> GraphSolution:
        for i in map(int, np.flatnonzero(new != weights)):
            graph.replace(first + i, loops[i].factor(keys, float(new[i])))
        weights[:] = new
        return graph.optimise()

    r2 = chi2()
    largest = float(r2.max(initial=0.0))
    if largest <= LOOP_CHI2:
        return solution.planar_poses(keys), np.ones(count, bool)
    mu = max(LOOP_CHI2 / (2.0 * largest - LOOP_CHI2), 1e-3)
    for _ in range(MAX_ROUNDS):
        new = _weights(r2, mu)
        converged = np.all((new <= MIN_WEIGHT) | (new >= 1.0)) and np.array_equal(new, weights)
        solution = solve(new)
        r2 = chi2()
        if converged:
            break
        mu *= CONTROL_STEP
    inliers = r2 <= LOOP_CHI2
    final = np.where(inliers, 1.0, MIN_WEIGHT)
    if not np.array_equal(final, weights):
        solution = solve(final)
    return solution.planar_poses(keys), inliers


def _weights(r2: Float64, mu: float) -> Float64:
    """Return Eq. (14) of the paper: weights of truncated least squares at control `mu`."""
    limit = LOOP_CHI2
    middle = np.sqrt(limit * mu * (mu + 1.0) / np.maximum(r2, 1e-12)) - mu
    weights = np.where(r2 >= (mu + 1.0) / mu * limit, 0.0, middle)
    weights = np.where(r2 <= mu / (mu + 1.0) * limit, 1.0, weights)
    return np.asarray(np.clip(weights, MIN_WEIGHT, 1.0))
