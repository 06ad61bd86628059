"""The error that all steps of odometry share: the scale of its distances.

The graph takes the errors of its factors as independent, so that they grow with the root of the
way. A wheel whose size is off by a percent is off by that all the way: where nothing observes the
distance, the error grows with the way itself. The scale is a parameter that is considered and not
estimated here (Schmidt 1966, "Application of state-space methods to navigation problems"): the
poses stay as they are, and their covariance is P + J J', where J is by how much the solution moves
if the scale is off by one standard deviation. What walls and loop closures correct is not in J.
"""

from __future__ import annotations

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.slam.chain import Chain
from tccm_ros.slam.graph import GraphSolution
from tccm_ros.slam.se2 import between


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
    poses = solution.planar_poses(chain.keys)
    covs = np.zeros((len(chain.keys), 3, 3))
    for session in sorted({k.session for k in chain.keyframes}):
        gradient = _gradient(chain, poses, session)
        if gradient.any():
            moved = solution.displacements(chain.keys, gradient)
            covs += np.einsum("ki,kj->kij", moved, moved)
    return covs


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
