"""Walls as landmarks of the graph: observation factors, and optimised walls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import wrap_angle
from tccm_ros.records import Wall
from tccm_ros.slam.factors.keys import Key, wall_key
from tccm_ros.slam.factors.walls import WallObservation
from tccm_ros.slam.graph.pose_graph import GraphSolution
from tccm_ros.slam.walls.association import WallTable
from tccm_ros.slam.walls.corners import Corner, meeting_point
from tccm_ros.slam.walls.lines import Lines, line_covariance

MAX_SNAP = 0.3
"""Maximum distance (m) between the end of a wall and the corner that it is moved to (chosen)."""


def wall_factors(
    table: WallTable, lines: Sequence[Lines], keys: Sequence[Key], config: Config
) -> list[WallObservation]:
    """Return one factor per observation of a confirmed wall.

    Parameters
    ----------
    table
        Walls and their observations.
    lines
        The lines of each keyframe, in its base frame.
    keys
        Variables of all keyframes.
    config
        Group ``walls``.
    """
    factors = []
    for k, i, w in zip(table.keyframe, table.line, table.wall):
        if w < 0:
            continue
        x, cov = lines[k], line_covariance(lines[k], i, config, table.roughness[w])
        key = wall_key(int(w))
        factors.append(WallObservation(keys[k], key, float(x.phi[i]), float(x.rho[i]), cov))
    return factors


def wall_records(
    table: WallTable, corners: Sequence[Corner], solution: GraphSolution, scale: float
) -> list[Wall]:
    """Return the optimised whole walls, with their ends moved to their corners.

    A whole wall is the piece with the most observations, extended over the others.

    Parameters
    ----------
    table
        Walls and their observations.
    corners
        The corners of the walls.
    solution
        Solution of the graph that contains them.
    scale
        Factor on their covariances.

    Returns
    -------
    list of Wall
        Walls with phi in (-pi, pi] and rho >= 0, in the order of `WallTable.whole_numbers`.
    """
    whole, main = table.whole_numbers(), table.main_pieces()
    optimised = _optimised(table, solution).joined()
    counts = np.bincount(optimised.wall[optimised.wall >= 0], minlength=len(main))
    phi, rho, ends = optimised.phi.tolist(), optimised.rho.tolist(), [*optimised.endpoints]
    joined = _join_ends(
        [c._replace(a=int(whole[c.a]), b=int(whole[c.b])) for c in corners], phi, rho, ends
    )
    walls = []
    for w in range(len(main)):
        # GTSAM's tangent of a vertical plane: rotation about -z, about the horizontal, offset.
        cov = solution.covariance(wall_key(main[w]))[np.ix_([0, 2], [0, 2])] * scale
        a, r, e = phi[w], rho[w], ends[w]
        is_turned = r < 0.0
        if is_turned:
            a, r, e = float(wrap_angle(a + np.pi)), -r, e[::-1]
        corners_of = tuple(sorted(joined[w]))
        walls.append(Wall(w, a, r, e.copy(), int(counts[w]), cov, corners_of, not is_turned))
    return walls


def _join_ends(
    corners: Sequence[Corner], phi: Sequence[float], rho: Sequence[float], ends: list[Float64]
) -> list[set[int]]:
    """Move the ends of walls to their corners; return the neighbours of each wall at corners."""
    joined: list[set[int]] = [set() for _ in ends]
    used: set[tuple[int, int]] = set()
    for corner in corners:
        pair = [corner.a, corner.b]
        point = meeting_point([phi[w] for w in pair], [rho[w] for w in pair])
        gaps = [np.hypot(*(ends[w] - point).T) for w in pair]
        nearest = [(w, int(np.argmin(gap))) for w, gap in zip(pair, gaps)]
        if max(float(gap.min()) for gap in gaps) > MAX_SNAP or used & set(nearest):
            continue
        used |= set(nearest)
        for w, e in nearest:
            ends[w][e] = point
        joined[corner.a].add(corner.b)
        joined[corner.b].add(corner.a)
    return joined


def _optimised(table: WallTable, solution: GraphSolution) -> WallTable:
    """Return the table with the optimised lines; the pooled extents are projected to them."""
    planes = np.array([solution.plane(wall_key(w)) for w in range(len(table))]).reshape(-1, 4)
    phi = np.arctan2(planes[:, 1], planes[:, 0])
    tangent = np.stack([-np.sin(phi), np.cos(phi)], axis=1)
    along = np.array([ends @ t for ends, t in zip(table.endpoints, tangent)]).reshape(-1, 2)
    return replace(table, phi=phi, rho=-planes[:, 3], extent=np.sort(along, axis=1))
