"""Match the sides that two views saw of the same surfaces: their relative pose in x, y and yaw.

A side is a line: it measures the distance across itself, and a heading. Sides of one table face
different ways, so that one table in common is often enough; where all sides are parallel, the pose
along them stays open and the covariance says so. Hypotheses from pairs of sides are compared
before one is refined, so that a second pose that fits nearly as well is seen and refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tccm_ros.arrays import Bool, Float64, Int64
from tccm_ros.geometry import transform2, wrap_angle
from tccm_ros.surfaces.sides import Sides

__all__ = ["SideMatch", "match_sides"]


MIN_OVERLAP = 0.12
"""Sides that share less than this along themselves (m) are not matched."""

YAW_GATE = np.radians(12.0)
"""Short sides are seen turned by a few degrees; further apart they are different sides."""

INLIER = 3.0
"""Standard deviations within which two sides are one."""

CROSSING = 0.4
"""Two sides at this sine of their angle, or more, fix a position."""

MAX_LENGTH = 1.0
"""A longer side (m) has no more votes than this one."""

AMBIGUOUS = 0.75
"""A second pose with this fraction of the best one's votes makes a match ambiguous."""

SAME_POSE = (0.05, np.radians(4.0))
"""Poses further apart than this (m, rad) are different ones."""

MIN_SIDES, MIN_VOTES = 2, 0.5
"""A match has so many sides and so many metres of them."""

SEARCHED, SEARCHED_SIDES = 0.06, 3
"""Where more than this (m) was searched, chance agrees more often: so many sides are asked for."""

MAX_HYPOTHESES = 400
"""Hypotheses are made of so many pairs, the longest sides first."""

ROUNDS = 8
BLIND = 0.3
"""Standard deviation (m, rad) of what the sides leave open: there a match stays where it began."""


@dataclass(frozen=True, slots=True, eq=False)
class SideMatch:
    """The relative pose of two views.

    Attributes
    ----------
    pose
        float64 (3,), planar pose of the second view in the first.
    cov
        float64 (3, 3) of (x, y, yaw) in the second view's frame; `BLIND` where nothing tells.
    sides
        How many sides agree.
    """

    pose: Float64
    cov: Float64
    sides: int


@dataclass(frozen=True, slots=True, eq=False)
class _Pairs:
    """Candidates: side `a` of the first view may be side `b` of the second.

    `normal` and `anchor` float64 (M, 2) are of the first, `middle` (M, 2) and `outward` (M, 2) of
    the second view, each in its own frame; `sigma` (M,) across, `yaw_sigma` (M,), `votes` (M,).
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
    """Find the pose of `second` in `first`; None where nothing is certain.

    Parameters
    ----------
    first, second
        Sides in levelled frames with common height.
    start
        float64 (3,), the pose as known so far.
    cov_start
        float64 (3, 3), how well it is known: the search covers three standard deviations.
    height_gate
        Sides of one surface do not differ more in height, m.
    """
    max_shift = INLIER * float(np.sqrt(max(np.linalg.eigvalsh(cov_start[:2, :2])[1], 0.0)))
    max_yaw = INLIER * float(np.sqrt(max(cov_start[2, 2], 0.0)))
    pairs = _candidates(first, second, start, (max_shift, max_yaw), height_gate)
    if len(pairs.a) == 0:
        return None
    trials = _hypotheses(pairs, start, (max_shift, max_yaw))
    votes = np.array([_votes(pairs, trial) for trial in trials])
    min_sides = MIN_SIDES if max_shift <= SEARCHED else SEARCHED_SIDES
    best = _refine(pairs, trials[int(np.argmax(votes))], start, min_sides)
    if best is None or _has_rival(pairs, trials, votes, start, best):
        return None
    return best


def _candidates(
    first: Sides,
    second: Sides,
    start: Float64,
    search: tuple[float, float],
    height_gate: float,
) -> _Pairs:
    """Return the pairs of sides that may be one, within a shift (m) and a yaw (rad) of `start`."""
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
    turned = np.arccos(np.clip(first.outward @ outward.T, -1.0, 1.0))
    swing = max_yaw * np.hypot(*second.middle.T)[None]
    may = (np.abs(across) <= max_shift + swing + INLIER * sigma) & (turned <= YAW_GATE + max_yaw)
    may &= np.abs(first.height[:, None] - second.height[None]) <= height_gate
    may &= shared + max_shift + swing >= MIN_OVERLAP
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
        np.hypot(first.yaw_sigma[a], second.yaw_sigma[b]),
        np.minimum(shortest, MAX_LENGTH),
    )


def _hypotheses(pairs: _Pairs, start: Float64, search: tuple[float, float]) -> Float64:
    """Return poses (H, 3): the start, and what two crossing sides say together."""
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
            if (
                np.hypot(*moved[:2]) <= max_shift + 0.02
                and abs(wrap_angle(moved[2])) <= max_yaw + 0.02
            ):
                trials.append(trial)
            if len(trials) > MAX_HYPOTHESES:
                return np.array(trials)
    return np.array(trials)


def _residuals(pairs: _Pairs, use: Int64, pose: Float64) -> tuple[Float64, Float64]:
    """Return distance across (m) and turn (rad) of pairs at a pose, each over its deviation."""
    normal = pairs.normal[use]
    across = np.sum((transform2(pose, pairs.middle[use]) - pairs.anchor[use]) * normal, axis=1)
    outward = transform2(np.array([0.0, 0.0, pose[2]]), pairs.outward[use])
    turned = np.arctan2(
        normal[:, 0] * outward[:, 1] - normal[:, 1] * outward[:, 0],
        np.sum(normal * outward, axis=1),
    )
    return across / pairs.sigma[use], turned / pairs.yaw_sigma[use]


def _solve(pairs: _Pairs, use: Int64, start: Float64, weight: Float64) -> Float64:
    """Run weighted Gauss-Newton on pairs, all of which count; what they leave open stays."""
    pose, prior = start, np.eye(3) / BLIND**2
    for _ in range(3):
        J, r = _system(pairs, use, pose)
        W = np.r_[weight, weight][:, None]
        moved = np.array([*(pose - start)[:2], wrap_angle(pose[2] - start[2])])
        pose = pose - np.linalg.solve((J * W).T @ J + prior, (J * W).T @ r + prior @ moved)
    return np.array([pose[0], pose[1], float(wrap_angle(pose[2]))])


def _system(pairs: _Pairs, use: Int64, pose: Float64) -> tuple[Float64, Float64]:
    """Return Jacobian (2M, 3) over (x, y, yaw) of `pose` and residuals (2M,)."""
    across, turned = _residuals(pairs, use, pose)
    arm = transform2(np.array([0.0, 0.0, pose[2]]), pairs.middle[use])
    normal = pairs.normal[use]
    swing = normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1]
    J = np.zeros((2 * len(use), 3))
    J[: len(use)] = np.column_stack([normal, swing]) / pairs.sigma[use, None]
    J[len(use) :, 2] = 1.0 / pairs.yaw_sigma[use]
    return J, np.r_[across, turned]


def _votes(pairs: _Pairs, pose: Float64) -> float:
    """Return the metres of sides that agree at a pose: each side of the second view once."""
    return float(pairs.votes[_agreeing(pairs, pose)].sum())


def _agreeing(pairs: _Pairs, pose: Float64) -> Int64:
    """Return the pairs that agree at a pose, one for each side of either view."""
    across, turned = _residuals(pairs, np.arange(len(pairs.a)), pose)
    miss = np.maximum(np.abs(across), np.abs(turned))
    chosen: list[int] = []
    seen_a: set[int] = set()
    seen_b: set[int] = set()
    for m in np.argsort(miss, kind="stable").tolist():
        if miss[m] > INLIER:
            break
        if pairs.a[m] not in seen_a and pairs.b[m] not in seen_b:
            chosen.append(m)
            seen_a.add(int(pairs.a[m]))
            seen_b.add(int(pairs.b[m]))
    return np.array(sorted(chosen), np.int64)


def _has_rival(
    pairs: _Pairs, trials: Float64, votes: Float64, start: Float64, best: SideMatch
) -> bool:
    """Return whether a trial that is refined to another pose gets nearly as many votes."""
    enough = AMBIGUOUS * _votes(pairs, best.pose)
    for trial in trials[(votes > enough) & _differ(trials, best.pose)]:
        other = _refine(pairs, trial, start, MIN_SIDES)
        if other is None or not _differ(other.pose[None], best.pose)[0]:
            continue
        if _votes(pairs, other.pose) > enough:
            return True
    return False


def _differ(poses: Float64, pose: Float64) -> Bool:
    """Return which poses (N, 3) differ from a pose (3,)."""
    moved = poses - pose
    far = np.hypot(moved[:, 0], moved[:, 1]) > SAME_POSE[0]
    return np.asarray(far | (np.abs(wrap_angle(moved[:, 2])) > SAME_POSE[1]))


def _refine(pairs: _Pairs, trial: Float64, start: Float64, min_sides: int) -> SideMatch | None:
    """Fit the pose to all pairs that agree, with weights that forget outliers."""
    pose = trial
    use = _agreeing(pairs, pose)
    for _ in range(ROUNDS):
        if len(use) < min_sides:
            return None
        across, turned = _residuals(pairs, use, pose)
        weight = 1.0 / (1.0 + np.maximum(across**2, turned**2) / INLIER**2)
        moved = _solve(pairs, use, start, weight)
        use = _agreeing(pairs, moved)
        done = np.abs(moved - pose).max() < 1e-7
        pose = moved
        if done:
            break
    if len(use) < min_sides or pairs.votes[use].sum() < MIN_VOTES:
        return None
    return SideMatch(pose, _covariance(pairs, use, pose), len(use))


def _covariance(pairs: _Pairs, use: Int64, pose: Float64) -> Float64:
    """Return the covariance of (x, y, yaw) in the second view's frame, `BLIND` where open."""
    J, r = _system(pairs, use, pose)
    scatter = max(1.0, float(r @ r) / max(len(r) - 3, 1))
    information = J.T @ J / scatter + np.eye(3) / BLIND**2
    R = np.eye(3)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    R[:2, :2] = [[c, -s], [s, c]]
    return np.asarray(R.T @ np.linalg.inv(information) @ R)
