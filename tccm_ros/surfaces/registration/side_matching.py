"""Matching of the sides of surfaces in two views: their relative pose in x, y and yaw.

A side is a line segment: it measures the position across itself and a yaw. Sides of one table have
different directions, so that one common table is often enough. If all sides are parallel, the
position along them is undetermined, and the covariance is large in that direction. Hypotheses from
pairs of sides are compared before the best is refined, and ambiguous matches are rejected.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.geometry import between2, transform2, wrap_angle
from tccm_ros.robust import AMBIGUOUS, GATE
from tccm_ros.surfaces.edges.edge_samples import CROSSING
from tccm_ros.surfaces.registration.plane_adjustment import SIGNIFICANCE
from tccm_ros.surfaces.registration.sides import MIN_LENGTH, Sides

YAW_GATE = np.radians(12.0)
"""Max difference in yaw of two sides in addition to the search, rad; chosen: short sides have
errors of a few degrees. Missing pixels at the end of a surface give large sigmas; gated by sigmas
alone, sides of other directions match: hololens with every second image has then an error of 33 mm
in place of 13 mm."""

SAME_POSE = (0.05, np.radians(4.0))
"""Max difference (m, rad) of two poses that count as the same; chosen."""

MIN_SIDES, MIN_VOTES = 2, 0.5
"""Min number of sides in a match, and their min total length, m; chosen."""

WIDE_SEARCH, MIN_SIDES_WIDE = 0.06, 3
"""Search distance, m, above which a match needs this number of sides, as more sides match by
chance; chosen."""

MAX_HYPOTHESES = 400
"""Max number of hypotheses, from the longest sides first; chosen."""

MAX_ROUNDS, CONVERGED = 8, 1e-7
"""Max iterations of the refinement, and the change (m, rad) below which it ends; chosen."""

OPEN_SIGMA = 0.3
"""Prior standard deviation (m, rad) of the pose; chosen. It is that of the result in directions
that the sides do not determine."""


@dataclass(frozen=True, slots=True, eq=False)
class SideMatch:
    """The relative pose of two views.

    Attributes
    ----------
    pose
        float64 (3,), planar pose of the second view in the first.
    cov
        float64 (3, 3) of (x, y, yaw) in the second view's frame; `OPEN_SIGMA` where undetermined.
    sides
        Number of inliers.
    """

    pose: Float64
    cov: Float64
    sides: int


@dataclass(frozen=True, slots=True, eq=False)
class _Pairs:
    """Candidate associations of side `a` of the first view and side `b` of the second.

    `normal` and `anchor` float64 (M, 2) are of the first view, `middle` and `outward` (M, 2) of the
    second, each in its own frame. `sigma` (M,), m, is the standard deviation across, `yaw_sigma`
    (M,) is in rad, and `votes` (M,) in m.
    """

    a: Int64
    b: Int64
    normal: Float64
    anchor: Float64
    middle: Float64
    outward: Float64
    sigma: Float64
    yaw_sigma: Float64
    votes: Float64


def match_sides(
    first: Sides, second: Sides, start: Float64, cov_start: Float64, height_gate: float
) -> SideMatch | None:
    """Find the pose of `second` in `first`; None if there is no match, or an ambiguous one.

    Parameters
    ----------
    first, second
        Sides in horizontal frames whose origins have the same height.
    start
        float64 (3,), prior planar pose.
    cov_start
        float64 (3, 3), covariance of (x, y, yaw) of `start`, isotropic in x and y. The search
        covers three standard deviations, and a match that contradicts the prior is rejected.
    height_gate
        Max difference in height of two sides of one surface, m.
    """
    max_shift = GATE * float(np.sqrt(max(np.linalg.eigvalsh(cov_start[:2, :2])[1], 0.0)))
    max_yaw = GATE * float(np.sqrt(max(cov_start[2, 2], 0.0)))
    pairs = _candidates(first, second, start, (max_shift, max_yaw), height_gate)
    if len(pairs.a) == 0:
        return None
    trials = _hypotheses(pairs, start, (max_shift, max_yaw))
    votes = np.array([_votes(pairs, trial) for trial in trials])
    min_sides = MIN_SIDES if max_shift <= WIDE_SEARCH else MIN_SIDES_WIDE
    best = _refine(pairs, trials[int(np.argmax(votes))], start, min_sides)
    if best is None or _has_rival(pairs, trials, votes, start, best):
        return None
    moved = between2(start, best.pose)
    # The prior is isotropic in x and y, so that its frame does not matter.
    if moved @ np.linalg.solve(cov_start + best.cov, moved) > chdtri(3, SIGNIFICANCE):
        return None
    return best


def _candidates(
    first: Sides,
    second: Sides,
    start: Float64,
    search: tuple[float, float],
    height_gate: float,
) -> _Pairs:
    """Return candidate associations, within a translation (m) and yaw (rad) from `start`."""
    max_shift, max_yaw = search
    middle = transform2(start, second.middle)
    outward = transform2(np.array([0.0, 0.0, start[2]]), second.outward)
    along = np.stack([-first.outward[:, 1], first.outward[:, 0]], axis=1)
    offset = middle[None] - first.middle[:, None]
    across = np.einsum("abk,ak->ab", offset, first.outward)
    beside = np.abs(np.einsum("abk,ak->ab", offset, along))
    shared = 0.5 * (first.length[:, None] + second.length[None]) - beside
    shared = np.minimum(shared, np.minimum(first.length[:, None], second.length[None]))
    sigma = np.hypot(first.sigma[:, None], second.sigma[None])
    rotation = np.arccos(np.clip(first.outward @ outward.T, -1.0, 1.0))
    lever = max_yaw * np.hypot(*second.middle.T)[None]
    yaw_sigma = np.hypot(first.yaw_sigma[:, None], second.yaw_sigma[None])
    may = np.abs(across) <= max_shift + lever + GATE * sigma
    may &= rotation <= YAW_GATE + max_yaw
    may &= np.abs(first.height[:, None] - second.height[None]) <= height_gate
    may &= shared + max_shift + lever >= MIN_LENGTH
    a, b = np.nonzero(may)
    shortest = np.minimum(first.length[a], second.length[b])
    return _Pairs(
        a,
        b,
        first.outward[a],
        first.middle[a],
        second.middle[b],
        second.outward[b],
        sigma[a, b],
        yaw_sigma[a, b],
        shortest,
    )


def _hypotheses(pairs: _Pairs, start: Float64, search: tuple[float, float]) -> Float64:
    """Return pose hypotheses (H, 3): the start, and one for each two pairs of crossing sides."""
    max_shift, max_yaw = search
    trials = [start]
    order = np.argsort(-pairs.votes, kind="stable")
    for i, m in enumerate(order.tolist()):
        for n in order[:i].tolist():
            if pairs.a[m] == pairs.a[n] or pairs.b[m] == pairs.b[n]:
                continue
            cross = (
                pairs.normal[m, 0] * pairs.normal[n, 1] - pairs.normal[m, 1] * pairs.normal[n, 0]
            )
            if abs(cross) < CROSSING:
                continue
            trial = _solve(pairs, np.array([m, n]), start, np.ones(2))
            moved = trial - start
            if np.hypot(*moved[:2]) <= max_shift and abs(wrap_angle(moved[2])) <= max_yaw:
                trials.append(trial)
            if len(trials) > MAX_HYPOTHESES:
                return np.array(trials)
    return np.array(trials)


def _residuals(pairs: _Pairs, use: Int64, pose: Float64) -> tuple[Float64, Float64]:
    """Return residuals across the sides and in yaw at a pose, in standard deviations."""
    normal = pairs.normal[use]
    across = np.sum((transform2(pose, pairs.middle[use]) - pairs.anchor[use]) * normal, axis=1)
    outward = transform2(np.array([0.0, 0.0, pose[2]]), pairs.outward[use])
    rotation = np.arctan2(
        normal[:, 0] * outward[:, 1] - normal[:, 1] * outward[:, 0],
        np.sum(normal * outward, axis=1),
    )
    return across / pairs.sigma[use], rotation / pairs.yaw_sigma[use]


def _solve(pairs: _Pairs, use: Int64, start: Float64, weight: Float64) -> Float64:
    """Fit a pose to pairs by weighted Gauss-Newton, with a prior of `OPEN_SIGMA` at the start."""
    pose, prior = start, np.eye(3) / OPEN_SIGMA**2
    for _ in range(3):
        J, r = _system(pairs, use, pose)
        W = np.r_[weight, weight][:, None]
        moved = np.array([*(pose - start)[:2], wrap_angle(pose[2] - start[2])])
        pose = pose - np.linalg.solve((J * W).T @ J + prior, (J * W).T @ r + prior @ moved)
    return np.array([pose[0], pose[1], float(wrap_angle(pose[2]))])


def _system(pairs: _Pairs, use: Int64, pose: Float64) -> tuple[Float64, Float64]:
    """Return the Jacobian (2M, 3) by (x, y, yaw) of `pose`, and the residuals (2M,)."""
    across, rotation = _residuals(pairs, use, pose)
    arm = transform2(np.array([0.0, 0.0, pose[2]]), pairs.middle[use])
    normal = pairs.normal[use]
    lever = normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1]
    J = np.zeros((2 * len(use), 3))
    J[: len(use)] = np.column_stack([normal, lever]) / pairs.sigma[use, None]
    J[len(use) :, 2] = 1.0 / pairs.yaw_sigma[use]
    return J, np.r_[across, rotation]


def _votes(pairs: _Pairs, pose: Float64) -> float:
    """Return the votes for a pose: the total length of the inliers, m, each side once."""
    return float(pairs.votes[_inliers(pairs, pose)].sum())


def _inliers(pairs: _Pairs, pose: Float64) -> Int64:
    """Return the inlier pairs at a pose, at most one for each side of either view."""
    across, rotation = _residuals(pairs, np.arange(len(pairs.a)), pose)
    miss = np.maximum(np.abs(across), np.abs(rotation))
    chosen: list[int] = []
    seen_a: set[int] = set()
    seen_b: set[int] = set()
    for m in np.argsort(miss, kind="stable").tolist():
        if miss[m] > GATE:
            break
        if pairs.a[m] not in seen_a and pairs.b[m] not in seen_b:
            chosen.append(m)
            seen_a.add(int(pairs.a[m]))
            seen_b.add(int(pairs.b[m]))
    return np.array(sorted(chosen), np.int64)


def _has_rival(
    pairs: _Pairs, trials: Float64, votes: Float64, start: Float64, best: SideMatch
) -> bool:
    """Return whether a hypothesis converges to a different pose with nearly as many votes."""
    enough = AMBIGUOUS * _votes(pairs, best.pose)
    for trial in trials[(votes > enough) & _differ(trials, best.pose)]:
        other = _refine(pairs, trial, start, MIN_SIDES)
        if other is None or not _differ(other.pose[None], best.pose)[0]:
            continue
        if _votes(pairs, other.pose) > enough:
            return True
    return False


def _differ(poses: Float64, pose: Float64) -> Bool:
    """Return whether each pose (N, 3) differs from a pose (3,) by more than `SAME_POSE`."""
    moved = poses - pose
    far = np.hypot(moved[:, 0], moved[:, 1]) > SAME_POSE[0]
    return np.asarray(far | (np.abs(wrap_angle(moved[:, 2])) > SAME_POSE[1]))


def _refine(pairs: _Pairs, trial: Float64, start: Float64, min_sides: int) -> SideMatch | None:
    """Fit the pose to all inlier pairs with robust weights; None: too few inliers."""
    pose = trial
    use = _inliers(pairs, pose)
    for _ in range(MAX_ROUNDS):
        if len(use) < min_sides:
            return None
        across, rotation = _residuals(pairs, use, pose)
        weight = 1.0 / (1.0 + np.maximum(across**2, rotation**2) / GATE**2)
        moved = _solve(pairs, use, start, weight)
        use = _inliers(pairs, moved)
        done = np.abs(moved - pose).max() < CONVERGED
        pose = moved
        if done:
            break
    if len(use) < min_sides or pairs.votes[use].sum() < MIN_VOTES:
        return None
    return SideMatch(pose, _covariance(pairs, use, pose), len(use))


def _covariance(pairs: _Pairs, use: Int64, pose: Float64) -> Float64:
    """Return the covariance of (x, y, yaw) in the second view's frame."""
    J, r = _system(pairs, use, pose)
    scatter = max(1.0, float(r @ r) / max(len(r) - 3, 1))
    information = J.T @ J / scatter + np.eye(3) / OPEN_SIGMA**2
    R = np.eye(3)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    R[:2, :2] = [[c, -s], [s, c]]
    return np.asarray(R.T @ np.linalg.inv(information) @ R)
