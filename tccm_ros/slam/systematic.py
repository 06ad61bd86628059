"""Systematic error of odometry: a common scale error of its distances.

The graph assumes independent errors of its factors, which grow with the root of the path. A scale
error of a wheel is constant: where the distance is not observed, the error grows linearly with the
path. The scale is a considered parameter that is not estimated here (Schmidt 1966, "Application of
state-space methods to navigation problems"): the poses remain, and their covariance is P + J J',
where J is the displacement of the solution for a scale error of one standard deviation. J excludes
the part that walls and loop closures correct.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.slam.chain import KeyframeChain
from tccm_ros.slam.front_end import GraphKeyframe
from tccm_ros.slam.graph.pose_graph import GraphSolution
from tccm_ros.slam.se2 import between_se2, inverse_se2


def systematic_covariances(solution: GraphSolution, chain: KeyframeChain) -> Float64:
    """Return the covariances of the keyframes due to the scale of odometry.

    Parameters
    ----------
    solution
        Solution of a graph with the chain's factors.
    chain
        Keyframes of all sessions. The scale is constant in a session, independent between sessions.

    Returns
    -------
    float64 (K, 3, 3) of (x, y, yaw) in each keyframe's own frame; zeros if no keyframe depends on
    odometry
    """
    covs = np.zeros((len(chain.keys), 3, 3))
    for session in sorted({k.session for k in chain.keyframes}):
        moved = scale_displacements(solution, chain, session)
        covs += np.einsum("ki,kj->kij", moved, moved)
    return covs


def scale_displacements(solution: GraphSolution, chain: KeyframeChain, session: int) -> Float64:
    """Return the displacement of keyframes for a session's scale error of one sigma.

    Parameters
    ----------
    solution, chain
        As in `systematic_covariances`.
    session
        Session with the scale error.

    Returns
    -------
    float64 (K, 3), (x, y, yaw) in each keyframe's own frame
    """
    gradient = _gradient(chain, solution.planar_poses(chain.keys), session)
    if not gradient.any():
        return np.zeros((len(chain.keys), 3))
    return solution.displacements(chain.keys, gradient)


class CarriedDisplacement:
    """Propagates the displacement of the newest keyframe like a filter (Schmidt 1966).

    A step adds the displacement due to odometry's scale. An update by walls and loop closures
    reduces it by the same factor as the covariance.

    Parameters
    ----------
    displacement
        float64 (3,), displacement of a keyframe (`scale_displacements`).
    cov
        float64 (3, 3) of (x, y, yaw) of its pose, in its own frame.
    """

    def __init__(self, displacement: Float64, cov: Float64) -> None:
        self.displacement, self._cov = displacement, cov

    def carry(self, keyframes: Sequence[GraphKeyframe], cov: Float64) -> None:
        """Propagate to the last of the next keyframes, whose pose has the covariance (3, 3)."""
        predicted = self._cov
        for keyframe in keyframes:
            A = adjoint(inverse_se2(keyframe.delta))
            self.displacement = A @ self.displacement + keyframe.systematic
            predicted = A @ predicted @ A.T + keyframe.cov
        if keyframes:
            self.displacement = cov @ np.linalg.solve(predicted, self.displacement)
            self._cov = cov


def _gradient(chain: KeyframeChain, poses: Float64, session: int) -> Float64:
    """Return J' W d, float64 (K, 3), for the changes d of a session's odometry steps.

    The residual of a step is Log(delta^-1 a^-1 b). In the frames of a and b, its derivatives are
    minus the adjoint of (a^-1 b)^-1, and one.
    """
    gradient = np.zeros((len(poses), 3))
    for k, keyframe in enumerate(chain.keyframes):
        is_step = keyframe.session == session and not chain.starts(k) and k not in chain.fixed
        if not is_step or not keyframe.systematic.any():
            continue
        weighted = np.linalg.solve(keyframe.cov, keyframe.systematic)
        gradient[k] += weighted
        gradient[k - 1] -= adjoint(between_se2(poses[k], poses[k - 1])).T @ weighted
    return gradient


def adjoint(pose: Float64) -> Float64:
    """Return the adjoint float64 (3, 3) of a planar pose (3,), for motions (x, y, yaw)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[c, -s, pose[1]], [s, c, -pose[0]], [0.0, 0.0, 1.0]])
