"""The error that all steps of odometry share: the scale of its distances.

The graph takes the errors of its factors as independent, so that they grow with the root of the
way. A wheel whose size is off by a percent is off by that all the way: where nothing observes the
distance, the error grows with the way itself. The scale is a parameter that is considered and not
estimated here (Schmidt 1966, "Application of state-space methods to navigation problems"): the
poses stay as they are, and their covariance is P + J J', where J is by how much the solution moves
if the scale is off by one standard deviation. What walls and loop closures correct is not in J.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.slam.chain import Chain
from tccm_ros.slam.front_end import GraphKeyframe
from tccm_ros.slam.graph.pose_graph import GraphSolution
from tccm_ros.slam.se2 import between, inverse


def systematic_covariances(solution: GraphSolution, chain: Chain) -> Float64:
    """Return the covariances of the keyframes that stem from the scale of odometry.

    Parameters
    ----------
    solution
        Of a graph in which the chain's factors are.
    chain
        Keyframes of all sessions. The scale is one in a session, and independent in another.

    Returns
    -------
    float64 (K, 3, 3) of (x, y, yaw) in each keyframe's own frame; (K, 3, 3) of zeros where no
    keyframe hangs on odometry
    """
    covs = np.zeros((len(chain.keys), 3, 3))
    for session in sorted({k.session for k in chain.keyframes}):
        moved = scale_displacements(solution, chain, session)
        covs += np.einsum("ki,kj->kij", moved, moved)
    return covs


def scale_displacements(solution: GraphSolution, chain: Chain, session: int) -> Float64:
    """Return by how much keyframes move if the scale of a session is off by one sigma.

    Parameters
    ----------
    solution, chain
        As for `systematic_covariances`.
    session
        The one whose odometry is off.

    Returns
    -------
    float64 (K, 3), (x, y, yaw) in each keyframe's own frame
    """
    gradient = _gradient(chain, solution.planar_poses(chain.keys), session)
    if not gradient.any():
        return np.zeros((len(chain.keys), 3))
    return solution.displacements(chain.keys, gradient)


class CarriedDisplacement:
    """The displacement of the newest keyframe, carried on as a filter would (Schmidt 1966).

    On the way it grows by what odometry's scale shifts. Where walls and loop closures correct the
    pose, they correct it by the fraction by which they make it more certain.

    Parameters
    ----------
    displacement
        float64 (3,), of a keyframe (`scale_displacements`).
    cov
        float64 (3, 3) of (x, y, yaw) of its pose, in its own frame.
    """

    def __init__(self, displacement: Float64, cov: Float64) -> None:
        self.displacement, self._cov = displacement, cov

    def carry(self, keyframes: Sequence[GraphKeyframe], cov: Float64) -> None:
        """Carry it to the last of the next keyframes, whose pose then has the covariance (3, 3)."""
        predicted = self._cov
        for keyframe in keyframes:
            A = adjoint(inverse(keyframe.delta))
            self.displacement = A @ self.displacement + keyframe.systematic
            predicted = A @ predicted @ A.T + keyframe.cov
        if keyframes:
            self.displacement = cov @ np.linalg.solve(predicted, self.displacement)
            self._cov = cov


def _gradient(chain: Chain, poses: Float64, session: int) -> Float64:
    """Return J' W d, float64 (K, 3): what the changes d of a session's steps ask of its keyframes.

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
        gradient[k - 1] -= adjoint(between(poses[k], poses[k - 1])).T @ weighted
    return gradient


def adjoint(pose: Float64) -> Float64:
    """Return the adjoint float64 (3, 3) of a planar pose (3,): motions (x, y, yaw) seen from it."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[c, -s, pose[1]], [s, c, -pose[0]], [0.0, 0.0, 1.0]])
