"""Walls as landmarks: observations to factors, and the optimised walls read back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tccm_ros.config import Config
from tccm_ros.geometry import wrap_angle
from tccm_ros.records import Wall
from tccm_ros.slam.chain import Chain
from tccm_ros.slam.corners import Corner, meeting_point
from tccm_ros.slam.factors import Factor, Key, WallObservation, wall_key
from tccm_ros.slam.graph import GraphSolution, PoseGraph
from tccm_ros.slam.lines import Lines
from tccm_ros.slam.se2 import place
from tccm_ros.slam.walls import WallTable, confirmations

__all__ = ["Judgement", "judge_walls", "wall_factors", "wall_records"]

Float64 = NDArray[np.float64]


OBSERVATION_CHI2 = 13.8
"""An observation further than this from its wall is of something else: 99.9 % of two degrees."""

TAIL = 10.0
"""99.9 % of two degrees of freedom over their median: further off is not noise."""

SNAP = 0.3
"""An end further than this (m) from where its walls meet is not moved there."""

PRIOR_FREEDOM, PRIOR_VARIANCE = 2.0, 0.05
"""What a graph with little redundancy is taken to show: covariances of factors are careful."""

WALL_CHI2 = 3.0
"""A wall whose observations average more per observation (2 are expected) is not one plane."""


class Judgement(NamedTuple):
    """Walls that hold, and how the graph's residuals compare with their covariances.

    Attributes
    ----------
    table
        The walls.
    unit_variance
        Sum of squared Mahalanobis distances over degrees of freedom: about 1 where the
        covariances are right, less where they are careful.
    """

    table: WallTable
    unit_variance: float


def judge_walls(
    table: WallTable,
    lines: Sequence[Lines],
    poses: Float64,
    graph: PoseGraph,
    chain: Chain,
    config: Config,
) -> Judgement:
    """Take out observations and walls that the graph cannot make straight.

    Parameters
    ----------
    table, lines
        The walls as associated, and the lines of all keyframes.
    poses
        float64 (K, 3), the keyframes as known without walls.
    graph
        With all but walls; it is given them, if ``walls.enabled``.
    chain, config
        As for `wall_factors`.
    """
    walls = config.walls.enabled
    table = _without_strays(table, lines, poses, config) if walls else table
    used = np.flatnonzero(table.wall >= 0) if walls else np.zeros(0, np.int64)
    first, keyframes = len(graph), len(chain.keys)
    if walls:
        graph.add(wall_factors(table, lines, chain.keys, config))
    solution = graph.optimise()
    chi2 = 2.0 * solution.errors_of(range(first, first + len(used)))
    wall = np.full_like(table.wall, -1) if not walls else table.wall.copy()
    sums = np.bincount(wall[used], weights=chi2, minlength=len(table))
    counts = np.bincount(wall[used], minlength=len(table))
    crooked = sums > WALL_CHI2 * np.maximum(counts, 1)
    wall[used[(chi2 > OBSERVATION_CHI2) | crooked[wall[used]]]] = -1
    judged = table.keep(wall, confirmations(config, keyframes))
    kept = judged.wall[used] >= 0
    # Each keyframe but the first has a between and a planar factor; the rest are loops.
    rest = 2.0 * float(solution.errors_of(range(first)).sum())
    rows = 3 * (first - keyframes) + 2 * int(kept.sum())
    freedom = rows - 3 * (keyframes - 1) - 2 * len(judged)
    return Judgement(judged, _unit_variance(rest + _without_tail(chi2[kept]), freedom))


def _without_strays(
    table: WallTable, lines: Sequence[Lines], poses: Float64, config: Config
) -> WallTable:
    """Take out observations that are far from the median of their wall: wrong labels.

    A median stands up to half of them wrong; least squares does not stand up to one.
    """
    used = np.flatnonzero(table.wall >= 0)
    if not len(used):
        return table
    rows = [(lines[k], i, poses[k]) for k, i in zip(table.keyframe[used], table.line[used])]
    phi = np.array([x.phi[i] + pose[2] for x, i, pose in rows])
    sigma = np.sqrt([x.cov[i, 0, 0] for x, i, _ in rows])
    middle = np.stack([place(pose, x.endpoints[i]).mean(axis=0) for x, i, pose in rows])
    wall, limits = table.wall.copy(), config.walls
    order = np.argsort(wall[used], kind="stable")
    for group in np.split(order, np.flatnonzero(np.diff(wall[used][order])) + 1):
        usual = table.phi[wall[used[group[0]]]]
        usual += np.median(wrap_angle(phi[group] - usual))
        away = middle[group] @ [np.cos(usual), np.sin(usual)]
        far = np.abs(away - np.median(away)) > 2.0 * limits.gate_distance
        turned = np.abs(wrap_angle(phi[group] - usual))
        far |= turned > limits.gate_angle + 3.0 * sigma[group]
        wall[used[group[far]]] = -1
    return table.keep(wall, confirmations(config, len(poses)))


def _without_tail(chi2: Float64) -> float:
    """Return the sum of squared distances (N,), each at most what noise alone explains.

    Covariances are careful, so that a line of something else may pass the gates and still be
    hundreds of times further off than all others: a few such say nothing about the noise.
    """
    if not len(chi2):
        return 0.0
    return float(np.minimum(chi2, TAIL * float(np.median(chi2))).sum())


def _unit_variance(total: float, freedom: int) -> float:
    """Return chi2 over degrees of freedom; few of them are joined by `PRIOR_FREEDOM` usual ones.

    A graph without redundancy says nothing about its covariances: they stand as they are.
    """
    if freedom < 1:
        return 1.0
    return (total + PRIOR_FREEDOM * PRIOR_VARIANCE) / (freedom + PRIOR_FREEDOM)


def wall_factors(
    table: WallTable, lines: Sequence[Lines], keys: Sequence[Key], config: Config
) -> list[Factor]:
    """Return one factor for each observation of a confirmed wall.

    Matching has used the same beams: both say the same thing about the same noise. Covariance
    intersection with equal shares is the way to add two estimates of unknown correlation, so the
    walls' covariance is doubled; and it never falls below how flat walls are.
    """
    factors: list[Factor] = []
    flat = config.walls.flatness**2
    for k, i, w in zip(table.keyframe, table.line, table.wall):
        if w < 0:
            continue
        x = lines[k]
        cov = x.cov[i] * config.walls.discount
        cov += _flatness_covariance(x, i, flat)
        key = wall_key(int(w))
        factors.append(WallObservation(keys[k], key, float(x.phi[i]), float(x.rho[i]), cov))
    return factors


def _flatness_covariance(lines: Lines, i: int, variance: float) -> Float64:
    """Return the covariance (2, 2) of (phi, rho) from a wall that strays by `variance` (m2).

    Over a segment of length L a smooth stray shifts its centre by one sigma and turns it by
    about sqrt(12) sigma / L.
    """
    a, b = lines.endpoints[i]
    length2 = float(np.sum((b - a) ** 2))
    tangent = np.array([-np.sin(lines.phi[i]), np.cos(lines.phi[i])])
    yc = float(tangent @ (0.5 * (a + b)))
    v_phi = 12.0 * variance / max(length2, 1e-6)
    return np.array([[v_phi, yc * v_phi], [yc * v_phi, variance + yc * yc * v_phi]])


def wall_records(
    table: WallTable, corners: Sequence[Corner], solution: GraphSolution, scale: float
) -> list[Wall]:
    """Read the walls back, with phi in (-pi, pi] and rho >= 0, and ends joined at corners.

    `scale` multiplies their covariances.
    """
    counts = np.bincount(table.wall[table.wall >= 0], minlength=len(table))
    planes = [solution.plane(wall_key(w)) for w in range(len(table))]
    phi = [float(np.arctan2(p[1], p[0])) for p in planes]
    rho = [float(-p[3]) for p in planes]
    ends = [_endpoints(table, w, phi[w], rho[w]) for w in range(len(table))]
    joined = _join_ends(corners, phi, rho, ends)
    walls = []
    for w in range(len(table)):
        # GTSAM's tangent of a vertical plane: minus the turn about z, the vertical, the offset.
        cov = solution.covariance(wall_key(w))[np.ix_([0, 2], [0, 2])] * scale
        a, r, e = phi[w], rho[w], ends[w]
        if r < 0.0:
            a, r, e = float(wrap_angle(a + np.pi)), -r, e[::-1]
        walls.append(Wall(w, a, r, e.copy(), int(counts[w]), cov, tuple(sorted(joined[w]))))
    return walls


def _join_ends(
    corners: Sequence[Corner], phi: Sequence[float], rho: Sequence[float], ends: list[Float64]
) -> list[set[int]]:
    """Move the ends of walls to their corners; return which walls each shares an end with."""
    joined: list[set[int]] = [set() for _ in ends]
    taken: set[tuple[int, int]] = set()
    for corner in corners:
        pair = [corner.a, corner.b]
        point = meeting_point([phi[w] for w in pair], [rho[w] for w in pair])
        gaps = [np.hypot(*(ends[w] - point).T) for w in pair]
        nearest = [(w, int(np.argmin(gap))) for w, gap in zip(pair, gaps)]
        if max(float(gap.min()) for gap in gaps) > SNAP or taken & set(nearest):
            continue
        taken |= set(nearest)
        for w, e in nearest:
            ends[w][e] = point
        joined[corner.a].add(corner.b)
        joined[corner.b].add(corner.a)
    return joined


def _endpoints(table: WallTable, w: int, phi: float, rho: float) -> Float64:
    """Lay the pooled extent onto the optimised line."""
    normal, tangent = np.array([np.cos(phi), np.sin(phi)]), np.array([-np.sin(phi), np.cos(phi)])
    was = table.phi[w]
    old = table.rho[w] * np.array([np.cos(was), np.sin(was)])
    along = np.array([-np.sin(was), np.cos(was)])
    points = old + table.extent[w][:, None] * along
    return rho * normal + (points @ tangent)[:, None] * tangent
