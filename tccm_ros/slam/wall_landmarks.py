"""Walls as landmarks: observations to factors, and the optimised walls read back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.config import Config
from tccm_ros.geometry import wrap_angle
from tccm_ros.records import Wall
from tccm_ros.slam.corners import Corner, meeting_point
from tccm_ros.slam.factors import (
    Building,
    Factor,
    Key,
    WallDirection,
    WallObservation,
    building_key,
    wall_key,
)
from tccm_ros.slam.graph import GraphSolution
from tccm_ros.slam.lines import Lines
from tccm_ros.slam.walls import WallTable

__all__ = ["structure_factors", "wall_factors", "wall_records"]


SNAP = 0.3
"""An end further than this (m) from where its walls meet is not moved there."""

LEAST_SUPPORT = 0.6
"""Fraction of the length of all walls that must agree on one direction (modulo a right angle)."""

NEAR = 0.05
"""Walls within this angle (rad) of that direction are taken to have it."""

SIGMA = 0.006
"""How exactly builders keep it, rad."""


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


def structure_factors(table: WallTable) -> list[Factor]:
    """Return soft factors that make walls parallel or square; none where few walls are."""
    if len(table) < 3:
        return []
    length = table.extent[:, 1] - table.extent[:, 0]
    mean = np.sum(length * np.exp(4j * table.phi))
    for _ in range(5):
        away = np.angle(np.exp(4j * table.phi) * np.conj(mean) / abs(mean)) / 4.0
        near = np.abs(away) < NEAR
        if not near.any():
            return []
        mean = np.sum((length * np.exp(4j * table.phi))[near])
    if length[near].sum() < LEAST_SUPPORT * length.sum():
        return []
    yaw, key = float(np.angle(mean)) / 4.0, building_key()
    factors: list[Factor] = [Building(key, yaw)]
    for w in map(int, np.flatnonzero(near)):
        quarter = round(float(table.phi[w] - yaw) / (0.5 * np.pi))
        factors.append(WallDirection(key, wall_key(w), quarter * 0.5 * np.pi, SIGMA))
    return factors


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
