"""Which proposals agree with each other: pairwise consistency (Mangelson et al. 2018)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tccm_ros.geometry import between2, compose2, inverse2
from tccm_ros.slam.loop_proposals import Proposal

__all__ = ["consistent_with", "largest_consistent_set"]

Float64 = NDArray[np.float64]

TOLERANCE = (0.12, 0.035)
"""Standard closing error (m, rad) of a cycle through two good proposals: two matches and the
bend of two submaps."""

GROWTH = (0.02, 0.003)
"""How the closing error grows (1/m, rad/m) with the path between the proposals on either side."""

KNOWS_PLACE = 0.5
"""A proposal whose standard deviation (m) is larger in some direction does not say where the robot
is: along a plain corridor. It agrees with all, and so confirms none that does."""

CHI2 = 11.3
"""99 % of three degrees of freedom."""


def consistent_with(
    one: Proposal,
    others: Sequence[Proposal],
    poses: Sequence[Float64] | Float64,
    path: Sequence[float] | Float64,
) -> NDArray[np.bool_]:
    """Tell which proposals close a cycle with `one`.

    Parameters
    ----------
    one, others
        Proposals.
    poses
        Float64 (3,) each, where the keyframes are believed to be; only relative poses along each
        side of the cycle count.
    path
        Path length up to each keyframe, m.
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
    sigma_xy = TOLERANCE[0] + GROWTH[0] * along
    sigma_yaw = TOLERANCE[1] + GROWTH[1] * along
    cov = _in_frames_of(one, others, between2(poses[one.b], b)[:, 2])
    xx, xy, yy = cov[:, 0, 0] + sigma_xy**2, cov[:, 0, 1], cov[:, 1, 1] + sigma_xy**2
    x, y = error[:, 0], error[:, 1]
    chi2 = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)
    agree = chi2 + error[:, 2] ** 2 / sigma_yaw**2 < CHI2
    return np.asarray(agree & (_knows_place(others) == _knows_place([one])))


def _in_frames_of(one: Proposal, others: Sequence[Proposal], yaws: Float64) -> Float64:
    """Return the sum of the positions' covariances of `one` and of each other, (N, 2, 2), in the
    frame of the other's b, which stands at `yaws` (N,) in that of one's b.
    """
    c, s = np.cos(yaws), np.sin(yaws)
    turns = np.array([[c, s], [-s, c]]).transpose(2, 0, 1)
    turned = turns @ one.cov[:2, :2] @ turns.transpose(0, 2, 1)
    return np.asarray(np.array([p.cov[:2, :2] for p in others]) + turned)


def _knows_place(proposals: Sequence[Proposal]) -> NDArray[np.bool_]:
    return np.array([p.spread < KNOWS_PLACE**2 for p in proposals])


def largest_consistent_set(
    proposals: Sequence[Proposal],
    poses: Sequence[Float64] | Float64,
    path: Sequence[float] | Float64,
) -> list[int]:
    """Return the indices of a large set of mutually consistent proposals, ascending.

    Greedy: start from the proposal that agrees with most and add, in order of agreement, what
    agrees with all that is in.
    """
    n = len(proposals)
    agree = np.zeros((n, n), bool)
    for i in range(n):
        agree[i] = consistent_with(proposals[i], proposals, poses, path)
    agree &= agree.T
    order = np.argsort(-agree.sum(axis=1), kind="stable")
    best: list[int] = []
    for seed in order[: min(n, 20)]:
        chosen = [int(seed)]
        allowed = agree[seed].copy()
        for i in order:
            if i != seed and allowed[i]:
                chosen.append(int(i))
                allowed &= agree[i]
        if len(chosen) > len(best):
            best = chosen
    return sorted(best)
