"""Where one map lies in another, from the surfaces and walls that both have.

Every recording has its own map frame, the first pose of its base. Pairs of surfaces that stand at
the same heights and as far from each other in both maps propose a planar transform; the one under
which most surfaces and walls meet is taken, and refined by what meets.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tccm_ros.arrays import Float64
from tccm_ros.geometry import spatial, transform, transform2, wrap_angle
from tccm_ros.results.folder_reader import Results
from tccm_ros.results.models import SurfaceEntry, WallEntry
from tccm_ros.results.trajectory import Trajectory

__all__ = ["describe", "find_alignment", "moved_results"]


HEIGHT = 0.05
"""Surfaces of a pair differ at most so much in height, m ..."""

AREA_RATIO = 2.5
"""... and in area, of which each map may have seen another part."""

DISTANCE = 0.35
"""Distances between two surfaces' middles differ at most so much, m."""

LEAST_BASE = 0.8
"""Surfaces nearer to each other tell no direction, m."""

MEET = 0.30
"""What is as near after the transform has met, m."""

WALL_ANGLE = np.deg2rad(8.0)
WALL_MEET = 0.20
WALL_WEIGHT = 0.5
"""A wall that meets counts less than a surface: rooms have many parallel ones."""

LEAST_SCORE = 3.0
LEAST_SHARE = 0.5
"""Fewer meetings, or a smaller share of the smaller map, are chance."""

ROUNDS = 4
FAR = 1e3


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """What is matched: middles (N, 3), areas (N,), wall directions (M,) and middles (M, 2)."""

    middles: Float64
    areas: Float64
    directions: Float64
    wall_middles: Float64


def find_alignment(before: Results, after: Results) -> Float64 | None:
    """Find the planar pose of the second map's frame in the first's.

    Returns
    -------
    float64 (3,) or None
        (x, y, yaw), m and rad; None where too little meets.
    """
    a, b = _features(before), _features(after)
    best, best_score = None, 0.0
    for guess in _proposals(a, b):
        score = _score(a, b, guess)
        if score > best_score + 1e-9:
            best, best_score = guess, score
    possible = min(len(f.middles) + WALL_WEIGHT * len(f.wall_middles) for f in (a, b))
    if best is None or best_score < max(LEAST_SCORE, LEAST_SHARE * possible):
        return None
    for _ in range(ROUNDS):
        best = _refine(a, b, best)
    return best


def _features(results: Results) -> Features:
    surfaces = sorted(results.above_floor, key=lambda s: s.id)
    middles = [[s.centroid[0], s.centroid[1], s.height - results.ground] for s in surfaces]
    ends = np.array([wall.endpoints for wall in results.walls]).reshape(-1, 2, 2)
    along = ends[:, 1] - ends[:, 0]
    return Features(
        np.array(middles).reshape(-1, 3),
        np.array([s.area for s in surfaces]),
        np.arctan2(along[:, 1], along[:, 0]),
        ends.mean(axis=1),
    )


def _proposals(a: Features, b: Features) -> Iterator[Float64]:
    """Give the transforms that bring two surfaces of the second map onto two of the first."""
    level = np.abs(a.middles[:, None, 2] - b.middles[None, :, 2]) <= HEIGHT
    ratio = np.maximum(a.areas[:, None], 1e-6) / np.maximum(b.areas[None], 1e-6)
    alike = np.argwhere(level & (ratio <= AREA_RATIO) & (ratio >= 1.0 / AREA_RATIO))
    for first, (i, j) in enumerate(alike):
        for k, m in alike[first + 1 :]:
            if i == k or j == m:
                continue
            span_a = a.middles[k, :2] - a.middles[i, :2]
            span_b = b.middles[m, :2] - b.middles[j, :2]
            lengths = np.hypot(*span_a), np.hypot(*span_b)
            if min(lengths) < LEAST_BASE or abs(lengths[0] - lengths[1]) > DISTANCE:
                continue
            yaw = np.arctan2(span_a[1], span_a[0]) - np.arctan2(span_b[1], span_b[0])
            yield _carrying(yaw, (a.middles[[i, k], :2]).mean(axis=0), b.middles[[j, m], :2])


def _carrying(yaw: float, target: Float64, points: Float64) -> Float64:
    """Return the pose with this heading that carries the middle of points (N, 2) to a target."""
    turned = transform2(np.array([0.0, 0.0, yaw]), points).mean(axis=0)
    return np.array([*(target - turned), float(wrap_angle(yaw))])


def _score(a: Features, b: Features, guess: Float64) -> float:
    surfaces, walls = _meetings(a, b, guess)
    return len(surfaces) + WALL_WEIGHT * len(walls)


def _meetings(a: Features, b: Features, guess: Float64) -> tuple[Float64, Float64]:
    """Return the index pairs (K, 2) of surfaces, and of walls, that meet."""
    moved = transform2(guess, b.middles[:, :2])
    apart = np.linalg.norm(a.middles[:, None, :2] - moved[None], axis=2)
    level = np.abs(a.middles[:, None, 2] - b.middles[None, :, 2]) <= HEIGHT
    surfaces = _mutual(np.where(level, apart, FAR), MEET)
    return surfaces, _mutual(_wall_costs(a, b, guess), WALL_MEET)


def _wall_costs(a: Features, b: Features, guess: Float64) -> Float64:
    """Return how far apart walls lie across their direction, (N, M), m; `FAR` if not parallel."""
    turn = _line_angle(a.directions[:, None] - (b.directions + guess[2])[None])
    across = np.stack([-np.sin(a.directions), np.cos(a.directions)], axis=1)
    between = transform2(guess, b.wall_middles)[None] - a.wall_middles[:, None]
    beside = np.abs(np.einsum("nmk,nk->nm", between, across))
    far = np.linalg.norm(between, axis=2) > 2.0
    return np.where((np.abs(turn) > WALL_ANGLE) | far, FAR, beside)


def _line_angle(difference: Float64) -> Float64:
    """Wrap differences of directions of undirected lines to (-pi/2, pi/2], rad."""
    return wrap_angle(2.0 * difference) / 2.0


def _mutual(costs: Float64, limit: float) -> Float64:
    """Return the index pairs (K, 2) that are each other's nearest within a limit."""
    if costs.size == 0:
        return np.zeros((0, 2), np.int64)
    to_b, to_a = costs.argmin(axis=1), costs.argmin(axis=0)
    rows = np.flatnonzero(to_a[to_b] == np.arange(len(costs)))
    rows = rows[costs[rows, to_b[rows]] <= limit]
    return np.stack([rows, to_b[rows]], axis=1)


def _refine(a: Features, b: Features, guess: Float64) -> Float64:
    """Turn by the walls that meet (by the surfaces where none does), then shift by both."""
    surfaces, walls = _meetings(a, b, guess)
    yaw = guess[2]
    if len(walls):
        turn = _line_angle(a.directions[walls[:, 0]] - b.directions[walls[:, 1]] - yaw)
        yaw = yaw + float(np.median(turn))
    moved = transform2(np.array([0.0, 0.0, yaw]), b.middles[surfaces[:, 1], :2])
    rows = [np.tile(np.eye(2), (len(surfaces), 1))]
    values = [(a.middles[surfaces[:, 0], :2] - moved).ravel()]
    if len(walls):
        # Walls say where they are across, ten times as sure as the middle of a surface.
        direction = a.directions[walls[:, 0]]
        across = np.stack([-np.sin(direction), np.cos(direction)], axis=1)
        turned = transform2(np.array([0.0, 0.0, yaw]), b.wall_middles[walls[:, 1]])
        rows.append(10.0 * across)
        shift = np.einsum("nk,nk->n", a.wall_middles[walls[:, 0]] - turned, across)
        values.append(10.0 * shift)
    shift, *_ = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)
    return np.array([*shift, float(wrap_angle(yaw))])


# --- a map in another frame ---------------------------------------------------------------------


def moved_results(results: Results, pose: Float64) -> Results:
    """Return surfaces, walls and trajectory of a map in the frame in which its own lies at `pose`.

    What a comparison does not use (cuboids, cycles, planes) stays as it is.
    """
    T = spatial(pose)
    trajectory = results.trajectory
    return replace(
        results,
        surfaces=tuple(_moved_surface(surface, T) for surface in results.surfaces),
        walls=tuple(_moved_wall(wall, pose) for wall in results.walls),
        trajectory=Trajectory(trajectory.stamps_ns, T @ trajectory.T_map_base),
    )


def _moved_surface(surface: SurfaceEntry, T: Float64) -> SurfaceEntry:
    def ring(points: Float64) -> Float64:
        return transform(T, points) if len(points) else points

    return replace(
        surface,
        normal=T[:3, :3] @ surface.normal,
        centroid=transform(T, surface.centroid[None])[0],
        boundary=ring(surface.boundary),
        holes=tuple(ring(hole) for hole in surface.holes),
    )


def _moved_wall(wall: WallEntry, pose: Float64) -> WallEntry:
    phi = wall.phi + pose[2]
    rho = wall.rho + float(np.array([np.cos(phi), np.sin(phi)]) @ pose[:2])
    if rho < 0.0:
        phi, rho = phi + np.pi, -rho
    ends = transform2(pose, wall.endpoints)
    return replace(wall, phi=float(wrap_angle(phi)), rho=rho, endpoints=ends)


def describe(pose: Sequence[float]) -> str:
    """Return a planar pose in words."""
    return f"{pose[0]:.2f} m, {pose[1]:.2f} m, {np.degrees(pose[2]):.1f} deg"
